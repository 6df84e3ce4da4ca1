"""The sensor of a chain from EMVA 1288 results: labcdp's own, or the values of a data sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import sqrt
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import Field, create_model

from ...calibration.frames.rounding import ROUNDING_DN2
from ...chain import Chain, Sensor
from ...core.disk import number_of, read_json, read_toml
from ...core.disk.text import toml_text
from ...core.errors import ConfigurationError, InputError, naming, printable
from ...report.files import SCHEMA
from ...session.tables import ConfigurationTable, Number, Positive
from ...session.validation import validated

AnyChain = TypeVar("AnyChain", bound=Chain)

#: Keys of the sensor that are also keys of labcdp's results.
_SAME = (
    "k_dn_per_e", "quantum_efficiency", "black_level_dn", "dark_current_e_s", "doubling_temperature_c", "dsnu_e",
    "dsnu_e_s", "prnu_rel", "full_well_e",
)  # fmt: skip
#: Key of the sensor by the key of the results; of several for one key the last that is known counts.
_MEASURED = dict(zip(_SAME, _SAME, strict=True)) | {
    "dark_noise_e": "read_noise_e",
    "dsnu_pixel_e": "dsnu_e",
    "dsnu_column_e": "column_dsnu_e",
    "dsnu_row_e": "row_dsnu_e",
}
_RESULTS = "EMVA 1288 results"


class _Stated(ConfigurationTable):
    """Values that data sheets state instead of a key of the sensor; see `_read_data_sheet`."""

    wavelength_nm: Number | None = Field(None, ge=100, le=3000, description="a wavelength from 100 to 3000 nm")
    saturation_photons: Positive | None = Field(None, le=1e9, description="a number above 0, up to 1e9 photons")
    # The full well of a chain ends at 1e7 e-.
    snr_max_db: Positive | None = Field(None, le=70, description="a number above 0, up to 70 dB")
    dark_noise_dn: Positive | None = Field(None, le=65535, description="a number above 0, up to 65535 DN")
    sensitivity_threshold_photons: Positive | None = Field(None, le=1e6, description="a number above 0, up to 1e6")
    dynamic_range_db: Positive | None = Field(None, le=200, description="a number above 0, up to 200 dB")


#: Values of these keys are checked by the sensor itself.
_OF_SENSOR: dict[str, Any] = {field_.name: (Any, None) for field_ in fields(Sensor)}
_Sheet: type[_Stated] = create_model("_Sheet", __base__=_Stated, **_OF_SENSOR)


def with_emva1288(chain: AnyChain, path: Path) -> tuple[AnyChain, dict[str, str]]:
    """Put EMVA 1288 results in the place of the values of a chain's sensor.

    Parameters
    ----------
    chain : Chain
        Its sensor gives what the results do not state.
    path : Path
        results.json of ``labcdp characterise`` or its folder, or a TOML file with a table ``[emva1288]``.

    Returns
    -------
    (Chain, dict of str to str)
        The chain, and by the keys of its sensor that are not the chain's own where their values come from.

    Raises
    ------
    InputError
        If the file is neither, a value cannot be used, or the chain has no EMVA 1288 sensor.
    """
    sensors = [sensor for _, sensor in chain.sensors]
    if len(sensors) != 1 or not isinstance(sensors[0], Sensor):
        raise InputError(f"{chain.name or 'the chain'} has no single sensor of type emva1288: take another preset")
    folder = path / "results.json"
    file = folder if folder.is_file() else path
    values, notes = (_read_data_sheet if file.suffix.lower() == ".toml" else _read_results)(file, sensors[0])
    changes = {f"sensor.{name}": value for name, value in values.items()}
    name = file.parent.name if file.name == "results.json" else file.stem
    made = replace(chain, source=f"{file} with {chain.source}").with_(**changes, name=name)
    return made, dict.fromkeys(values, _RESULTS) | notes


def chain_text(preset: str, path: Path) -> str:
    """Return a preset with the sensor of EMVA 1288 results as chain file, each value of the sensor with its origin."""
    chain, origins = with_emva1288(Chain.load(preset), path)
    chain = chain.with_(description=f"Sensor after EMVA 1288 by {path.name}; all else of the preset {preset}")
    comments = {
        ("sensor", key): origins.get(key, f"preset {preset}") for key in chain.document["sensor"] if key != "type"
    }
    return commented_toml([f"The preset {preset} with the sensor of EMVA 1288 results."], chain.document, comments)


def commented_toml(head: Sequence[str], document: Mapping[str, Any], comments: Mapping[tuple[str, str], str]) -> str:
    """Return a document as TOML below lines of comment, with comments behind values, by table and key."""
    # Files that they name may have any name, also of several lines.
    return "".join(f"# {printable(line)}\n" for line in head) + toml_text(document, comments)


def _read_results(path: Path, sensor: Sensor) -> tuple[dict[str, Any], dict[str, str]]:
    content = read_json(path, "results of labcdp characterise")
    if not isinstance(content, dict) or content.get("schema") != SCHEMA or content.get("kind") != "characterise":
        raise InputError(f"{path} holds no results of labcdp characterise: give these, or a TOML with [emva1288]")
    try:
        made = content["configuration"]
        rows = {row["key"]: row["value"] for row in content["tables"]["characterisation"]["rows"]}
        known = {name: rows[key] for key, name in _MEASURED.items() if rows.get(key) is not None}
        # The root of a variance below 0 is given as negative: no more than temporal noise leaves.
        values: dict[str, Any] = {name: max(number_of(value), 0.0) for name, value in known.items()}
        # A chain states K at 0 dB; a data set does not say at which gain it was recorded.
        gain_db = made["gain_db"]
        values["k_dn_per_e"] /= 10 ** ((0.0 if gain_db is None else number_of(gain_db)) / 20)
        values |= {name: int(number_of(made[name])) for name in ("bits", "width", "height")}
        if made.get("temperature_c") is not None:
            values["reference_temperature_c"] = number_of(made["temperature_c"])
        stated: dict[str, Any] = {name: values[name] for name in ("bits", "black_level_dn") if name in values}
        converter = _with(sensor, stated, str(path))
        wells_e = {
            "the results": values.get("full_well_e", 0.0),
            "the converter's end at 0 dB": _range_dn(converter) / values["k_dn_per_e"],
            "the preset": sensor.full_well_e,
        }
        limited = made["saturation_limit"] != "full well"
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{path} lacks some of the results of labcdp characterise: run it again") from error
    if not values.get("dark_current_e_s"):
        values["dsnu_e_s"] = 0.0
    notes = {} if gain_db is not None else {"k_dn_per_e": f"{_RESULTS}; their gain is not stated, taken as 0 dB"}
    if not limited:
        return values, notes
    origin = max(wells_e, key=lambda name: wells_e[name])
    note = f"lower limit in the {_RESULTS} ({wells_e['the results']:.0f} e-): that of {origin}"
    return values | {"full_well_e": wells_e[origin]}, notes | {"full_well_e": note}


def _read_data_sheet(path: Path, sensor: Sensor) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the values of a data sheet, by the relations of EMVA 1288 Release 4.0 Linear.

    mu_e.sat = eta mu_p.sat = SNR_max^2, DR = mu_e.sat / mu_e.min, mu_e.min = eta mu_p.min = sigma_y.dark / K + 1/2,
    and the variance of the read noise is (sigma_y.dark^2 - 1/12) / K^2.
    """
    table = read_toml(path, "values of a data sheet").get("emva1288")
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path} has no table [emva1288]: give the values of the data sheet there")
    source = f"{path}, table [emva1288]"
    stated = validated(_Sheet, table, source)
    values: dict[str, Any] = {name: value for name, value in table.items() if name in _OF_SENSOR}
    typed = _with(sensor, values, source)
    eta: Any = typed.quantum_efficiency if "quantum_efficiency" in values else None
    for name in ("saturation_photons", "sensitivity_threshold_photons", "wavelength_nm"):
        if name in table and not isinstance(eta, float):
            raise ConfigurationError(f"{source}: {name} needs quantum_efficiency as one number")
    if stated.saturation_photons is not None:
        values.setdefault("full_well_e", eta * stated.saturation_photons)
    if stated.snr_max_db is not None:
        values.setdefault("full_well_e", 10 ** (stated.snr_max_db / 10))
    notes = {}
    if "k_dn_per_e" not in values and values.keys() & {"full_well_e", "bits", "black_level_dn"}:
        values["k_dn_per_e"] = _range_dn(typed) / values.get("full_well_e", sensor.full_well_e)
        notes["k_dn_per_e"] = "assumed: the converter ends at the full well"
    typed = _with(sensor, values, source)
    k, threshold_e = typed.k_dn_per_e, None
    if stated.sensitivity_threshold_photons is not None:
        threshold_e = eta * stated.sensitivity_threshold_photons
    elif stated.dynamic_range_db is not None:
        threshold_e = typed.full_well_e / 10 ** (stated.dynamic_range_db / 20)
    dark_dn = stated.dark_noise_dn
    if dark_dn is None and threshold_e is not None:
        dark_dn = k * max(threshold_e - 0.5, 0.0)
    if dark_dn is not None:
        values.setdefault("read_noise_e", sqrt(max(dark_dn**2 - ROUNDING_DN2, 0.0)) / k)
    if stated.wavelength_nm is not None and not isinstance(sensor.quantum_efficiency, float):
        values["quantum_efficiency"] = _scaled_efficiency(sensor, stated.wavelength_nm, eta, path)
    return values, notes


def _with(sensor: Sensor, values: dict[str, Any], source: str) -> Sensor:
    with naming(source, ConfigurationError):
        return replace(sensor, **values)


def _range_dn(sensor: Sensor) -> float:
    """Range of the converter above the black level."""
    return float(2**sensor.bits - 1 - sensor.black_level_dn)


def _scaled_efficiency(sensor: Sensor, wavelength_nm: float, eta: float, path: Path) -> list[list[float]]:
    """Scale the sensor's spectral quantum efficiency so that it has the stated one at a wavelength."""
    wavelengths, curve = np.array(sensor.quantum_efficiency, dtype=float).T
    eta_here = float(np.interp(wavelength_nm, wavelengths, curve, left=0.0, right=0.0))
    if eta_here == 0 or eta / eta_here * curve.max() > 1:
        raise ConfigurationError(
            f"{path}: quantum_efficiency {eta:g} at {wavelength_nm:g} nm does not fit the shape of the preset: give "
            "pairs of wavelength and value"
        )
    return [[float(w), round(float(value * eta / eta_here), 4)] for w, value in zip(wavelengths, curve, strict=True)]
