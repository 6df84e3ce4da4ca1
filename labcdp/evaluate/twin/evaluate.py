"""Compare the twin of a camera with the measurement: CDP of each pair of patches, signal of each patch."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

from ...calibration import AnyCalibration, Calibration
from ...calibration.emva.result import Characterisation
from ...core.errors import CalibrationError
from ...core.result import Finding, info, warning
from ...metrics.contrast import TargetContrasts, checked_contrast, each_contrast
from ...report.text import finding_text
from ..bench.observe import ObservedSession
from ..bench.session import mismatch
from .estimate import require_monochrome, twin_parameters
from .pair import PairRequest, TwinJudgement, TwinPair, compare_pair
from .parameters import TwinParameters
from .prediction import TwinRegion, predict_regions
from .regions import TwinPatch, regions_of, seen_regions, twin_patch

#: Fewest patches that can be compared.
_PAIR = 2
#: Least Weber contrast, by the meter, of pairs that are compared by default.
LEAST_CONTRAST = 0.1
#: Pairs that are not compared, by the code of the finding that says why.
_LeftOut: TypeAlias = dict[str, list[tuple[str, str]]]
#: Reasons that need no action.
_HARMLESS = ("pairs-alike", "pairs-without-patch")


@dataclass(frozen=True, eq=False)
class TwinEvaluation:
    """A camera, its twin, and their comparison.

    Parameters
    ----------
    observed : ObservedSession
        The session.
    calibration : Calibration
        Calibration that converted the frames to luminance.
    parameters : TwinParameters
        The twin.
    regions : tuple of TwinRegion
        The patches, with luminances by the meter.
    pairs : tuple of TwinPair
        Pairs of patches, those of the configuration first.
    patches : tuple of TwinPatch
        Each patch's signal in the longest exposure that does not saturate it.
    findings : tuple of Finding
        Findings on comparisons not made, limits of the twin, and the calibration.
    contrasts : tuple of float
        Several contrasts to be detected that all pairs were compared at; empty for one, or that of each pair.
    """

    observed: ObservedSession
    calibration: Calibration
    parameters: TwinParameters
    regions: tuple[TwinRegion, ...]
    pairs: tuple[TwinPair, ...]
    patches: tuple[TwinPatch, ...]
    findings: tuple[Finding, ...]
    contrasts: tuple[float, ...] = ()

    def by_contrast(self) -> list[list[TwinPair]]:
        """Return the pairs at each of several contrasts, and all others."""
        groups = [[pair for pair in self.pairs if pair.contrast == contrast] for contrast in self.contrasts]
        rest = [pair for pair in self.pairs if pair.contrast not in self.contrasts]
        return [*groups, rest] if rest else groups

    def count(self, judgement: TwinJudgement) -> int:
        """Return the number of pairs of a judgement."""
        return sum(pair.judgement == judgement for pair in self.pairs)


def twin_session(
    observed: ObservedSession,
    calibration: AnyCalibration,
    characterisation: Characterisation,
    contrast: TargetContrasts = None,
    epsilon: float = 0.5,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> TwinEvaluation:
    """Make the twin of a session's camera, and compare what it predicts with what was measured.

    Parameters
    ----------
    observed : ObservedSession
        What `observe_session` returned for it.
    calibration, characterisation : Calibration, Characterisation
        Of this camera and its settings.
    contrast, epsilon : float, tuple of float or None; float
        Weber contrasts to be detected between all pairs of patches from `LEAST_CONTRAST` by the meter on, fractions,
        with their tolerance; None for each pair's own. Pairs of the configuration are compared at theirs as well.
    report : callable
        Called with the number of exposures done, and of all.

    Raises
    ------
    CalibrationError
        If the camera has colour filters, K cannot be known, or no two patches can be compared.
    InputError
        If contrast or epsilon is out of range.
    """
    first = require_monochrome(observed.session)
    if not isinstance(calibration, Calibration):
        raise CalibrationError("the calibration is for a camera with colour filters: give that of this camera")
    mismatches = mismatch(observed.configuration, calibration)
    twin = twin_parameters(observed, calibration, characterisation)
    regions = regions_of(observed, calibration, twin, calibration.to_luminance(first).slow_rel)
    if len(regions) < _PAIR:
        raise CalibrationError(
            f"a twin is compared using pairs of patches, but {len(regions) or 'none'} is left: leave out fewer patches"
        )
    usable = [o for name in regions for o in observed.patches[name] if o.saturated_share == 0]
    longest = {o.patch: o for o in sorted(usable, key=lambda o: o.exposure_s)}
    left_out: _LeftOut = defaultdict(list)
    requests = _pair_requests(
        observed, {name: region.luminance_cd_m2 for name, region in regions.items()}, contrast, epsilon, left_out
    )
    compared = _compared(observed, calibration, twin, regions, requests, left_out, report)
    omitted = list(_findings(left_out))
    if not compared:
        raise CalibrationError(f"no two patches can be compared: {'; '.join(map(finding_text, omitted))}")
    warnings = [finding for finding in calibration.findings if finding.severity != "info"]
    corrected = _correction_findings(twin, {o.exposure_s for o in usable})
    response = calibration.response
    return TwinEvaluation(
        observed=observed,
        calibration=calibration,
        parameters=twin,
        regions=tuple(regions.values()),
        pairs=tuple(compared[pair] for pair in requests if pair in compared),
        patches=tuple(twin_patch(twin.at(o.exposure_s), regions[n], o, response) for n, o in longest.items()),
        findings=(*omitted, *mismatches, *corrected, *twin.findings, *warnings),
        contrasts=contrast if isinstance(contrast, tuple) else (),
    )


def _pair_requests(
    observed: ObservedSession, level: dict[str, float], contrast: TargetContrasts, epsilon: float, left_out: _LeftOut
) -> list[PairRequest]:
    """Return the pairs to compare, those of the configuration first; pairs that cannot be compared go to `left_out`."""
    for target in each_contrast(contrast):
        checked_contrast(LEAST_CONTRAST if target is None else target, epsilon)
    requests: list[PairRequest] = []
    for pair in observed.configuration.contrasts:
        if pair.bright not in level or pair.dark not in level:
            left_out["pairs-without-patch"].append((pair.bright, pair.dark))
        elif (contrast_of_means := level[pair.bright] / level[pair.dark] - 1) <= 0:
            left_out["pairs-reversed"].append((pair.bright, pair.dark))
        else:
            requests.append(PairRequest(pair.bright, pair.dark, pair.contrast, pair.epsilon, contrast_of_means))
    for dark, bright in combinations(sorted(level, key=lambda name: level[name]), 2):
        contrast_of_means = level[bright] / level[dark] - 1
        values = (round(contrast_of_means, 4) if target is None else target for target in each_contrast(contrast))
        if contrast_of_means < LEAST_CONTRAST:
            left_out["pairs-alike"].append((bright, dark))
        else:
            requests += [PairRequest(bright, dark, value, epsilon, contrast_of_means) for value in values]
    return list(dict.fromkeys(requests))


def _compared(
    observed: ObservedSession,
    calibration: Calibration,
    twin: TwinParameters,
    regions: Mapping[str, TwinRegion],
    requested: Sequence[PairRequest],
    left_out: _LeftOut,
    report: Callable[[int, int], None],
) -> dict[PairRequest, TwinPair]:
    """Compare each pair in the longest exposure that saturates neither patch; add those without one to `left_out`."""
    at: dict[float, list[PairRequest]] = {}
    for pair in requested:
        exposure_s = observed.longest_unsaturated_s(calibration, pair.bright, pair.dark)
        if exposure_s is None:
            left_out["pairs-saturated"].append((pair.bright, pair.dark))
        else:
            at.setdefault(exposure_s, []).append(pair)
    compared: dict[PairRequest, TwinPair] = {}
    for done, (exposure_s, group) in enumerate(sorted(at.items())):
        report(done, len(at))
        names = {name for pair in group for name in (pair.bright, pair.dark)}
        seen = seen_regions(observed, calibration, exposure_s, names)
        shown = [regions[name] for name in regions if name in names]
        predicted = predict_regions(twin.at(exposure_s), shown, exposure_s, calibration.response)
        for pair in group:
            both = seen[pair.bright], seen[pair.dark]
            if max(region.luminance_cd_m2.max() for region in both) <= 0:
                left_out["pairs-not-above-zero"].append((pair.bright, pair.dark))
            else:
                compared[pair] = compare_pair(pair, both, (predicted[pair.bright], predicted[pair.dark]))
    report(len(at), len(at))
    return compared


def _findings(left_out: _LeftOut) -> Iterator[Finding]:
    """Yield a finding for each reason for omitting pairs."""
    for code, pairs in left_out.items():
        names = [f"{bright} / {dark}" for bright, dark in dict.fromkeys(pairs)]
        finding = info if code in _HARMLESS else warning
        yield finding(code, n_pairs=len(names), example=names[0], pairs=names, least_contrast=LEAST_CONTRAST)


def _correction_findings(twin: TwinParameters, exposures_s: Collection[float]) -> Iterator[Finding]:
    """Yield findings about corrections that replace DSNU and PRNU."""
    corrected_s = [t for t in sorted(exposures_s) if twin.takes_pattern_off(t)]
    if corrected_s:
        yield info("twin-dark-library", exposures_s=corrected_s)
    if twin.flat_field is not None:
        yield info("twin-flat-field")
