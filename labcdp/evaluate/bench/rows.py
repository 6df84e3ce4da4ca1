"""Patches by meter and camera, and the CDP of the contrasts between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot
from typing import Literal

from ...calibration import AnyCalibration, PatchLuminance, contrast_half_width_95, contrast_uncertainty
from ...calibration.colour.conversion import luminance_of_planes
from ...calibration.readings import combine_readings
from ...calibration.setup import MeterScale
from ...calibration.uncertainty import expanded_rel
from ...core.errors import CalibrationError, InputError
from ...core.roi import Roi
from ...metrics import CalibratedCdp, CdpResult, ContrastDistribution, contrast_histogram
from ...metrics.pair import evaluate_regions
from ...metrics.region import RegionPixels
from ...metrics.uncertainty import LimitVerdict, limit_verdict
from ...session import ContrastConfiguration, Session
from .corrections import photons_per_cd_m2_s, pixel_area_m2
from .observe import ObservedSession
from .recorded import maps_of


@dataclass(frozen=True)
class PatchRow:
    """A patch by the meter, by guessed parameters, and by the calibrated camera.

    Parameters
    ----------
    region : Roi
        Where it is in the image.
    measured_cd_m2, measured_random_rel : float
        Mean of the meter's readings, and its relative standard uncertainty without the scale.
    meter : MeterScale
        The meter, and the error its readings have in common.
    n_readings : int
        Number of readings.
    calculated_cd_m2 : float or None
        From guessed camera parameters; None without a guess.
    calibrated : PatchLuminance
        By the calibrated camera.
    limits_cd_m2 : (float, float) or None
        Lowest and highest permitted luminance, if the plan has limits.
    """

    region: Roi
    measured_cd_m2: float
    measured_random_rel: float
    meter: MeterScale
    n_readings: int
    calculated_cd_m2: float | None
    calibrated: PatchLuminance
    limits_cd_m2: tuple[float, float] | None = None

    @property
    def limit_verdict(self) -> LimitVerdict | None:
        """Whether the luminance by the camera is within its limits; None without limits."""
        if self.limits_cd_m2 is None:
            return None
        luminance = self.calibrated.luminance_cd_m2
        return limit_verdict(luminance, self.calibrated.half_width_95_rel * luminance, self.limits_cd_m2)

    @property
    def measured_rel(self) -> float:
        """Relative standard uncertainty of the meter's value, the scale included."""
        return hypot(self.measured_random_rel, self.meter.common_rel)

    @property
    def measured_half_width_95_rel(self) -> float:
        """Relative U (95 %) of the meter's value, the scale included."""
        return expanded_rel([self.meter], self.measured_random_rel)

    @property
    def deviation_rel(self) -> float:
        """Relative deviation of the camera from the meter."""
        return self.calibrated.luminance_cd_m2 / self.measured_cd_m2 - 1


def patch_row(name: str, observed: ObservedSession, calibration: AnyCalibration) -> PatchRow:
    """Evaluate a patch; raises CalibrationError if it reads 0, or is saturated or black at every exposure."""
    measured, _ = combine_readings(name, observed.readings.get(name, []))
    if measured.luminance_cd_m2 == 0:
        raise CalibrationError(f"patch {name!r} reads 0 cd/m², below the meter's range: leave it out")
    patch = next(p for p in observed.configuration.target.patches if p.name == name)
    return PatchRow(
        region=patch.region(),
        limits_cd_m2=patch.limits_cd_m2,
        measured_cd_m2=measured.luminance_cd_m2,
        measured_random_rel=measured.random_cd_m2 / measured.luminance_cd_m2,
        meter=observed.meter_scale,
        n_readings=measured.n_readings,
        calculated_cd_m2=_calculated_cd_m2(observed, name),
        calibrated=luminance_of_planes(
            calibration, {plane or "": seen.patches[name] for plane, seen in observed.planes.items()}
        ),
    )


def _calculated_cd_m2(observed: ObservedSession, name: str) -> float | None:
    """Luminance by guessed parameters of the camera, without any uncertainty to state; None without them.

    The electrons of a pixel are L t QE p^2 tau pi / (4 N^2) times the photons per cd/m^2 of the spectrum (the 2018
    thesis' equation 3.1 and its sensor, solved for the luminance; the thesis' program multiplies where it must divide).
    """
    guess = observed.configuration.guess
    # A guess is of one responsivity: for colour filters it says nothing.
    if guess is None or None not in observed.planes:
        return None
    unsaturated = [o for o in observed.patches[name] if o.saturated_share == 0]
    if not unsaturated:
        return None
    o = max(unsaturated, key=lambda o: o.exposure_s)
    # K is taken to be for 0 dB.
    k_dn_per_e = guess.k_dn_per_e * 10 ** (o.state.gain_db / 20)
    area_m2 = pixel_area_m2(guess.pixel_pitch_m, o.state.readout)
    spectrum = observed.configuration.source.spectrum
    photons = photons_per_cd_m2_s(spectrum, guess.f_number, guess.transmittance, area_m2)
    responsivity = photons * guess.quantum_efficiency * k_dn_per_e
    return o.net_dn(guess.dark_dn) / (responsivity * o.exposure_s)


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
    seen = maps_of(session, calibration, exposure_s, (pair.bright, pair.dark))
    (bright_number, bright_map), (dark_number, dark_map) = seen[pair.bright], seen[pair.dark]
    regions = RegionPixels.of(bright_map, bright.region), RegionPixels.of(dark_map, dark.region)
    (result,) = evaluate_regions(*regions, (pair.contrast,), pair.epsilon).results
    a, b = (region.distribution for region in regions)
    if result.result.bright == "b":
        raise InputError(f"patch {pair.bright!r} is darker than {pair.dark!r}: give the brighter one as bright")
    measured = bright.measured_cd_m2 / dark.measured_cd_m2 - 1
    return ContrastRow(
        bright=pair.bright,
        dark=pair.dark,
        calibrated_cdp=result,
        distribution=contrast_histogram(a, b, result.result.interval[1]),
        measured_contrast=measured,
        measured_standard_uncertainty=(1 + measured) * hypot(bright.measured_random_rel, dark.measured_random_rel),
        camera_contrast=bright.calibrated.luminance_cd_m2 / dark.calibrated.luminance_cd_m2 - 1,
        camera_standard_uncertainty=contrast_uncertainty(bright.calibrated, dark.calibrated),
        camera_half_width_95=contrast_half_width_95(bright.calibrated, dark.calibrated),
        exposure_s=exposure_s,
        cdp_limit=pair.cdp_limit,
        frame_number=bright_number,
        dark_frame_number=dark_number,
    )
