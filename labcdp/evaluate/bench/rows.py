"""Patches by meter and camera, and the CDP of the contrasts between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import hypot, nan

from ...calibration import AnyCalibration, PatchLuminance
from ...calibration.colour.conversion import luminance_of_planes
from ...calibration.fit_records import Reason
from ...calibration.readings import PatchReading, expanded_of_readings
from ...calibration.setup import MeterScale
from ...calibration.signal import usable
from ...core.errors import CalibrationError, InputError
from ...core.luminance import LuminanceMap
from ...core.result import Finding, warning
from ...core.roi import Roi
from ...metrics import Cdp, ContrastDistribution, contrast_histogram
from ...metrics.pair import bound_of_contrast, evaluate_regions
from ...metrics.region import Bound, RegionPixels, evaluate_region
from ...metrics.uncertainty import LimitVerdict, limit_verdict
from ...session import ContrastConfiguration, FrameRecord, PatchConfiguration
from ..verdict import Verdict, cdp_verdict
from .corrections import photons_per_cd_m2_s, pixel_area_m2
from .observe import ObservedSession, frame_maps
from .recorded import frames_showing


@dataclass(frozen=True)
class PatchRow:
    """A patch by the meter, by guessed parameters, and by the calibrated camera.

    Parameters
    ----------
    patch : PatchConfiguration
        Its name, region and limits.
    reading : PatchReading
        By the meter.
    meter : MeterScale
        The meter, and the error its readings have in common.
    calculated_cd_m2 : float or None
        From guessed camera parameters; None without a guess.
    calibrated : PatchLuminance
        From the calibrated camera.
    bound : {'>', '?', ''}
        Whether the camera's luminance is a bound, as the patch is saturated at every exposure, or not known, as none
        shows it.
    """

    patch: PatchConfiguration
    reading: PatchReading
    meter: MeterScale
    calculated_cd_m2: float | None
    calibrated: PatchLuminance
    bound: Bound = ""

    @property
    def region(self) -> Roi:
        """Where it is in the image."""
        return self.patch.region()

    @property
    def U_rel(self) -> float:  # noqa: N802 - the symbol of the GUM
        """Relative expanded uncertainty U (95 %) by the camera; nan for a bound."""
        return nan if self.bound else self.calibrated.U_rel

    @property
    def interval_95_cd_m2(self) -> tuple[float, float]:
        """Ends of the 95 % interval by the camera; nan for a bound."""
        return (nan, nan) if self.bound else self.calibrated.interval_95_cd_m2

    @property
    def limit_verdict(self) -> LimitVerdict | None:
        """Whether the luminance by the camera is within the limits of the plan; None without limits."""
        seen, limits = self.calibrated, self.patch.limits_cd_m2
        if limits is None:
            return None
        if self.bound:
            return "fail" if seen.luminance_cd_m2 > limits[1] else "undecided"
        return limit_verdict(seen.luminance_cd_m2, self.U_rel * seen.luminance_cd_m2, limits)

    def doubted(self, deviation_rel: float) -> PatchRow:
        """Return it with a luminance as uncertain as it deviates."""
        random_rel = hypot(self.calibrated.random_rel, deviation_rel)
        return replace(self, calibrated=replace(self.calibrated, random_rel=random_rel))

    @property
    def deviation_rel(self) -> float:
        """Relative deviation of the camera from the meter."""
        if self.bound:
            return nan
        return self.calibrated.luminance_cd_m2 / self.reading.luminance_cd_m2 - 1


def patch_row(patch: PatchConfiguration, observed: ObservedSession, calibration: AnyCalibration) -> PatchRow:
    """Evaluate a patch; raises CalibrationError if it reads 0."""
    calculated, bound = _calculated_cd_m2(observed, patch.name), _bound(observed, calibration, patch.name)
    if bound:
        seen = _bounded(observed, calibration, patch, bound)
    else:
        planes = {plane: patches[patch.name] for plane, patches in observed.patches_by_plane.items()}
        seen = luminance_of_planes(calibration, planes)
    return PatchRow(patch, read_patch(observed, patch.name), observed.meter_scale, calculated, seen, bound)


def _bound(observed: ObservedSession, calibration: AnyCalibration, name: str) -> Bound:
    """Whether no exposure gives the luminance of a patch: ">" if all are saturated, else "?"."""
    reasons: set[Reason] = set()
    for plane in calibration.planes:
        seen = observed.patches_by_plane[plane.state.plane][name]
        kept, left_out, _ = usable([o.saturating_at(plane.state.saturation_dn) for o in seen], plane.settings)
        reasons |= set() if kept else {left.reason for left in left_out}
    return "" if not reasons else ">" if reasons == {"saturated"} else "?"


def _bounded(
    observed: ObservedSession, calibration: AnyCalibration, patch: PatchConfiguration, bound: Bound
) -> PatchLuminance:
    """Return the luminance from which the shortest exposure is saturated; nan if that is not the reason."""
    name, at_least = patch.name, nan
    if bound == ">":
        shortest_s = min(o.exposure_s for o in observed.observations(name))
        record = frames_showing(observed.session, shortest_s, [name])[name]
        at_least = evaluate_region(frame_maps(observed, calibration)(record), patch.region()).mean
        finding = warning("patch-saturated-everywhere", name, luminance_cd_m2=at_least, exposure_s=shortest_s)
    else:
        finding = warning("patch-not-seen", name)
    return PatchLuminance(name, at_least, nan, (), (), (finding,))


def read_patch(observed: ObservedSession, name: str) -> PatchReading:
    """Return a patch by the meter; raises CalibrationError if it has no reading, or one of 0."""
    measured = observed.by_meter.get(name)
    if measured is None:
        raise CalibrationError(f"patch {name!r} has no meter reading: measure it, or leave the patch out")
    if measured.luminance_cd_m2 == 0:
        raise CalibrationError(f"patch {name!r} reads 0 cd/m², below the meter's range: leave it out")
    return measured


def _calculated_cd_m2(observed: ObservedSession, name: str) -> float | None:
    """Luminance by guessed parameters of the camera, without any uncertainty to state; None without them.

    The electrons of a pixel are L t QE p^2 tau pi / (4 N^2) times the photons per cd/m^2 of the spectrum (the 2018
    thesis' equation 3.1 and its sensor, solved for the luminance; the thesis' program multiplies where it must divide).
    """
    guess = observed.configuration.guess
    # A guess is of one responsivity: for colour filters it says nothing.
    if guess is None or None not in observed.patches_by_plane:
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


@dataclass(frozen=True)
class ContrastRow:
    """Detection probability of the contrast between two patches, in one frame.

    Parameters
    ----------
    target : ContrastConfiguration
        Names of the patches, and what counts as detected.
    bright, dark : PatchRow
        The patches; the scale errors of meter and fit cancel in their contrasts.
    cdp : Cdp
        At the target contrast, with what pixels and calibration leave uncertain.
    distribution : ContrastDistribution or None
        Of all pairs of pixels, for plots; None if no contrast is finite.
    exposure_s : float
        Exposure of the frame.
    frame_number, dark_frame_number : int
        Numbers of the frames in the session with the bright and the dark patch: one frame, unless patches were
        shown one by one.
    findings : tuple of Finding
        On single saturated pixels in that frame; what is said of a whole patch is with the patch.
    """

    target: ContrastConfiguration
    bright: PatchRow
    dark: PatchRow
    cdp: Cdp[float]
    distribution: ContrastDistribution | None
    exposure_s: float
    frame_number: int
    dark_frame_number: int
    findings: tuple[Finding, ...] = ()

    @property
    def bound(self) -> Bound:
        """Whether the contrast by the camera is larger or smaller than `camera_contrast`, or not known."""
        bounds = self.bright.bound, self.dark.bound
        return "?" if "?" in bounds else bound_of_contrast(bounds[0] == ">", bounds[1] == ">")

    @property
    def name(self) -> str:
        """Names of both patches."""
        return f"{self.target.bright} / {self.target.dark}"

    @property
    def measured_contrast(self) -> float:
        """Weber contrast by the meter."""
        return self.bright.reading.luminance_cd_m2 / self.dark.reading.luminance_cd_m2 - 1

    @property
    def measured_contrast_expanded(self) -> float:
        """U (95 %) of that; the meter's scale cancels."""
        return (1 + self.measured_contrast) * expanded_of_readings([self.bright.reading, self.dark.reading])

    @property
    def camera_contrast(self) -> float:
        """Weber contrast of the calibrated patch luminances."""
        return self.bright.calibrated.luminance_cd_m2 / self.dark.calibrated.luminance_cd_m2 - 1

    @property
    def verdict(self) -> Verdict:
        """Whether the contrast is detected: undecided if the interval of the CDP includes the limit."""
        if ">" in (self.bright.bound, self.dark.bound):
            return "saturated"
        return cdp_verdict(self.cdp.cdp, self.cdp.interval, self.target.cdp_limit)


def contrast_row(
    observed: ObservedSession,
    calibration: AnyCalibration,
    maps: Callable[[FrameRecord], LuminanceMap],
    pair: ContrastConfiguration,
    patches: Mapping[str, PatchRow],
) -> ContrastRow:
    """Evaluate a pair of patches in its longest exposure without saturated pixels, else in the shortest.

    Of a saturated patch there is no CDP.

    Parameters
    ----------
    observed : ObservedSession
        The session.
    calibration : Calibration or ColourCalibration
        Of the camera.
    maps : callable
        From `frame_maps`, with this calibration.
    pair : ContrastConfiguration
        The patches, and what counts as detected.
    patches : mapping of str to PatchRow
        Patches by their names.
    """
    bright, dark = patches[pair.bright], patches[pair.dark]
    exposure_s = observed.longest_unsaturated_s(calibration, pair.bright, pair.dark)
    clipped = exposure_s is None and not (bright.bound or dark.bound)
    if exposure_s is None:
        exposure_s = min(o.exposure_s for name in (pair.bright, pair.dark) for o in observed.observations(name))
    shown = frames_showing(observed.session, exposure_s, (pair.bright, pair.dark))
    of_bright, of_dark = (RegionPixels.from_map(maps(shown[row.patch.name]), row.region) for row in (bright, dark))
    both = evaluate_regions(of_bright, of_dark, (pair.contrast,), pair.epsilon)
    (cdp,) = both.cdp
    numbers = shown[pair.bright].number, shown[pair.dark].number
    of_frames = exposure_s, *numbers, both.findings if clipped else ()
    if both.bound:
        return ContrastRow(pair, bright, dark, cdp, None, *of_frames)
    if cdp.swapped:
        raise InputError(f"patch {pair.bright!r} is darker than {pair.dark!r}: give the brighter one as bright")
    distribution = contrast_histogram(of_bright.distribution, of_dark.distribution, cdp.detected_range.high)
    return ContrastRow(pair, bright, dark, cdp, distribution, *of_frames)
