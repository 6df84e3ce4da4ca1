"""The twin as a chain file that ``labcdp simulate`` takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, floor
from typing import Any

from ..calibration.emva.result import Quantity
from ..session import SessionConfiguration
from ..toml_text import toml_text
from .observe import ObservedSession
from .twin import TwinResult
from .twin_noise import known

#: Significant digits of the values in the file.
_DIGITS = 7


def twin_chain_text(result: TwinResult) -> str:
    """Write the twin as TOML: the camera of a session before the session's patches, at an exposure of the session.

    Patches that were shown together lie where they were, on surroundings as dark as the darkest of them, since those
    were not measured; patches shown one by one become stripes. The values carry their standard uncertainties as
    comments.

    Parameters
    ----------
    result : TwinResult
        The twin.
    """
    lines = ["# The twin of a camera, made by labcdp from a recorded session.", "# Values +- standard uncertainty."]
    lines += [f"# Note: {note}" for note in result.parameters.notes]
    uncertainties = _comments(result.parameters.quantities)
    table = ""
    for line in toml_text(twin_document(result)).splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key = line.partition(" = ")[0]
        comment = uncertainties.get((table, key), "")
        lines.append(f"{line}  # {comment}" if comment else line)
    return "\n".join(lines) + "\n"


def twin_document(result: TwinResult) -> dict[str, Any]:
    """Tables of the chain file."""
    twin, configuration = result.parameters, result.observed.configuration
    shape = result.calibration.state.image_shape
    sensor = twin.sensor(shape)
    lens = configuration.lens
    # The chain states K at 0 dB; the sensor here has that of the session's gain.
    k_at_0_db = sensor.k_dn_per_e / 10 ** (twin.gain_db / 20)
    numbers = {
        "pixel_pitch_m": sensor.pixel_pitch_m,
        "width": shape[1],
        "height": shape[0],
        "quantum_efficiency": sensor.quantum_efficiency,
        "full_well_e": sensor.full_well_e,
        "k_dn_per_e": k_at_0_db,
        "read_noise_e": sensor.read_noise_e,
        "dark_current_e_s": sensor.dark_current_e_s,
        "bits": sensor.bits,
        "black_level_dn": sensor.black_level_dn,
        "reference_temperature_c": sensor.reference_temperature_c,
        "doubling_temperature_c": sensor.doubling_temperature_c,
        "prnu_rel": sensor.prnu_rel,
        "dsnu_e": sensor.dsnu_e,
        "column_dsnu_e": sensor.column_dsnu_e,
        "row_dsnu_e": sensor.row_dsnu_e,
        "dsnu_e_s": sensor.dsnu_e_s,
    }
    return {
        "name": "twin",
        "description": f"Twin of {result.calibration.state.camera}, from the session {configuration.name}",
        "spectrum": configuration.source.spectrum,
        "scene": _scene(result, shape),
        "optics": {
            "f_number": lens.f_number,
            "transmittance": twin.transmittance,
            "focal_length_m": lens.focal_length_m,
        },
        "exposure": {
            "exposure_s": _exposure_s(result.observed),
            "gain_db": twin.gain_db,
            "temperature_c": twin.temperature_c,
        },
        "sensor": {"type": "emva1288", **{name: _rounded(value) for name, value in numbers.items()}},
    }


def _rounded(value: Any) -> Any:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def _comments(quantities: Mapping[str, Quantity]) -> dict[tuple[str, str], str]:
    """Uncertainty and origin of the sensor's values, by table and key."""
    comments = {}
    for name, one in quantities.items():
        key = "quantum_efficiency" if name.startswith("quantum") else name
        uncertainty = f"+- {known(one):.2g} {one.unit}; " if known(one) > 0 else ""
        comments["sensor", key] = f"{uncertainty}{one.note}".rstrip("; ")
    return comments


def _scene(result: TwinResult, shape: tuple[int, int]) -> dict[str, Any]:
    height, width = shape
    regions = sorted(result.regions, key=lambda region: region.luminance_cd_m2)
    levels = [_rounded(region.luminance_cd_m2) for region in regions]
    configuration = result.observed.configuration
    if configuration.target.presentation == "one by one":
        return {"type": "step-chart", "luminances_cd_m2": levels}
    luminance = {region.name: region.luminance_cd_m2 for region in regions}
    patches = []
    for name, (left, top, right, bottom) in _bounds(configuration, list(luminance)).items():
        x, y = max(floor(left), 0), max(floor(top), 0)
        size = {"width": min(ceil(right), width) - x, "height": min(ceil(bottom), height) - y}
        patches.append({"x": x, "y": y, **size, "luminance_cd_m2": _rounded(luminance[name])})
    return {"type": "patches", "background_cd_m2": levels[0], "patches": patches}


def _bounds(configuration: SessionConfiguration, names: Sequence[str]) -> dict[str, tuple[float, float, float, float]]:
    return {patch.name: patch.region().bounds for patch in configuration.target.patches if patch.name in names}


def _exposure_s(observed: ObservedSession) -> float:
    """Longest exposure that saturates no patch; the shortest there is if each does."""
    exposures = sorted({o.exposure_s for group in observed.patches.values() for o in group})
    saturated = {o.exposure_s for group in observed.patches.values() for o in group if o.saturated_share > 0}
    return max((t for t in exposures if t not in saturated), default=exposures[0])
