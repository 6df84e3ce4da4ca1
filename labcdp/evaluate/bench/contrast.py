"""The CDP of the contrast between two patches of a session."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot
from typing import Literal

from ...calibration import AnyCalibration, contrast_half_width_95, contrast_uncertainty
from ...core.errors import CalibrationError, InputError
from ...metrics import CalibratedCdp, CdpResult, ContrastDistribution, contrast_histogram
from ...metrics.regions.pair import evaluate_regions
from ...metrics.regions.region import RegionPixels
from ...session import ContrastConfiguration, Session
from .observe import ObservedSession
from .patch import PatchRow
from .recorded import by_exposure, shows

Verdict = Literal["detected", "not detected", "undecided"]


@dataclass(frozen=True)
class ContrastRow:
    """Detection probability of the contrast between two patches, in one frame.

    Parameters
    ----------
    bright, dark : str
        The patches.
    calibrated_cdp : CalibratedCdp
        At the target contrast, with what pixels and calibration leave uncertain.
    distribution : ContrastDistribution or None
        Of all pairs of pixels, for plots; None if no contrast is finite.
    measured_contrast, measured_standard_uncertainty : float
        Weber contrast by the meter; its scale error cancels.
    camera_contrast, camera_standard_uncertainty, camera_half_width_95 : float
        Weber contrast of the calibrated patch luminances; scale and fit cancel. The last is U (95 %).
    exposure_s : float
        Exposure of the frame.
    cdp_limit : float
        CDP from which the contrast counts as detected.
    frame_number, dark_frame_number : int
        Numbers of the frames in the session with the bright and the dark patch: one frame, unless patches were
        shown one by one.
    """

    bright: str
    dark: str
    calibrated_cdp: CalibratedCdp[CdpResult]
    distribution: ContrastDistribution | None
    measured_contrast: float
    measured_standard_uncertainty: float
    camera_contrast: float
    camera_standard_uncertainty: float
    camera_half_width_95: float
    exposure_s: float
    cdp_limit: float
    frame_number: int
    dark_frame_number: int

    @property
    def cdp(self) -> CdpResult:
        """CDP with its 95 % interval by pixels and calibration; its standard error is by the pixels alone."""
        both = self.calibrated_cdp
        return replace(both.result, confidence_interval=both.confidence_interval)

    @property
    def verdict(self) -> Verdict:
        """Whether the contrast is detected: undecided if the interval of the CDP includes the limit."""
        low, high = self.cdp.confidence_interval
        if low < self.cdp_limit <= high:
            return "undecided"
        return "detected" if self.cdp.cdp >= self.cdp_limit else "not detected"


def contrast_row(
    session: Session,
    observed: ObservedSession,
    calibration: AnyCalibration,
    pair: ContrastConfiguration,
    bright: PatchRow,
    dark: PatchRow,
) -> ContrastRow:
    """Evaluate a pair in its longest exposure without saturated pixels; raises CalibrationError if there is none."""
    exposure_s = observed.longest_unsaturated_s(calibration, pair.bright, pair.dark)
    if exposure_s is None:
        raise CalibrationError(
            f"patch {pair.bright!r} or {pair.dark!r} has saturated pixels at every exposure: acquire a shorter one"
        )
    records = by_exposure(session, "light")[exposure_s]
    bright_record, dark_record = (next(r for r in records if shows(r, name)) for name in (pair.bright, pair.dark))
    seen = {
        record.number: calibration.to_luminance(session.load(record))
        for record in {r.number: r for r in (bright_record, dark_record)}.values()
    }
    bright_map, dark_map = seen[bright_record.number], seen[dark_record.number]
    regions = RegionPixels.of(bright_map, bright.region), RegionPixels.of(dark_map, dark.region)
    evaluated = evaluate_regions(*regions, (pair.contrast,), pair.epsilon)
    (result,) = evaluated.results
    a, b = (region.distribution for region in regions)
    if result.result.bright == "b":
        raise InputError(f"patch {pair.bright!r} is darker than {pair.dark!r}: give the brighter one as bright")
    measured, camera = (
        _ratio_less_one(bright.measured_cd_m2, dark.measured_cd_m2),
        _ratio_less_one(bright.calibrated.luminance_cd_m2, dark.calibrated.luminance_cd_m2),
    )
    measured_rel = [row.measured_random_rel for row in (bright, dark)]
    return ContrastRow(
        bright=pair.bright,
        dark=pair.dark,
        calibrated_cdp=result,
        distribution=contrast_histogram(a, b, result.result.interval[1]),
        measured_contrast=measured,
        measured_standard_uncertainty=(1 + measured) * hypot(*measured_rel),
        camera_contrast=camera,
        camera_standard_uncertainty=contrast_uncertainty(bright.calibrated, dark.calibrated),
        camera_half_width_95=contrast_half_width_95(bright.calibrated, dark.calibrated),
        exposure_s=exposure_s,
        cdp_limit=pair.cdp_limit,
        frame_number=bright_record.number,
        dark_frame_number=dark_record.number,
    )


def _ratio_less_one(bright: float, dark: float) -> float:
    return bright / dark - 1
