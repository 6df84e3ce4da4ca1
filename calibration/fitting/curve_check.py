"""Whether the curve that is stated of companded values makes them proportional to light, or another one would."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ...core.companding import Companding, shipped_curve, shipped_curves
from ...core.dn import Response
from ...core.errors import CalibrationError
from ...core.reading import Reading
from ...core.result import Finding, warning
from ..frames.observations import CameraState, DarkObservation, Groups, PatchObservation
from ..frames.statistics import MAX_CLIPPED_SHARE
from .design import Array

#: Relative deviation from proportionality (root mean square) from which another curve is tried: several times that of
#: cameras whose curve is right, a judgement.
_DEVIATES_REL = 0.03
#: Ratio of deviations below which another curve is clearly better; what single bad readings add is in both.
_BETTER = 1 / 3
#: Standard deviations of its mean above dark from which a patch says how the values grow.
_CLEAR = 20.0
#: Fewest observations that say so.
_LEAST = 4


@dataclass(frozen=True)
class BetterCurve:
    """What makes values proportional to light where the curve that is stated does not.

    Parameters
    ----------
    curve : Companding or None
        A curve that ships with labcdp; None for values as they are.
    deviation_rel, stated_rel : float
        Relative deviation from proportionality, root mean square over patches and exposures, by it and as stated.
    stated : str
        Name of the curve that is stated; empty for none.
    """

    curve: Companding | None
    deviation_rel: float
    stated_rel: float
    stated: str

    @property
    def finding(self) -> Finding:
        """The finding."""
        if self.curve is None:
            return warning("curve-needless", self.stated, deviation_rel=self.stated_rel, other_rel=self.deviation_rel)
        return warning(
            "curve-wrong" if self.stated else "curve-not-stated",
            self.stated,
            deviation_rel=self.stated_rel,
            other=self.curve.name,
            other_rel=self.deviation_rel,
            shift=self.curve.shift,
        )

    def error(self) -> CalibrationError:
        """Return the error of a calibration that is not possible without it."""
        if self.curve is None:
            return CalibrationError(
                f"the values expanded by the curve {self.stated} deviate from proportion to the readings by "
                f"{self.stated_rel:.0%} (rms), as they are by {self.deviation_rel:.1%}: leave camera.encoding out"
            )
        taken = f"expanded by the curve {self.stated}" if self.stated else "as they are"
        shift = f", shifted up by {self.curve.shift} bits" if self.curve.shift else ""
        return CalibrationError(
            f"the values {taken} deviate from proportion to the readings by {self.stated_rel:.0%} (rms), by the curve "
            f'{self.curve.name}{shift} by {self.deviation_rel:.1%}: state camera.encoding = "{self.curve.name}"'
        )


def better_curve(
    groups: Groups, darks: Sequence[DarkObservation], readings: Mapping[str, Sequence[Reading]]
) -> BetterCurve | None:
    """Find a shipped curve, or none, that fits where the stated one does not.

    With the right curve, the expanded signal above dark over exposure and reading is one number for all patches and
    exposures. The codes of the means are those of the stated curve; for signals that vary little within a patch, as
    those of a target do, they are the mean codes.

    Parameters
    ----------
    groups : mapping of str to sequence of PatchObservation
        By patch.
    darks : sequence of DarkObservation
        Of the same camera.
    readings : mapping of str to sequence of Reading
        Of the same patches.

    Returns
    -------
    BetterCurve or None
        None if the stated one fits, or none fits clearly better.
    """
    seen = [o for name in groups if readings.get(name) for o in groups[name] if _is_clear(o)]
    light = [float(np.mean([reading.value for reading in readings[o.patch]])) for o in seen]
    if len(seen) < _LEAST or not darks or not all(light):
        return None
    state = seen[0].state
    stated = _deviation_rel(seen, darks, light, state.companding)
    if not stated > _DEVIATES_REL:
        return None
    rows = [(_deviation_rel(seen, darks, light, curve), curve) for curve in _other_curves(state)]
    best, curve = min(rows, key=lambda row: row[0])
    if not best < _BETTER * stated:
        return None
    name = "" if state.companding is None else state.companding.name
    return BetterCurve(curve, best, stated, name)


def curve_findings(state: CameraState, response: Response, most_net_dn: float) -> list[Finding]:
    """Find by how much values that a curve expanded deviate from a straight line, if a response describes it.

    Parameters
    ----------
    state : CameraState
        With the curve.
    response : Response
        As fitted.
    most_net_dn : float
        Highest signal above dark of the fit.
    """
    if state.companding is None or response.kind == "linear":
        return []
    net = np.geomspace(max(most_net_dn / 2**state.companding.bits, 1.0), most_net_dn, 256)
    ratio = response.linearise(net) / net
    deviation = ratio / ratio[0] - 1
    at = int(np.argmax(np.abs(deviation)))
    figures = {"deviation_rel": float(deviation[at]), "net_dn": float(net[at])}
    return [warning("curve-disagrees", state.companding.name, **figures)]


def _is_clear(o: PatchObservation) -> bool:
    clipped = max(o.saturated_share, o.black_share) > MAX_CLIPPED_SHARE
    return not clipped and o.net_dn_at_pixel(o.state.nominal_black_dn) > _CLEAR * sqrt(o.mean_variance_dn2)


def _other_curves(state: CameraState) -> Iterator[Companding | None]:
    """Yield the shipped curves, at each place of their codes in the values of a file, and none."""
    if state.companding is not None:
        yield None
    for curve in map(shipped_curve, shipped_curves()):
        for shift in sorted({0, max(state.bit_depth - curve.bits, 0)}):
            if state.companding != (shifted := replace(curve, shift=shift)):
                yield shifted


def _deviation_rel(
    seen: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    light: Sequence[float],
    curve: Companding | None,
) -> float:
    """Relative deviation of the signals by a curve from proportion to light, root mean square; nan if it cannot be."""
    dark_dn = float(np.mean([_expanded(dark.state, np.array([dark.mean_dn]), curve)[0] for dark in darks]))
    means = np.array([o.mean_dn / o.mean_inverse_v for o in seen])
    net = _expanded(seen[0].state, means, curve) - dark_dn
    exposed = np.array([o.exposure_s / o.mean_inverse_v for o in seen]) * np.array(light)
    inside = net > 0
    if np.count_nonzero(inside) < _LEAST:
        return np.nan
    return float(np.std(np.log(net[inside] / exposed[inside])))


def _expanded(state: CameraState, mean_dn: Array, curve: Companding | None) -> Array:
    """Expand means, which the stated curve expanded, by another curve."""
    if curve == state.companding:
        return mean_dn
    codes = mean_dn
    if state.companding is not None:
        by_dn = state.companding.linear_by_dn
        codes = np.interp(mean_dn, by_dn, np.arange(by_dn.size))
    return codes if curve is None else curve.linear(codes / 2.0**curve.shift)
