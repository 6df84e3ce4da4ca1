"""What a calibration says in plain words: what it can be used for, how well, and what to mind."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..calibration import Calibration
from .calibration_budget import PATCH_PIXELS, budgets
from .digits import exposure, fixed, printable, significant
from .wording import day, listed

if TYPE_CHECKING:
    from ..calibration import AnyCalibration, ColourCalibration


def purpose(calibration: AnyCalibration) -> str:
    """Tell what the calibration can be used for."""
    low, high = calibration.range_cd_m2
    shortest, longest = calibration.exposures_s[0], calibration.exposures_s[-1]
    others = calibration.gains if isinstance(calibration, Calibration) else ()
    gains = sorted([calibration.state.gain_db, *(gain.gain_db for gain in others)])
    lens = calibration.lens
    plane = f" (plane {calibration.state.plane})" if calibration.state.plane else ""
    times = exposure(shortest) if shortest == longest else f"{exposure(shortest)} to {exposure(longest)}"
    return printable(
        f"With this calibration the camera {calibration.state.camera.model}{plane} with the lens {lens.model} at "
        f"f/{lens.f_number:g} measures luminance from {significant(low, 2)} to {significant(high, 2)} cd/m², at "
        f"exposures of {times} and a gain of {listed([f'{gain:g}' for gain in gains])} dB, in light of the "
        f"spectrum {calibration.source_spectrum}. It was measured on {day(calibration.provenance.measured)}."
    )


def quality_of_combination(colour: ColourCalibration) -> str:
    """Tell how well the combination of colour planes agrees with the meter, and what colour costs."""
    worst = max(colour.residuals, key=lambda row: abs(row.residual_rel))
    n = len(colour.residuals)
    of_colour = (
        f"A coloured patch is known less well than a grey one: by {significant(100 * colour.spectral_rel, 2)} % "
        "(standard) where its colours differ as much as their mean, since no sum of the filters is V(λ)"
        if colour.spectral_rel > 0
        else "The colours of the patches make no difference that can be seen"
    )
    widths = [f"± {significant(100 * one.whole.expanded_95_rel, 2)} %" for one in budgets(colour)]
    return printable(
        f"The mean over a grey patch of {PATCH_PIXELS} pixels in the middle of the image, without light from beside it "
        f"(glare), is known to {widths[0]} at the lowest, {widths[1]} at a middle and {widths[2]} at the highest of "
        "these luminances (95 %). "
        f"Camera and meter differ by up to {fixed(100 * abs(worst.residual_rel), 2)} % on the {n} patches (patch "
        f"{worst.patch}, by a fit without it){_held_out(colour)}. {of_colour}. The scale of the meter, which may be "
        f"wrong by up to ± {100 * colour.meter_scale.half_width_rel:g} %, is part of each luminance, but contrasts do "
        "not depend on it."
    )


def quality(calibration: Calibration) -> str:
    """Tell how well luminances and contrasts are known."""
    n = len(calibration.residuals)
    widths = [100 * one.whole.expanded_95_rel for one in budgets(calibration)]
    scale = 100 * calibration.meter_scale.half_width_rel
    worst = max(calibration.residuals, key=lambda row: abs(row.residual_rel))
    return printable(
        f"The mean over a patch of {PATCH_PIXELS} pixels in the middle of the image, without light from beside it "
        f"(glare), is known to ± {significant(widths[0], 2)} % at the lowest, "
        f"± {significant(widths[1], 2)} % at a middle and ± {significant(widths[2], 2)} % at the highest of these "
        f"luminances (95 %). The scale of the meter, which may be wrong by up to ± {scale:g} %, is part of that, but "
        f"contrasts do not depend on it. Camera and meter differ by up to {fixed(100 * abs(worst.residual_rel), 2)} % "
        f"on the {n} patches of the fit (patch {worst.patch}){_held_out(calibration)}."
    )


def _held_out(calibration: AnyCalibration) -> str:
    if not calibration.held_out:
        return "; no patch was held out to test it"
    worst = max(calibration.held_out, key=lambda row: abs(row.residual_rel))
    n = len(calibration.held_out)
    patches = "1 patch" if n == 1 else f"{n} patches"
    return f", and by up to {fixed(100 * abs(worst.residual_rel), 2)} % on {patches} that the fit was not shown"


def cautions(calibration: AnyCalibration) -> list[str]:
    """Tell what to mind, beside the warnings."""
    tests = calibration.tests if isinstance(calibration, Calibration) else ()
    failed = [test for test in tests if test.significant]
    texts = [f"Test of {test.name}: {test.meaning}" for test in failed]
    if calibration.left_out:
        n = len(calibration.left_out)
        texts.append(f"The fit leaves out {n} {'item' if n == 1 else 'items'}: see below.")
    texts.append(
        "A lens of another focal length, f-number or focus, a filter or a window before the lens needs a calibration "
        "of its own; a camera without a V(λ) filter needs one for each kind of light."
    )
    return [printable(text) for text in texts]


def simulated(calibration: Calibration) -> str:
    """Tell what was simulated; empty on a real bench."""
    camera, meter = calibration.state.camera, calibration.meter_scale.meter
    parts = [f"camera {camera.model}"] if camera.simulated else []
    parts += [f"luminance meter {meter.model}"] if meter.simulated else []
    if not parts:
        return ""
    return printable(f"Simulated: {listed([*parts, 'target'])}. The numbers are of no real camera.")
