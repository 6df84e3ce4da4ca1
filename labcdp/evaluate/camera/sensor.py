"""The sensor of a chain from EMVA 1288 results: labcdp's own, or the values of a data sheet."""

from __future__ import annotations

from dataclasses import fields
from math import sqrt
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...calibration.rounding import ROUNDING_DN2
from ...chain import Chain, Sensor
from ...core.disk import read_json, read_toml
from ...core.disk.toml_text import toml_text
from ...core.errors import ConfigurationError, InputError
from ...report.envelope import SCHEMA

AnyChain = TypeVar("AnyChain", bound=Chain)

#: Keys of the sensor by those of labcdp's results, by which the last one that is known counts.
_MEASURED = {
    "k_dn_per_e": "k_dn_per_e",
    "quantum_efficiency": "quantum_efficiency",
    "black_level_dn": "black_level_dn",
    "dark_noise_e": "read_noise_e",
    "dark_current_e_s": "dark_current_e_s",
    "doubling_temperature_c": "doubling_temperature_c",
    "dsnu_e": "dsnu_e",
    "dsnu_pixel_e": "dsnu_e",
    "dsnu_column_e": "column_dsnu_e",
    "dsnu_row_e": "row_dsnu_e",
    "dsnu_e_s": "dsnu_e_s",
    "prnu_rel": "prnu_rel",
    "full_well_e": "full_well_e",
}
#: What data sheets state instead of a key of the sensor; see `_of_sheet`.
_STATED = (
    "wavelength_nm",
    "saturation_photons",
    "snr_max_db",
    "dark_noise_dn",
    "sensitivity_threshold_photons",
    "dynamic_range_db",
)


def with_emva1288(chain: AnyChain, path: Path) -> tuple[AnyChain, tuple[str, ...]]:
    """Put EMVA 1288 results in the place of the values of a chain's sensor.

    Parameters
    ----------
    chain : Chain
        Its sensor gives what the results do not state.
    path : Path
        results.json of ``labcdp characterise`` or its folder, or a TOML file with a table ``[emva1288]``.

    Returns
    -------
    (Chain, tuple of str)
        The chain, and the keys of its sensor that come from the results.

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
    values = _of_sheet(file, sensors[0]) if file.suffix.lower() == ".toml" else _of_results(file)
    changes = {f"sensor.{name}": value for name, value in values.items()}
    return chain.with_(**changes, name=file.parent.name if file.name == "results.json" else file.stem), tuple(values)


def chain_text(preset: str, path: Path) -> str:
    """Return a preset with the sensor of EMVA 1288 results as chain file, each value of the sensor with its origin."""
    chain, keys = with_emva1288(Chain.load(preset), path)
    chain = chain.with_(description=f"Sensor after EMVA 1288 by {path.name}; all else of the preset {preset}")
    lines = [f"# The preset {preset} with the sensor of EMVA 1288 results."]
    table = ""
    for line in toml_text(chain.document).splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key, equals, _ = line.partition(" = ")
        origin = "EMVA 1288 results" if key in keys else f"preset {preset}"
        lines.append(f"{line}  # {origin}" if table == "sensor" and equals and key != "type" else line)
    return "\n".join(lines) + "\n"


def _of_results(path: Path) -> dict[str, Any]:
    content = read_json(path, "results of labcdp characterise")
    if not isinstance(content, dict) or content.get("schema") != SCHEMA or content.get("kind") != "characterise":
        raise InputError(f"{path} holds no results of labcdp characterise: give these, or a TOML with [emva1288]")
    try:
        made = content["configuration"]
        rows = {row["key"]: row["value"] for row in content["tables"]["characterisation"]["rows"]}
        known = {name: rows[key] for key, name in _MEASURED.items() if rows.get(key) is not None}
        # The root of a variance below 0 is given as negative: no more than temporal noise leaves.
        values = {name: max(float(value), 0.0) for name, value in known.items()}
        # A chain states K at 0 dB.
        values["k_dn_per_e"] /= 10 ** (float(made["gain_db"]) / 20)
        whole = {name: int(made[name]) for name in ("bits", "width", "height")}
        temperature_c = made.get("temperature_c")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} lacks a part of the results of labcdp characterise: run it again") from error
    if not values.get("dark_current_e_s"):
        values["dsnu_e_s"] = 0.0
    return {**whole, **values, **({} if temperature_c is None else {"reference_temperature_c": float(temperature_c)})}


def _of_sheet(path: Path, sensor: Sensor) -> dict[str, Any]:
    """Return the values of a data sheet, by the relations of EMVA 1288 Release 4.0 Linear.

    mu_e.sat = eta mu_p.sat = SNR_max^2, DR = mu_e.sat / mu_e.min, mu_e.min = eta mu_p.min = sigma_y.dark / K + 1/2,
    and the variance of the read noise is (sigma_y.dark^2 - 1/12) / K^2.
    """
    table = read_toml(path, "values of a data sheet").get("emva1288")
    names = (*(one.name for one in fields(Sensor)), *_STATED)
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path} has no table [emva1288]: give the values of the data sheet there")
    for name, value in table.items():
        if name not in names:
            raise ConfigurationError(f"{path}: [emva1288] has the key {name!r}: give some of {', '.join(names)}")
        if name in _STATED and (isinstance(value, bool) or not isinstance(value, int | float) or not value > 0):
            raise ConfigurationError(f"{path}: {name} is {value!r}: give a number above 0")
    values: dict[str, Any] = {name: value for name, value in table.items() if name not in _STATED}
    eta: Any = values.get("quantum_efficiency")
    photons = [name for name in ("saturation_photons", "sensitivity_threshold_photons") if name in table]
    if (photons or "wavelength_nm" in table) and not isinstance(eta, float):
        raise ConfigurationError(f"{path}: {(*photons, 'wavelength_nm')[0]} needs quantum_efficiency as one number")
    if "saturation_photons" in table:
        values.setdefault("full_well_e", eta * table["saturation_photons"])
    if "snr_max_db" in table:
        values.setdefault("full_well_e", 10 ** (table["snr_max_db"] / 10))
    k = values.get("k_dn_per_e", sensor.k_dn_per_e)
    threshold_e = None
    if "sensitivity_threshold_photons" in table:
        threshold_e = eta * table["sensitivity_threshold_photons"]
    elif "dynamic_range_db" in table:
        threshold_e = values.get("full_well_e", sensor.full_well_e) / 10 ** (table["dynamic_range_db"] / 20)
    dark_dn = table.get("dark_noise_dn", None if threshold_e is None else k * (threshold_e - 0.5))
    if dark_dn is not None:
        values.setdefault("read_noise_e", sqrt(max(max(dark_dn, 0.0) ** 2 - ROUNDING_DN2, 0.0)) / k)
    if "wavelength_nm" in table and not isinstance(sensor.quantum_efficiency, float | int):
        values["quantum_efficiency"] = _through(sensor, float(table["wavelength_nm"]), eta, path)
    return values


def _through(sensor: Sensor, wavelength_nm: float, eta: float, path: Path) -> list[list[float]]:
    """Scale the sensor's spectral quantum efficiency so that it has the stated one at a wavelength."""
    wavelengths, curve = np.array(sensor.quantum_efficiency, dtype=float).T
    own = float(np.interp(wavelength_nm, wavelengths, curve, left=0.0, right=0.0))
    if own == 0 or eta / own * curve.max() > 1:
        raise ConfigurationError(
            f"{path}: quantum_efficiency {eta:g} at {wavelength_nm:g} nm does not fit the shape of the preset: give "
            "pairs of wavelength and value"
        )
    return [[float(w), round(float(value * eta / own), 4)] for w, value in zip(wavelengths, curve, strict=True)]
