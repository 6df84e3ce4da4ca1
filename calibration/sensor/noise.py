"""Temporal noise of the camera by photon transfer over the patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isnan, log, nan, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.companding import Companding
from ...core.dn import Response
from ...core.errors import CalibrationError, InputError, require_not_negative
from ...core.quantity import Quantity
from ...core.result import Finding, info, warning
from ..frames.observations import GAIN_TOLERANCE_DB, PatchObservation
from ..frames.rounding import ROUNDING_DN2
from ..frames.statistics import MAX_CLIPPED_SHARE
from ..uncertainty import SMALL_EFFECT_REL
from .dark import DarkModel
from .dark_fit import birge

#: Largest K: one electron fills the largest converter.
_MOST_K_DN_PER_E = 2.0**16
#: Rounds of weights of a fit with a tone curve.
_TONE_ROUNDS = 3
Array = NDArray[np.float64]
#: Share of saturation up to which photon transfer is a straight line (EMVA 1288 Release 4.0 Linear).
FIT_SHARE = 0.7
#: Probability, for all exposures together, that equal flicker is taken for different: a wrong one costs little.
_CONTRADICTION = 0.05
#: Probability with which chance makes first frames differ: that of three standard deviations.
_FIRST_BY_CHANCE = 0.0027
#: Fewest frames that show whether the first differs from others that agree.
_FEWEST_FRAMES = 3
#: Fewest frames that tell first frames that differ from a flicker: of 3, those of a lamp that is on for half of its
#: period, at any phases, look so in 17 %, of 5 in 4 % (simulated in `tests/calibration/test_in_session.py`).
FRAMES_THAT_TELL = 5
#: Ratio of a variance to that by a single K from which captures of different noise hand over: far beyond what a line
#: of photon transfer departs by, a judgement.
_HANDED_OVER = 1.25
#: Variance in squares of the step from which it tells the noise: that of 0.34 steps. By where the mean lies, rounding
#: moves it by up to exp(-2 pi^2 s^2) (1 / pi^2 + 4 s^2), a quarter of all (Widrow and Kollar, Quantization Noise).
_TELLING = 0.2
#: Ratio of signals that count as one for the noise.
_ONE_SIGNAL = 1.1
#: Rounds of weights; they change little after the second.
_ROUNDS = 4


@dataclass(frozen=True)
class TemporalNoise:
    """Variance of one pixel over time: s^2 = K (DN - d) + dark_noise^2 (EMVA 1288).

    A camera with a tone curve has this noise before the curve: (s^2 of h) / h'^2, and 1/12 DN^2 by rounding after it.

    Parameters
    ----------
    k_dn_per_e : float
        Overall system gain K; 0 if the noise does not grow with the signal. In linearised DN with a tone curve.
    dark_noise_dn : float
        Standard deviation in the dark at zero exposure, rounding included; in linearised DN and without rounding with a
        tone curve.
    tone : Response or None
        Response h of a camera with a tone curve, None if DN and light are (nearly) proportional.
    flicker_rel : float
        Relative standard deviation of the light from frame to frame.
    flicker_dof : int
        Degrees of freedom of `flicker_rel`.
    prnu_rel : float
        Relative standard deviation of the pixels' sensitivities (EMVA 1288: PRNU), of what vignetting leaves.
    flickers : tuple of (float, float, int)
        Exposure in s, and flicker there with its degrees of freedom, where they differ from exposure to exposure, as of
        a pulsed lamp; empty where one flicker describes all.
    by_signal : tuple of (float, float)
        Rising signals above dark, and the variances there without rounding, of a camera that hands over from a capture
        to the next, each with a noise of its own; empty where K describes all. Between them the variance is
        interpolated in logarithms.
    companding : Companding or None
        Curve whose steps round the values: step^2 / 12 in the place of 1/12 DN^2; None for whole DN.
    dark_dn : float
        Linear value of the dark signal on the curve.

    Raises
    ------
    InputError
        If a value is negative.

    Examples
    --------
    >>> from labcdp.calibration import TemporalNoise
    >>> TemporalNoise(k_dn_per_e=0.6, dark_noise_dn=6.0).k_dn_per_e
    0.6
    """

    k_dn_per_e: float
    dark_noise_dn: float
    tone: Response | None = None
    flicker_rel: float = 0.0
    flicker_dof: int = 0
    prnu_rel: float = 0.0
    flickers: tuple[tuple[float, float, int], ...] = ()
    by_signal: tuple[tuple[float, float], ...] = ()
    companding: Companding | None = None
    dark_dn: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(
            by_signal=[value for row in self.by_signal for value in row],
            k_dn_per_e=self.k_dn_per_e,
            dark_noise_dn=self.dark_noise_dn,
            flicker_rel=self.flicker_rel,
            flicker_dof=self.flicker_dof,
            prnu_rel=self.prnu_rel,
            flickers=[rel for _, rel, _ in self.flickers],
        )
        if self.k_dn_per_e > _MOST_K_DN_PER_E:
            raise InputError(f"k_dn_per_e is {self.k_dn_per_e:g}: give DN per electron, up to {_MOST_K_DN_PER_E:g}")

    def flicker_at(self, exposure_s: float) -> tuple[float, int]:
        """Return the flicker and its degrees of freedom at an exposure, or at that which is nearest to it."""
        nearest = min(self.flickers, key=lambda flicker: abs(log(flicker[0] / exposure_s)), default=None)
        return (self.flicker_rel, self.flicker_dof) if nearest is None else nearest[1:]

    def covers(self, net_dn: float) -> bool:
        """Whether the tone curve is known at a signal: that of a bracket is over the bracket's range only."""
        tone = self.tone
        return tone is None or tone.kind != "table" or tone.net_dn[1] <= net_dn <= tone.net_dn[-1]

    def variance_dn2(self, net_dn: float, dark_variance_dn2: float | None = None) -> float:
        """Variance of one pixel at a signal above dark; as `variances_dn2`."""
        return float(self.variances_dn2(np.array(net_dn), dark_variance_dn2))

    def variances_dn2(self, net_dn: NDArray[np.floating[Any]], dark_variance_dn2: float | None = None) -> Array:
        """Variance of one pixel at signals above dark, in DN^2, any shape.

        Parameters
        ----------
        net_dn : ndarray of float
            Signals.
        dark_variance_dn2 : float or None
            Variance in the dark at the same exposure and temperature; None for zero exposure. Not used with a tone
            curve, whose noise in the dark says little about that at other signals.
        """
        more_dn2 = self._rounding_dn2(net_dn)
        if self.tone is None:
            dark_dn2 = self.dark_noise_dn**2 if dark_variance_dn2 is None else dark_variance_dn2
            # That in the dark includes the rounding there.
            of_light: Array = self._of_light_dn2(net_dn, dark_dn2) + more_dn2 - self._rounding_dn2(np.zeros(()))
            return of_light
        variance: Array = self.k_dn_per_e * np.maximum(self.tone.linearise(net_dn), 0.0) + self.dark_noise_dn**2
        return variance / self.tone.slope(net_dn) ** 2 + more_dn2

    def _of_light_dn2(self, net_dn: NDArray[np.floating[Any]], dark_dn2: float) -> Array:
        """Variance of light and dark signal, with the rounding in the dark alone."""
        signal = np.maximum(net_dn, 0.0)
        if not self.by_signal:
            line: Array = self.k_dn_per_e * signal + dark_dn2
            return line
        at, variance = np.array(self.by_signal).T
        # Photons add to what there is in the dark, and beyond the last signal.
        first = dark_dn2 + (variance[0] - dark_dn2) * signal / at[0]
        last = variance[-1] * signal / at[-1]
        between = np.exp(np.interp(np.log(np.maximum(signal, at[0])), np.log(at), np.log(variance)))
        total: Array = np.where(signal < at[0], first, np.where(signal > at[-1], last, between))
        return total

    def _rounding_dn2(self, net_dn: NDArray[np.floating[Any]]) -> Array:
        """Variance of rounding, by the step of the code there."""
        rounding: Array = ROUNDING_DN2 * curve_steps_dn(self.companding, np.asarray(net_dn) + self.dark_dn) ** 2
        return rounding


def curve_steps_dn(curve: Companding | None, linear_dn: NDArray[np.floating[Any]]) -> Array:
    """Return the linear values that share a code, at linear values of any shape; 1 without a curve."""
    if curve is None:
        return np.ones(np.shape(linear_dn))
    steps: Array = np.interp(linear_dn, curve.linear_by_dn, curve.steps_by_dn)
    return steps


def fit_noise(
    observations: Sequence[PatchObservation], dark: DarkModel, tone: Response | None = None
) -> tuple[TemporalNoise, list[Finding]]:
    """Fit the overall system gain K by photon transfer, and the flicker of the light.

    var - var_dark = K (mean - mean_dark), a straight line through the dark point of the same exposure (EMVA 1288
    Release 4.0 Linear), over the patches up to 70 % of saturation. Each point is weighted with the variance of a
    variance, 2 s^4 / dof, from the fitted line itself.

    Parameters
    ----------
    observations : sequence of PatchObservation
        All patches and exposures.
    dark : DarkModel
        Mean and noise in the dark.
    tone : Response or None
        Response of a camera with a tone curve, over the range that it is known for. Noise is then fitted before the
        curve, read noise with it, as the curve may be steep at dark.

    Returns
    -------
    TemporalNoise
        K, the dark noise and the flicker.
    list of Finding
        Findings for the user.
    """
    light, state = light_flicker(observations, dark), observations[0].state if observations else None
    noise = TemporalNoise(
        0.0,
        dark.noise_dn,
        tone,
        light.flicker_rel,
        light.dof,
        flickers=light.by_exposure,
        companding=None if state is None else state.companding,
        dark_dn=dark.offset_dn,
    )
    points = []
    for o in observations:
        dark_dn = dark.mean_dn(o.exposure_s, o.temperature_c)
        net_dn = o.net_dn_at_pixel(dark_dn)
        # Of merged captures each ends far below saturation.
        share = 1.0 if o.state.has_hand_overs else FIT_SHARE
        in_range = 0 < net_dn <= share * (o.state.saturation_dn - dark_dn)
        variance_dn2 = _without_step_dn2(o)
        if in_range and not isnan(variance_dn2) and _unclipped(o) and noise.covers(net_dn):
            dark_dn2 = dark.noise_variance_dn2(o.exposure_s, o.temperature_c)
            points.append((net_dn, variance_dn2, o.dof, dark_dn2))
    findings = first_frames(observations, dark)
    if not points:
        return noise, [*findings, warning("k-unknown", share=FIT_SHARE)]
    net, variance, dof, dark_dn2 = np.array(points).T
    if tone is not None:
        k, read_dn = _before_tone(net, variance, dof, tone)
        return replace(noise, k_dn_per_e=k, dark_noise_dn=read_dn), findings
    k = weighted_gain(net, variance - dark_dn2, dark_dn2, dof).value
    if state is not None and state.has_hand_overs and _departs(net, variance, k, dark_dn2):
        by_signal = noise_by_signal(net, variance, dof)
        return replace(noise, by_signal=by_signal), [*findings, _handed_over(by_signal)]
    if k <= 0:
        return noise, [*findings, warning("k-not-positive", k_dn_per_e=k)]
    return replace(noise, k_dn_per_e=k), findings


def _without_step_dn2(o: PatchObservation) -> float:
    """Return a variance with the rounding to whole DN in the place of that to codes; nan if that hides the noise."""
    if o.state.companding is None:
        return o.temporal_variance_dn2
    if o.step_dn > 1 and o.temporal_variance_dn2 < _TELLING * o.step_dn**2:
        return nan
    return o.temporal_variance_dn2 - ROUNDING_DN2 * (o.step_dn**2 - 1)


def _departs(net_dn: Array, variance_dn2: Array, k: float, dark_dn2: Array) -> bool:
    """Whether variances are not those of a single K, by more than its line may be off."""
    line_dn2 = max(k, 0.0) * net_dn + dark_dn2
    ratio = np.maximum(variance_dn2, 1e-12) / np.maximum(line_dn2, 1e-12)
    return bool(np.max(np.abs(np.log(ratio))) > log(_HANDED_OVER))


def noise_by_signal(net_dn: Array, variance_dn2: Array, dof: Array) -> tuple[tuple[float, float], ...]:
    """Join variances at nearly equal signals to one each, weighted by their degrees of freedom.

    Parameters
    ----------
    net_dn, variance_dn2, dof : ndarray of float, shape (n,)
        Signals above dark and variances there, above 0, with their degrees of freedom.

    Returns
    -------
    tuple of (float, float)
        Rising signals, and the variances.

    Examples
    --------
    >>> noise_by_signal(np.array([100.0, 1.0, 101.0]), np.array([20.0, 4.0, 24.0]), np.array([10, 10, 10]))
    ((1.0, 4.0), (100.5, 22.0))
    """
    net_dn, variance_dn2, dof = (values[variance_dn2 > 0] for values in (net_dn, variance_dn2, dof))
    order = np.argsort(net_dn)
    starts = [0]
    for at, signal in enumerate(net_dn[order]):
        if signal > _ONE_SIGNAL * net_dn[order][starts[-1]]:
            starts.append(at)
    groups = np.split(order, starts[1:])
    return tuple(
        (float(np.average(net_dn[g], weights=dof[g])), float(np.average(variance_dn2[g], weights=dof[g])))
        for g in groups
    )


def _handed_over(by_signal: Sequence[tuple[float, float]]) -> Finding:
    """Say at which signal the SNR falls most although the signal rises."""
    signal, variance = np.array(by_signal).T
    snr = signal / np.sqrt(variance)
    drop = snr[1:] / snr[:-1]
    at = int(np.argmin(drop)) if drop.size else 0
    fall = float(drop[at]) if drop.size else 1.0
    return info("noise-by-signal", count=signal.size, fall_rel=max(1 - fall, 0.0), net_dn=float(signal[at]))


class Flicker(NamedTuple):
    """Changes of the light from frame to frame.

    Parameters
    ----------
    flicker_rel : float
        Relative standard deviation over all exposures.
    dof : int
        Its degrees of freedom; 0 if nothing is known.
    noise_rel : float
        Standard deviation of the noise in which it is found.
    by_exposure : tuple of (float, float, int)
        Exposure in s, and the same two of it, where the exposures contradict each other; else empty.
    """

    flicker_rel: float = 0.0
    dof: int = 0
    noise_rel: float = 0.0
    by_exposure: tuple[tuple[float, float, int], ...] = ()


def light_flicker(observations: Sequence[PatchObservation], dark: DarkModel) -> Flicker:
    """Find how much the light changes from frame to frame.

    All patches of the same frames have it in common: it is a mean over them, and then over the exposures, each weighted
    by how well it shows it.

    Parameters
    ----------
    observations : sequence of PatchObservation
        All patches and exposures of a session.
    dark : DarkModel
        Dark signal there.
    """
    groups = _same_frames(observations, dark)
    if not groups:
        return Flicker()
    rows = [_flicker_of_frames(group, dark) for group in groups]
    exposures_s = [group[0].exposure_s for group in groups]
    excess, noise, dof = np.array(rows).T
    flicker = 0.0
    for _ in range(_ROUNDS):
        weight = dof / (flicker + noise) ** 2
        flicker = max(float(weight @ excess / weight.sum()), 0.0)
    effective_dof = weight.sum() ** 2 / float(weight**2 @ (1 / dof))
    by_exposure: tuple[tuple[float, float, int], ...] = ()
    if flicker > 0 and _contradict(excess + noise, flicker + noise, dof):
        sizes = np.sqrt(np.maximum(excess, 0.0)).tolist()
        by_exposure = tuple(zip(exposures_s, sizes, dof.astype(int).tolist(), strict=True))
    noise_rel = sqrt(float(weight @ noise / weight.sum()))
    return Flicker(sqrt(flicker), max(round(effective_dof), 1), noise_rel, by_exposure)


def first_frames(
    observations: Sequence[PatchObservation], dark: DarkModel, by_chance: float = _FIRST_BY_CHANCE
) -> list[Finding]:
    """Return a finding if the first frames of the exposures differ from those that follow, which agree (F test).

    So they do by image lag, and by a camera or a lamp that settles; a light that flickers changes from any frame to the
    next, but frames of a pulsed lamp agree often where they are few, see `FRAMES_THAT_TELL`. Observations and dark
    signal as of `light_flicker`; `by_chance` is the probability of a finding by chance.
    """
    from scipy.special import fdtrc

    rows, fewest = [], inf
    for group in _same_frames(observations, dark):
        n = group[0].n_frames
        if n < _FEWEST_FRAMES or any(o.n_frames != n for o in group):
            continue
        net = _net_dn(group, dark) / [o.mean_inverse_v for o in group]
        means = np.array([o.frame_means_dn for o in group])
        noise = np.maximum([_frame_noise_dn2(o, dark) / o.mean_inverse_v**2 for o in group], 1e-12) / net**2
        weight = 1 / noise / np.sum(1 / noise)
        light = weight @ (means / net[:, None])
        floor = 1 / float(np.sum(1 / noise))
        first, rest = float(light[0] - light[1:].mean()), float(np.var(light[1:], ddof=1))
        fewest = min(fewest, n)
        rows.append((first, first**2 / (1 + 1 / (n - 1)), max(rest, floor) * (n - 2), n - 2, group[0].exposure_s))
    if not rows:
        return []
    firsts, squares, within, dof, exposures_s = (np.array(column) for column in zip(*rows, strict=True))
    ratio = squares.mean() / (within.sum() / dof.sum())
    largest = int(np.argmax(np.abs(firsts)))
    if fdtrc(squares.size, dof.sum(), ratio) >= by_chance or abs(firsts[largest]) <= SMALL_EFFECT_REL:
        return []
    shown = {"deviation_rel": float(firsts[largest]), "exposure_s": float(exposures_s[largest])}
    return [warning("first-frames-differ", **shown, n_frames=int(fewest))]


def few_frames(settling: Finding) -> bool:
    """Whether the frames of a finding of `first_frames` are too few to tell it from a flicker."""
    n_frames = settling.values["n_frames"]
    return isinstance(n_frames, int) and n_frames < FRAMES_THAT_TELL


def _same_frames(observations: Sequence[PatchObservation], dark: DarkModel) -> list[list[PatchObservation]]:
    """Return observations of the same frames, several of them, in which patches have a signal and do not clip."""
    sets: dict[object, list[PatchObservation]] = {}
    for o in observations:
        if _unclipped(o) and o.n_frames > 1 and o.net_dn(dark.mean_dn(o.exposure_s, o.temperature_c)) > 0:
            sets.setdefault(o.exposure_s if o.recorded is None else o.recorded, []).append(o)
    return [*sets.values()]


def _contradict(seen: Array, expected: Array, dof: Array) -> bool:
    """Whether one of several variances is improbable, if what is expected of them is right (chi^2 tests)."""
    from scipy.special import chdtr, chdtrc

    # Less than noise explains, by chance, may be less than 0.
    ratio = np.maximum(dof * seen / expected, 0.0)
    p_values = 2 * np.minimum(chdtrc(dof, ratio), chdtr(dof, ratio))
    return bool(p_values.min() < _CONTRADICTION / p_values.size)


def _flicker_of_frames(group: Sequence[PatchObservation], dark: DarkModel) -> tuple[float, float, int]:
    """Relative variance of the light over the frames of one exposure, that of its noise, and degrees of freedom."""
    net = _net_dn(group, dark)
    noise = np.maximum([_frame_noise_dn2(o, dark) for o in group], 1e-12) / net**2
    seen = np.array([o.frame_means_variance_dn2 * o.mean_inverse_v**2 for o in group]) / net**2
    weight = 1 / noise**2
    excess = float(weight @ (seen - noise) / weight.sum())
    return excess, float(weight.sum()) ** -0.5, group[0].n_frames - 1


def _net_dn(group: Sequence[PatchObservation], dark: DarkModel) -> Array:
    return np.array([o.net_dn(dark.mean_dn(o.exposure_s, o.temperature_c)) for o in group])


def _frame_noise_dn2(o: PatchObservation, dark: DarkModel) -> float:
    """Variance of a patch's mean of DN / V in one frame by noise of the pixels, columns, rows and black level."""
    columns, rows = (part**2 / n for part, n in zip(dark.line_noise_dn, o.n_lines, strict=True))
    return o.mean_inverse_v**2 * (o.temporal_variance_dn2 / o.n_pixels + columns + rows + dark.drift_dn**2)


def _unclipped(o: PatchObservation) -> bool:
    return max(o.saturated_share, o.black_share) <= MAX_CLIPPED_SHARE


def _before_tone(net_dn: Array, variance_dn2: Array, dof: Array, tone: Response) -> tuple[float, float]:
    """K and read noise of h by least squares; neither is negative."""
    from scipy.optimize import nnls

    slope2 = tone.slope(net_dn) ** 2
    design = np.column_stack([tone.linearise(net_dn), np.ones(net_dn.size)]) / slope2[:, None]
    fitted_dn2 = variance_dn2
    for _ in range(_TONE_ROUNDS):
        weight = np.sqrt(dof) / np.maximum(fitted_dn2, ROUNDING_DN2)
        coefficients, _ = nnls(weight[:, None] * design, weight * np.maximum(variance_dn2 - ROUNDING_DN2, 0))
        fitted_dn2 = design @ coefficients + ROUNDING_DN2
    return float(coefficients[0]), sqrt(float(coefficients[1]))


def slope_through_origin(x: Array, y: Array, u: Array, weighted: bool = False) -> Quantity:
    """Fit a line through the origin.

    Parameters
    ----------
    x, y, u : ndarray of float, shape (n,)
        Points, and the standard uncertainties of y, above 0.
    weighted : bool
        False for the least squares of EMVA 1288, all points alike; True weights with 1 / u^2, for points whose
        uncertainties differ by orders.

    Returns
    -------
    Quantity
        b = sum(w x y) / sum(w x^2). The uncertainty is propagated from u, sqrt(sum((w x u)^2)) / sum(w x^2), and
        widened by the Birge ratio if the points scatter more than u says.
    """
    weight = 1 / u**2 if weighted else np.ones_like(x)
    normal = float(np.sum(weight * x**2))
    slope = float(np.sum(weight * x * y)) / normal
    propagated = sqrt(float(np.sum((weight * x * u) ** 2))) / normal
    return Quantity(slope, propagated * birge(float(np.sum(((y - slope * x) / u) ** 2)), x.size - 1))


def weighted_gain(
    net_dn: Array, excess_dn2: Array, dark_dn2: Array, dof: Array, dark_dof: Array | float = inf
) -> Quantity:
    """Fit var - var_dark = K (mean - mean_dark) with the variances of the variances, 2 s^4 / dof.

    The weights follow from the fitted line: those from the points would be biased towards low values.

    Parameters
    ----------
    net_dn, excess_dn2 : ndarray of float, shape (n,)
        Signals above dark, and variances over those in the dark.
    dark_dn2 : ndarray of float, shape (n,)
        Variances in the dark at the same exposures.
    dof, dark_dof : ndarray of float, shape (n,)
        Degrees of freedom of both.
    """
    k = Quantity(float(excess_dn2.sum() / net_dn.sum()), 0.0)
    for _ in range(_ROUNDS):
        light_dn2 = max(k.value, 0.0) * net_dn + dark_dn2
        u = np.sqrt(2 * (light_dn2**2 / dof + dark_dn2**2 / dark_dof)) + 1e-12
        k = slope_through_origin(net_dn, excess_dn2, u, weighted=True)
    return k


@dataclass(frozen=True)
class GainSetting:
    """Properties of a gain.

    Parameters
    ----------
    gain_db : float
        The gain.
    factor, factor_random_rel : float
        Responsivity over that at the calibration's own gain, and its relative standard uncertainty.
    dark : DarkModel
        d(t, T) at this gain.
    noise : TemporalNoise
        Noise of a pixel at this gain.

    Raises
    ------
    InputError
        If the factor is not positive, or its uncertainty negative.

    Examples
    --------
    >>> from labcdp.calibration import DarkModel, GainSetting, TemporalNoise
    >>> none = ((0.0,) * 3,) * 3
    >>> dark = DarkModel(64.0, 0.0, none, noise_dn=2.0, nonuniformity_dn=0.0, exposures_s=(0.01,))
    >>> GainSetting(6.0, 2.0, 0.001, dark, TemporalNoise(k_dn_per_e=0.6, dark_noise_dn=2.0)).factor
    2.0
    """

    gain_db: float
    factor: float
    factor_random_rel: float
    dark: DarkModel
    noise: TemporalNoise

    def __post_init__(self) -> None:
        require_not_negative(factor=self.factor, factor_random_rel=self.factor_random_rel)
        if self.factor == 0:
            raise InputError("factor is 0: more gain does not take all signal away; give a positive number")


def find_gain(settings: Sequence[GainSetting], gain_db: float) -> int:
    """Index of a gain among settings; raises CalibrationError, naming the calibrated ones, if not found."""
    for index, setting in enumerate(settings):
        if abs(setting.gain_db - gain_db) <= GAIN_TOLERANCE_DB:
            return index
    known = " or ".join(f"{setting.gain_db:g} dB" for setting in settings)
    raise CalibrationError(f"the calibration is for a gain of {known}, not {gain_db:g} dB: calibrate this gain too")
