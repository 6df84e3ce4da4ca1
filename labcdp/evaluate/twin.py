"""The twin of a measured camera against the measurement: CDP of each pair of patches, and each patch's signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from ..calibration import AnyCalibration, Calibration, PatchObservation
from ..calibration.emva.result import Characterisation, Quantity
from ..contrast.interval import AskedContrast
from ..errors import CalibrationError
from ..response import Response
from ..session import Session
from .observe import ObservedSession
from .session import mismatch
from .twin_compare import MendedPrediction, SeenRegion, compare_pair, with_mended
from .twin_corrected import CorrectedTwin
from .twin_diagnosis import Finding, diagnose
from .twin_pair import PairAsked, TwinPair
from .twin_parameters import TwinParameters, require_monochrome, twin_parameters
from .twin_prediction import RegionPrediction, TwinRegion, predict_mended, predict_regions
from .twin_regions import regions_of, seen_regions
from .twin_signal import TwinPatch, longest_exposures, twin_patch

#: Fewest patches that can be compared.
_PAIR = 2
#: Why a pair of the configuration is not compared though nothing is wrong with it.
_NOT_THERE = "one of the two was left out"
#: Reasons that an error tells.
_MOST_REASONS = 2
#: Least Weber contrast, by the meter, of pairs that are compared without being asked for.
LEAST_CONTRAST = 0.1


@dataclass(frozen=True, eq=False)
class TwinResult:
    """A camera, its twin, and how the two compare.

    Parameters
    ----------
    observed : ObservedSession
        The session.
    calibration : Calibration
        What made luminance of the frames.
    parameters : TwinParameters
        The twin.
    left : dict of str to Quantity
        What is compared in place of DSNU and PRNU where the calibration takes these off, by name.
    regions : tuple of TwinRegion
        The patches it was shown, by the meter.
    pairs : tuple of TwinPair
        Pairs of patches, those asked for first.
    patches : tuple of TwinPatch
        Each patch's signal in the longest exposure that does not saturate it.
    findings : tuple of Finding
        Parameters that the signals contradict, the strongest first.
    left_out : tuple of str
        What could not be compared, and why.
    warnings : tuple of str
        What to mind: where calibration and session do not match, and the calibration's own warnings.
    """

    observed: ObservedSession
    calibration: Calibration
    parameters: TwinParameters
    left: Mapping[str, Quantity]
    regions: tuple[TwinRegion, ...]
    pairs: tuple[TwinPair, ...]
    patches: tuple[TwinPatch, ...]
    findings: tuple[Finding, ...]
    left_out: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def agreeing(self) -> int:
        """How many pairs agree."""
        return sum(pair.agrees for pair in self.pairs)

    @property
    def differing(self) -> int:
        """How many pairs differ."""
        return sum(pair.differs for pair in self.pairs)

    @property
    def decided(self) -> int:
        """How many pairs agree or differ; the others are undecided."""
        return self.agreeing + self.differing

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        calibration = self.calibration
        return {
            "session": self.observed.configuration.name,
            "camera": str(calibration.state.camera),
            "simulated": calibration.state.camera.simulated,
            "pairs_compared": len(self.pairs),
            "pairs_agreeing": self.agreeing,
            "pairs_differing": self.differing,
            "pairs_undecided": len(self.pairs) - self.decided,
            "parameters": {name: one.to_dict() for name, one in self.parameters.quantities.items()},
            "left_by_corrections": {name: one.to_dict() for name, one in self.left.items()},
            "findings": [one.to_dict() for one in self.findings],
            "pairs": [pair.to_dict() for pair in self.pairs],
            "patches": [patch.to_dict() for patch in self.patches],
            "notes": list(self.parameters.notes),
            "left_out": list(self.left_out),
            "warnings": list(self.warnings),
            "input_sha256": self.observed.input_sha256,
            "calibration_input_sha256": calibration.provenance.input_sha256,
            "versions": calibration.provenance.versions,
        }


def twin_session(
    session: Session,
    observed: ObservedSession,
    calibration: AnyCalibration,
    characterisation: Characterisation,
    contrast: float | None = None,
    epsilon: float = 0.5,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> TwinResult:
    """Make the twin of a session's camera, and compare what it predicts with what was measured.

    Parameters
    ----------
    session : Session
        To read frames from.
    observed : ObservedSession
        What `observe_session` returned for it.
    calibration : Calibration
        Of this camera and its settings.
    characterisation : Characterisation
        What `characterise_session` returned for it.
    contrast : float or None
        Weber contrast to be detected between all pairs of patches, a fraction; None for each pair's own by the meter.
        Pairs below `LEAST_CONTRAST` by the meter are left out. The pairs of the session's configuration are compared
        at theirs as well.
    epsilon : float
        Tolerance of `contrast`.
    report : callable
        Called with the number of exposures done, and of all.

    Returns
    -------
    TwinResult

    Raises
    ------
    CalibrationError
        If the camera has colour filters, K cannot be known, or no two patches can be compared.
    InputError
        If contrast or epsilon is out of range.
    """
    frame = require_monochrome(session)
    if not isinstance(calibration, Calibration):
        raise CalibrationError("the calibration is for a camera with colour filters: give that of this camera")
    warnings = mismatch(observed.configuration, calibration)
    twin = twin_parameters(session, observed, calibration, characterisation)
    regions = regions_of(observed, calibration, twin, calibration.to_luminance(frame).slow_rel)
    corrected = CorrectedTwin.of(twin, calibration)
    if len(regions) < _PAIR:
        raise CalibrationError(
            f"a twin is compared by pairs of patches, and {len(regions) or 'none'} of them is left: leave fewer out"
        )
    asked, left_out = _asked(observed, regions, contrast, epsilon)
    patches = _patches(observed, calibration, corrected, regions)
    findings = diagnose(corrected, patches, observed.darks)
    exposures_s = [patch.exposure_s for patch in patches]
    at: dict[float, list[PairAsked]] = {}
    for pair in asked:
        exposure_s = _longest_unsaturated(observed, pair)
        if exposure_s is None:
            left_out.append(f"{pair.bright} / {pair.dark}: one of the two is saturated at every exposure")
        else:
            at.setdefault(exposure_s, []).append(pair)
    compared: dict[PairAsked, TwinPair] = {}
    for done, (exposure_s, group) in enumerate(sorted(at.items())):
        report(done, len(at))
        names = {name for pair in group for name in (pair.bright, pair.dark)}
        seen = seen_regions(session, observed, calibration, exposure_s, names)
        shown = [region for region in regions.values() if region.name in names]
        predicted = predict_regions(corrected.at(exposure_s), shown, exposure_s, calibration.response)
        pairs = [found for pair in group if (found := _compared(pair, seen, predicted)) is not None]
        if any(pair.differs for pair in pairs):
            mended = _mended(corrected.at(exposure_s), shown, exposure_s, calibration.response, findings)
            pairs = [with_mended(pair, mended) if pair.differs else pair for pair in pairs]
        compared.update({pair.asked: pair for pair in pairs})
        left_out += [
            f"{pair.bright} / {pair.dark}: no pixel is above 0 cd/m2" for pair in group if pair not in compared
        ]
    report(len(at), len(at))
    if not compared:
        own = [text for text in left_out if not text.endswith(_NOT_THERE)] or left_out
        reasons = "; ".join(own[:_MOST_REASONS])
        raise CalibrationError(f"no two patches can be compared: {reasons}; name other contrasts or other patches")
    return TwinResult(
        observed=observed,
        calibration=calibration,
        parameters=twin,
        left=corrected.left(exposures_s),
        regions=tuple(regions.values()),
        pairs=tuple(compared[pair] for pair in asked if pair in compared),
        patches=tuple(longest_exposures(patches)),
        findings=findings,
        left_out=tuple(left_out),
        warnings=tuple(dict.fromkeys([*warnings, *corrected.notes(exposures_s), *calibration.warnings])),
    )


def _mended(
    twin: TwinParameters,
    regions: Sequence[TwinRegion],
    exposure_s: float,
    response: Response,
    findings: Sequence[Finding],
) -> list[MendedPrediction]:
    """Luminance of the patches with each parameter as the signals ask, and with all of them."""
    groups: list[tuple[Finding, ...]] = [(one,) for one in findings]
    if len(findings) > 1:
        groups.append(tuple(findings))
    return [
        (group, predict_mended(twin, regions, exposure_s, response, [one.mending for one in group])) for group in groups
    ]


def _asked(
    observed: ObservedSession, regions: dict[str, TwinRegion], contrast: float | None, epsilon: float
) -> tuple[list[PairAsked], list[str]]:
    """Pairs to be compared, those of the configuration first; and those too alike."""
    AskedContrast(LEAST_CONTRAST if contrast is None else contrast, epsilon, "weber")
    asked, left_out = [], []
    for pair in observed.configuration.contrasts:
        if pair.bright not in regions or pair.dark not in regions:
            left_out.append(f"{pair.bright} / {pair.dark}: {_NOT_THERE}")
            continue
        own = _contrast(regions, pair.bright, pair.dark)
        if own <= 0:
            left_out.append(f"{pair.bright} / {pair.dark}: the first is not brighter by the meter, turn the two round")
            continue
        asked.append(PairAsked(pair.bright, pair.dark, pair.contrast, pair.epsilon, own))
    for first, second in combinations(regions, 2):
        bright, dark = sorted((first, second), key=lambda name: -regions[name].luminance_cd_m2)
        own = _contrast(regions, bright, dark)
        if own < LEAST_CONTRAST:
            left_out.append(f"{bright} / {dark}: the contrast of {own:.1%} is below {LEAST_CONTRAST:.0%}")
        else:
            asked.append(PairAsked(bright, dark, round(own, 4) if contrast is None else contrast, epsilon, own))
    return list(dict.fromkeys(asked)), left_out


def _contrast(regions: dict[str, TwinRegion], bright: str, dark: str) -> float:
    return regions[bright].luminance_cd_m2 / regions[dark].luminance_cd_m2 - 1


def _longest_unsaturated(observed: ObservedSession, pair: PairAsked) -> float | None:
    at: dict[float, list[PatchObservation]] = {}
    for name in (pair.bright, pair.dark):
        for o in observed.patches[name]:
            at.setdefault(o.exposure_s, []).append(o)
    return max((t for t, group in at.items() if all(o.saturated_share == 0 for o in group)), default=None)


def _compared(pair: PairAsked, seen: dict[str, SeenRegion], predicted: dict[str, RegionPrediction]) -> TwinPair | None:
    bright, dark = seen[pair.bright], seen[pair.dark]
    if max(bright.luminance_cd_m2.max(), dark.luminance_cd_m2.max()) <= 0:
        return None
    return compare_pair(pair, (bright, dark), (predicted[pair.bright], predicted[pair.dark]))


def _patches(
    observed: ObservedSession, calibration: Calibration, corrected: CorrectedTwin, regions: dict[str, TwinRegion]
) -> list[TwinPatch]:
    return [
        twin_patch(corrected.at(o.exposure_s), region, o, calibration.response)
        for name, region in regions.items()
        for o in observed.patches[name]
        if o.saturated_share == 0
    ]
