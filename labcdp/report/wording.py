"""What a report says in sentences: what was measured, by what, and what came out."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from .digits import cdp_decimals, cdp_interval, decimals, fixed, percent, printable, significant

if TYPE_CHECKING:
    from ..evaluate import ContrastRow, SessionEvaluation


def measured(evaluation: SessionEvaluation) -> str:
    """Tell what was measured, when, and with which devices."""
    configuration = evaluation.observed.configuration
    meter = next(iter(evaluation.observed.readings.values()))[0].meter
    first, last = recorded(evaluation)
    days = day(first) if day(first) == day(last) else f"{day(first)} to {day(last)}"
    n = len(evaluation.patches)
    return printable(
        f"{n} {'patch' if n == 1 else 'patches'} of the target “{configuration.target.name}”, recorded on {days} by "
        f"{configuration.operator} with the camera {evaluation.calibration.state.camera.model}, the lens "
        f"{configuration.lens.model} at f/{configuration.lens.f_number:g} and the luminance meter {meter.model}, in "
        f"light of the spectrum {configuration.source.spectrum}."
    )


def simulated(evaluation: SessionEvaluation) -> str | None:
    """Tell what was simulated; None on a real bench."""
    parts = [printable(part) for part in evaluation.simulated]
    if not parts:
        return None
    return f"Simulated: {listed(parts)}. The numbers show how the measurement works; they are of no real bench."


def results(evaluation: SessionEvaluation) -> list[str]:
    """Tell the result: luminance, contrast, and what the calibration is worth."""
    return [_luminance_result(evaluation), *_guess_result(evaluation), *_contrast_result(evaluation)]


def _luminance_result(evaluation: SessionEvaluation) -> str:
    rows = evaluation.patches
    levels = [row.measured_cd_m2 for row in rows]
    worst = max(rows, key=lambda row: abs(row.deviation_rel))
    widest = 100 * max(row.calibrated.half_width_95_rel for row in rows)
    uncertainty = fixed(widest, decimals(widest, 2))
    return (
        f"The calibrated camera and the luminance meter differ by at most {fixed(100 * abs(worst.deviation_rel), 2)} % "
        f"(patch {printable(worst.region.name)}), from {significant(min(levels), 3)} to {significant(max(levels), 3)} "
        f"cd/m²; the 95 % uncertainty of the camera's luminance is up to {uncertainty} %, the "
        "meter's own scale included."
    )


def _guess_result(evaluation: SessionEvaluation) -> list[str]:
    errors = [
        abs(row.calculated_cd_m2 / row.measured_cd_m2 - 1)
        for row in evaluation.patches
        if row.calculated_cd_m2 is not None
    ]
    if not errors:
        return []
    return [f"With guessed camera parameters and no calibration, they differ by up to {fixed(100 * max(errors), 1)} %."]


def _contrast_result(evaluation: SessionEvaluation) -> list[str]:
    rows = evaluation.contrasts
    if not rows:
        return []
    worst = min(rows, key=lambda row: row.cdp.cdp)
    if len(rows) == 1:
        return [f"The contrast of {_probability(worst)}."]
    return [f"Of the {len(rows)} contrasts, the least probable to be detected is that of {_probability(worst)}."]


def _probability(row: ContrastRow) -> str:
    cdp = fixed(row.cdp.cdp, cdp_decimals(row.cdp))
    names = printable(f"{row.bright} and {row.dark}")
    return f"{percent(row.cdp.contrast)} between {names}, with a probability of {cdp} (95 %: {cdp_interval(row.cdp)})"


def check(evaluation: SessionEvaluation) -> str:
    """Tell whether the deviations between camera and meter are an independent check of the calibration."""
    calibration = evaluation.calibration
    if calibration.provenance.input_sha256 != evaluation.observed.input_sha256:
        return (
            f"The calibration comes from another measurement ({day(calibration.provenance.measured)}), so the "
            "deviations are an independent check of it, but for the scale error of the meter if it is the same one."
        )
    fitted = {row.patch for row in calibration.residuals}
    held_out = [printable(row.region.name) for row in evaluation.patches if row.region.name not in fitted]
    if held_out:
        return (
            f"The deviations of {listed(held_out)}, left out of the calibration, are an independent check of it, but "
            "for the scale error of the meter; the other patches were used to calibrate."
        )
    return (
        "The camera was calibrated with these very readings: the deviations show how well one fit holds for all "
        "patches, and are no independent check. To have one, leave a patch out of the calibration."
    )


def warnings(evaluation: SessionEvaluation) -> list[str]:
    """Collect what the user should know, each once."""
    of_patches = [warning for row in evaluation.patches for warning in row.calibrated.warnings]
    return [printable(warning) for warning in dict.fromkeys([*evaluation.warnings, *of_patches])]


def recorded(evaluation: SessionEvaluation) -> tuple[datetime, datetime]:
    """Time of the first and of the last reading of the meter."""
    times = [reading.timestamp for readings in evaluation.observed.readings.values() for reading in readings]
    return min(times), max(times)


def day(time: datetime) -> str:
    """Write the day, in UTC."""
    return f"{time.astimezone(UTC):%Y-%m-%d}"


def minute(time: datetime) -> str:
    """Write day and time, in UTC."""
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def listed(parts: Sequence[str]) -> str:
    """Write "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
