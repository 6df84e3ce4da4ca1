"""A pair of patches: CDP measured and predicted, their joint interval, and what the difference may come from."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite, sqrt
from typing import Any

from ..contrast import CdpResult

#: 97.5 % quantile of the standard normal distribution.
_Z_95 = 1.959963984540054
#: Name of what the finite number of pixels leaves open.
SAMPLING = "number of pixels"
#: Share of all possible CDPs inside the joint interval from which on a pair decides nothing.
_VACUOUS = 0.8
#: Standard uncertainties by which nobody's parameter is off.
_INCREDIBLE = 5.0


@dataclass(frozen=True)
class PairAsked:
    """A pair to be compared.

    Parameters
    ----------
    bright, dark : str
        The patches.
    contrast, epsilon : float
        Weber contrast to be detected, a fraction, and its tolerance.
    meter_contrast : float
        Weber contrast of the two by the meter.
    """

    bright: str
    dark: str
    contrast: float
    epsilon: float
    meter_contrast: float


@dataclass(frozen=True)
class Influence:
    """What one parameter does to the predicted CDP.

    Parameters
    ----------
    name : str
        The parameter in plain words.
    change : float
        Change of the CDP if it is one standard uncertainty larger.
    standard_uncertainty : float
        Standard uncertainty of the CDP by it: root mean square of the changes to both sides.
    share : float
        Its share in the variance of the difference between measured and predicted.
    shift_to_close : float
        By how many of its standard uncertainties it would have to be off to explain the whole difference; inf if it
        cannot.
    """

    name: str
    change: float
    standard_uncertainty: float
    share: float
    shift_to_close: float

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        return {
            "parameter": self.name,
            "change_per_standard_uncertainty": self.change,
            "standard_uncertainty": self.standard_uncertainty,
            "share": self.share,
            "shift_to_close": self.shift_to_close if isfinite(self.shift_to_close) else None,
        }


@dataclass(frozen=True)
class Mended:
    """What the twin predicts once what the patches' signals contradict is as they ask.

    Parameters
    ----------
    name : str
        What was changed, in plain words.
    change : str
        From which value to which.
    predicted : float
        The CDP.
    standard_uncertainty : float
        Of it, by what the signals leave open of the change.
    """

    name: str
    change: str
    predicted: float
    standard_uncertainty: float

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        return {
            "parameter": self.name,
            "change": self.change,
            "predicted": self.predicted,
            "predicted_standard_uncertainty": self.standard_uncertainty,
        }


@dataclass(frozen=True)
class TwinPair:
    """CDP of a pair of patches, measured and predicted.

    Parameters
    ----------
    asked : PairAsked
        Patches and contrast.
    exposure_s : float
        Exposure of the frames.
    frame_number, dark_frame_number : int
        Frames of the bright and of the dark patch.
    measured : CdpResult
        By the camera; its interval is that of the finite number of pixels.
    predicted : float
        By the twin, for a region without end.
    predicted_standard_uncertainty : float
        By the parameters of the twin and the meter's readings.
    sampling_standard_uncertainty : float
        Scatter of the CDP of so many pixels around its expectation, by the twin.
    influences : tuple of Influence
        Parameters, the largest share first.
    mended : Mended or None
        Of a pair that differs, the change of the twin that explains it best; None if the patches' signals contradict
        nothing that brings the prediction closer.
    """

    asked: PairAsked
    exposure_s: float
    frame_number: int
    dark_frame_number: int
    measured: CdpResult
    predicted: float
    predicted_standard_uncertainty: float
    sampling_standard_uncertainty: float
    influences: tuple[Influence, ...]
    mended: Mended | None = None

    @property
    def difference(self) -> float:
        """Measured less predicted."""
        return self.measured.cdp - self.predicted

    @property
    def joint_standard_uncertainty(self) -> float:
        """Of the difference."""
        return sqrt(self.predicted_standard_uncertainty**2 + self.sampling_standard_uncertainty**2)

    @property
    def joint_interval(self) -> tuple[float, float]:
        """95 % interval of the difference."""
        half_width = _Z_95 * self.joint_standard_uncertainty
        return self.difference - half_width, self.difference + half_width

    @property
    def predicted_interval(self) -> tuple[float, float]:
        """95 % interval of the prediction, inside 0 to 1."""
        half_width = _Z_95 * self.predicted_standard_uncertainty
        return max(self.predicted - half_width, 0.0), min(self.predicted + half_width, 1.0)

    @property
    def agreeing_share(self) -> float:
        """Share of all possible CDPs, 0 to 1, that would agree with the prediction if they were measured."""
        half_width = _Z_95 * self.joint_standard_uncertainty
        return max(min(self.predicted + half_width, 1.0) - max(self.predicted - half_width, 0.0), 0.0)

    @property
    def decided(self) -> bool:
        """Whether the pair can tell agreement from a difference: less than 80 % of all possible CDPs would agree.

        It depends on the prediction alone, so that leaving undecided pairs out selects no results.
        """
        return self.agreeing_share < _VACUOUS

    @property
    def agrees(self) -> bool:
        """Whether the pair is decided, and the 95 % interval of the difference holds 0."""
        low, high = self.joint_interval
        return self.decided and low <= 0 <= high

    @property
    def differs(self) -> bool:
        """Whether the pair is decided, and the 95 % interval of the difference does not hold 0."""
        return self.decided and not self.agrees

    @property
    def judgement(self) -> str:
        """``agree``, ``differ`` or ``undecided``."""
        return ("agree" if self.agrees else "differ") if self.decided else "undecided"

    def left_by(self, mended: Mended) -> float:
        """Difference that a mended twin leaves, in joint standard uncertainties, without sign."""
        uncertainty = hypot(self.joint_standard_uncertainty, mended.standard_uncertainty)
        return abs(self.measured.cdp - mended.predicted) / uncertainty

    def is_closed_by(self, mended: Mended) -> bool:
        """Whether pair and mended twin agree."""
        return self.left_by(mended) <= _Z_95

    @property
    def explanation(self) -> Influence | None:
        """The parameter that closes the difference if it is off by the fewest of its standard uncertainties."""
        able = [one for one in self.influences if isfinite(one.shift_to_close) and one.name != SAMPLING]
        return min(able, key=lambda one: abs(one.shift_to_close), default=None)

    @property
    def verdict(self) -> str:
        """In plain words: whether the two agree, and which parameter matters."""
        explanation, first = self.explanation, self.influences[0]
        if not self.decided:
            return (
                f"undecided; {self.agreeing_share:.0%} of all possible CDPs would agree, the largest part of the "
                f"uncertainty is the {first.name} ({first.share:.0%})"
            )
        if self.agrees:
            return f"agree; the largest part of the uncertainty is the {first.name} ({first.share:.0%})"
        if self.mended is not None:
            how_far = "explains it" if self.is_closed_by(self.mended) else "explains part of it"
            return (
                f"differ; the {self.mended.name} {how_far}: with {self.mended.change}, as the signals of the patches "
                f"ask, the twin predicts {self.mended.predicted:.4f}"
            )
        if explanation is None:
            return "differ; no parameter of the twin changes this CDP, so something is at work that it does not hold"
        shift, chance = abs(explanation.shift_to_close), abs(self.difference) / self.sampling_standard_uncertainty
        by = f"the {explanation.name} would have to be off by {shift:.1f} of its standard uncertainties"
        if shift <= min(chance, _INCREDIBLE):
            return f"differ; {by} to explain it"
        if chance <= _INCREDIBLE:
            return f"differ; chance in these pixels would have to be {chance:.1f} standard errors, and {by}"
        joint = abs(self.difference) / self.joint_standard_uncertainty
        if joint <= _INCREDIBLE:
            return f"differ by {joint:.1f} joint standard uncertainties, to which no parameter leads alone: {by}"
        return f"differ; no parameter explains it: {by}, so something is at work that the twin does not hold"

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        mended = self.mended
        explanation = mended or self.explanation
        return {
            "bright": self.asked.bright,
            "dark": self.asked.dark,
            "contrast": self.asked.contrast,
            "epsilon": self.asked.epsilon,
            "meter_contrast": self.asked.meter_contrast,
            "exposure_s": self.exposure_s,
            "frame_number": self.frame_number,
            "dark_frame_number": self.dark_frame_number,
            "measured": self.measured.cdp,
            "measured_interval_95": list(self.measured.confidence_interval),
            "predicted": self.predicted,
            "predicted_standard_uncertainty": self.predicted_standard_uncertainty,
            "predicted_interval_95": list(self.predicted_interval),
            "sampling_standard_uncertainty": self.sampling_standard_uncertainty,
            "difference": self.difference,
            "difference_interval_95": list(self.joint_interval),
            "judgement": self.judgement,
            "agree": self.agrees if self.decided else None,
            "verdict": self.verdict,
            "explained_by": None if explanation is None else explanation.name,
            "mended": None if mended is None else mended.to_dict(),
            "influences": [one.to_dict() for one in self.influences],
        }
