"""The twin as a chain file for ``labcdp simulate``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from math import ceil, floor
from typing import Any

from ...calibration.emva.result import Quantity
from ...core.disk.toml_text import toml_text
from ...report.findings import finding_text
from ..bench.observe import ObservedSession
from .evaluate import TwinEvaluation
from .noise import known

#: Significant digits of the values in the file.
_DIGITS = 7


def twin_chain_text(evaluation: TwinEvaluation) -> str:
    """Write the twin as TOML: the camera of a session before the session's patches, at an exposure of the session.

    Patches shown together keep their positions; the surroundings, which were not measured, get the luminance of the
    darkest patch. Patches shown one by one become stripes. The values carry their standard uncertainties as comments.

    Parameters
    ----------
    evaluation : TwinEvaluation
        The twin.
    """
    lines = ["# The twin of a camera, made by labcdp from a recorded session.", "# Values +- standard uncertainty."]
    lines += [f"# Note: {finding_text(one)}" for one in evaluation.parameters.findings]
    uncertainties = _comments(evaluation.parameters.quantities)
    table = ""
    for line in toml_text(twin_document(evaluation)).splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key = line.partition(" = ")[0]
        comment = uncertainties.get((table, key), "")
        lines.append(f"{line}  # {comment}" if comment else line)
    return "\n".join(lines) + "\n"


def twin_document(evaluation: TwinEvaluation) -> dict[str, Any]:
    """Tables of the chain file."""
    twin, configuration = evaluation.parameters, evaluation.observed.configuration
    shape = evaluation.calibration.state.image_shape
    sensor = asdict(twin.sensor(shape))
    del sensor["device_seed"]
    # The chain file states K at 0 dB; the sensor here has K at the session's gain.
    sensor["k_dn_per_e"] /= 10 ** (twin.gain_db / 20)
    lens = configuration.lens
    return {
        "name": "twin",
        "description": f"Twin of {evaluation.calibration.state.camera}, from the session {configuration.name}",
        "spectrum": configuration.source.spectrum,
        "scene": _scene(evaluation, shape),
        "optics": {
            "f_number": lens.f_number,
            "transmittance": twin.transmittance,
            "focal_length_m": lens.focal_length_m,
        },
        "exposure": {
            "exposure_s": _exposure_s(evaluation.observed),
            "gain_db": twin.gain_db,
            "temperature_c": twin.temperature_c,
        },
        "sensor": {"type": "emva1288", **{name: _rounded(value) for name, value in sensor.items()}},
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


def _scene(evaluation: TwinEvaluation, shape: tuple[int, int]) -> dict[str, Any]:
    height, width = shape
    levels = sorted(_rounded(region.luminance_cd_m2) for region in evaluation.regions)
    configuration = evaluation.observed.configuration
    if configuration.target.presentation == "one by one":
        return {"type": "step-chart", "luminances_cd_m2": levels}
    bounds = {patch.name: patch.region().bounds for patch in configuration.target.patches}
    patches = []
    for region in evaluation.regions:
        left, top, right, bottom = bounds[region.name]
        x, y = max(floor(left), 0), max(floor(top), 0)
        size = {"width": min(ceil(right), width) - x, "height": min(ceil(bottom), height) - y}
        patches.append({"x": x, "y": y, **size, "luminance_cd_m2": _rounded(region.luminance_cd_m2)})
    return {"type": "patches", "background_cd_m2": levels[0], "patches": patches}


def _exposure_s(observed: ObservedSession) -> float:
    """Longest exposure that saturates no patch; the shortest one if all of them saturate one."""
    exposures = sorted({o.exposure_s for group in observed.patches.values() for o in group})
    saturated = {o.exposure_s for group in observed.patches.values() for o in group if o.saturated_share > 0}
    return max((t for t in exposures if t not in saturated), default=exposures[0])
