"""Effects that may move the observations beside the response, by name, as columns of the fit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import inf, log
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ..camera import INTERCEPT
from ..uncertainty import SMALL_EFFECT_REL
from .design import Array, Design, SharedError
from .problem import Solution, solution_at, solve
from .scatter import covariance_with, residual_scatter

#: Effects that are looked for.
Kind: TypeAlias = Literal[
    "glare", "dark signal", "dark current", "exposure offset", "exposure", "drift", "step", "place", "rim", "patch"
]  # fmt: skip
#: Probability with which chance makes an effect of one kind significant: that of three standard deviations.
FALSE_ALARM = 0.0027
#: Ratio of the highest to the lowest patch below which intercept and slope cannot be distinguished.
MIN_SPAN = 2.0
#: Decrease of chi^2 required of a further parameter: one that happens by chance in 1 %.
WORTH = 6.6
#: Width of the prior of an effect that was found, over its size: it is as good as free.
FREE = 10.0
#: Fewest patches for finding a bad one, so that three remain; and the largest fraction of them (at least one).
_MIN_PATCHES, _MAX_SHARE = 4, 0.25
#: Patches in excess of the parameters required for a test of positions.
_SPARE_PATCHES = 2
#: Readings within this many hours cannot show a drift.
_MIN_HOURS = 1 / 60
#: Ratio of luminance to reading from which a solution is far from what the readings say.
_FAR = 2.0
#: Share of a column that the model has to leave of it.
_LEFT = 1e-6


@dataclass(frozen=True, eq=False)
class Effect:
    """One effect with unknown amplitudes.

    Parameters
    ----------
    kind : str
        Which.
    errors : tuple of SharedError
        Its columns, for amplitudes of 1.
    number : int
        Of the exposure or the patch; 0 for others.
    subject : str
        Which exposure or patch, in words.
    alike : int
        Effects of its kind that are looked at.
    """

    kind: Kind
    errors: tuple[SharedError, ...]
    number: int = 0
    subject: str = ""
    alike: int = 1

    @property
    def most(self) -> int:
        """Return how many of its kind there may be: of exposures, one has to be as stated."""
        if self.kind == "patch":
            return max(1, int(_MAX_SHARE * self.alike))
        return max(self.alike - 1, 1) if self.kind == "exposure" else 1

    @property
    def name(self) -> str:
        """Name in words."""
        return _NAMES[self.kind].format(self.subject)

    @property
    def changes_times(self) -> bool:
        """Whether it changes exposure times, which are corrected by it."""
        return self.kind in ("exposure offset", "exposure")

    def around(self, factor: Array) -> Effect:
        """Return the effect where exposure times are longer by a factor already, shape (n,)."""
        if not self.changes_times:
            return self
        return replace(self, errors=tuple(replace(e, relative=e.relative / factor) for e in self.errors))

    @property
    def what_tells(self) -> str:
        """Measurement that would tell it from other effects, in words."""
        return _WHAT_TELLS[self.kind]

    @property
    def key(self) -> tuple[Kind, int]:
        """Kind and number, which the same effect has in every design."""
        return self.kind, self.number

    def columns(self, solution: Solution) -> Array:
        """Effects on luminances less readings, shape (k, n)."""
        return replace(solution.design, shared=self.errors).patterns(solution.luminance, solution.slope)

    def within(self, widths: Array) -> tuple[SharedError, ...]:
        """Return its columns with normal priors of widths, shape (k,)."""
        return tuple(
            replace(e, relative=e.relative * w, dn=e.dn * w, cd_m2=e.cd_m2 * w, is_parameter=True)
            for e, w in zip(self.errors, widths, strict=True)
        )


#: The effects in words.
_NAMES: dict[Kind, str] = {
    "glare": "a veil of light (glare)",
    "dark signal": "a wrong dark signal",
    "dark current": "a dark current that has changed (temperature)",
    "exposure offset": "exposures that are all longer or shorter than stated",
    "exposure": "a wrong exposure time at {}",
    "drift": "a drift of lamp, camera or meter",
    "step": "a step of meter or lamp at patch {}",
    "place": "the place in the image (vignetting)",
    "rim": "light of the surroundings in the regions (focus, halo)",
    "patch": "a wrong reading of patch {}",
}


#: What would tell each effect from others.
_WHAT_TELLS: dict[Kind, str] = {
    "glare": "shade the lens, or darken the surroundings",
    "dark signal": "take the dark frames again, right after the light frames",
    "dark current": "take dark and light frames at one temperature",
    "exposure offset": "add exposures, the longest ones above all",
    "exposure": "add exposures near it",
    "drift": "read the first patch again at the end",
    "step": "read some patches again, in another order",
    "place": "show the patches at other places, or record a flat field",
    "rim": "focus, or draw smaller regions",
    "patch": "read this patch again",
}


class Amplitude(NamedTuple):
    """Fitted amplitudes of an effect.

    Parameters
    ----------
    value, uncertainty : ndarray of float, shape (k,)
        Amplitudes and their standard uncertainties, infinite where the model explains the column.
    drop : float
        Decrease of chi^2.
    n : int
        Columns that the model does not explain.
    dof : float
        Degrees of freedom of the uncertainty.
    """

    value: Array
    uncertainty: Array
    drop: float = 0.0
    n: int = 0
    dof: float = inf

    @property
    def log_p(self) -> float:
        """Logarithm of the probability that chance gives as much."""
        from scipy.special import chdtrc, fdtrc

        if self.n == 0:
            return 0.0
        drop = max(self.drop, 0.0)
        by_chance = chdtrc(self.n, drop) if self.dof == inf else fdtrc(self.n, self.dof, drop / self.n)
        return log(by_chance) if by_chance > 0 else -inf


class FittedEffect(NamedTuple):
    """An effect with its amplitude.

    Parameters
    ----------
    effect : Effect
        The effect.
    amplitude : Amplitude
        What the observations say of it.
    rivals : tuple of FittedEffect
        Others that explain the observations about equally well.
    """

    effect: Effect
    amplitude: Amplitude
    rivals: tuple[FittedEffect, ...] = ()

    @property
    def log_p(self) -> float:
        """Logarithm of the probability that chance gives as much to any effect of the kind."""
        return self.amplitude.log_p + log(self.effect.alike)

    @property
    def significant(self) -> bool:
        """Whether it is improbable by chance, and possible."""
        return self.log_p < log(FALSE_ALARM) and self.possible

    @property
    def possible(self) -> bool:
        """Whether its sign is; no glare is negative."""
        return self.effect.kind != "glare" or self.value > 0

    def matters(self, solution: Solution) -> bool:
        """Whether it changes observations, beside others, by more than is small compared with the 2 % of a meter."""
        moved = self.amplitude.value @ self.effect.columns(solution)
        return bool(np.ptp(moved / solution.level) > SMALL_EFFECT_REL)

    @property
    def widths(self) -> Array:
        """Widths of the priors in the fit: free, but a patch that deviates keeps the weight that this leaves it."""
        value, uncertainty, *_ = self.amplitude
        size: Array = np.maximum(np.abs(value), np.where(np.isfinite(uncertainty), uncertainty, 0.0))
        return size if self.effect.kind == "patch" else FREE * size

    @property
    def value(self) -> float:
        """Amplitude of its only column."""
        return float(self.amplitude.value[0])

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of it."""
        return float(self.amplitude.uncertainty[0])


def possible_effects(design: Design, *, with_exposures: bool = True) -> list[Effect]:
    """List the effects that observations could show, those of exposures if these are not the response's source."""
    of_exposures = _exposure_effects(design) if with_exposures else []
    return [*_signal_effects(design), *of_exposures, *_time_effects(design), *_patch_effects(design)]


def _signal_effects(design: Design) -> list[Effect]:
    readings = design.reading_cd_m2
    dark = Effect("dark signal", (SharedError("dark signal", dn=1.0),))
    glare = Effect("glare", (SharedError(INTERCEPT, cd_m2=design.veil),))
    effects = [glare, dark] if readings.max() >= MIN_SPAN * readings.min() else [dark]
    if design.exposures_s.size > 1:
        current = SharedError("dark current", dn=design.exposures_s[design.exposure])
        effects.append(Effect("dark current", (current,)))
    return effects


def _exposure_effects(design: Design) -> list[Effect]:
    """Return an offset of all times, and deviations of single ones; nothing for a single one."""
    n = design.exposures_s.size
    if n < 2:
        return []
    offset = SharedError("exposure offset", 1 / design.exposures_s[design.exposure])
    effects = [Effect("exposure offset", (offset,))]
    for k, exposure_s in enumerate(design.exposures_s.tolist()):
        error = SharedError("exposure", np.where(design.exposure == k, 1.0, 0.0))
        effects.append(Effect("exposure", (error,), k, exposure_text(exposure_s), n))
    return effects


def _time_effects(design: Design) -> list[Effect]:
    """Return a light that changes by 1 per hour, and readings lower by 1 from one patch on, two on each side."""
    if np.ptp(design.read_h) < _MIN_HOURS:
        return []
    effects = [Effect("drift", (SharedError("drift", design.delay_h),))]
    firsts = np.argsort(design.read_h, kind="stable").tolist()[2:-1]
    for k in firsts:
        after = SharedError("step", ((design.read_h >= design.read_h[k]) - 0.5)[design.patch])
        effects.append(Effect("step", (after,), k, design.patches[k], len(firsts)))
    return effects


def _patch_effects(design: Design) -> list[Effect]:
    """Smooth changes over the image, r^2, x and y, only r^2 for few patches; and readings of single patches."""
    n = len(design.patches)
    spare = n - 1 - _SPARE_PATCHES
    columns = design.position_patterns[:, : 3 if spare >= 3 else 1 if spare >= 1 else 0].T
    position = tuple(SharedError("place", pattern[design.patch]) for pattern in columns)
    effects = [Effect("place", position)] if position else []
    effects.append(Effect("rim", (SharedError("rim", design.rim_rel[design.patch]),)))
    for k, name in enumerate(design.patches if n >= _MIN_PATCHES else ()):
        error = SharedError("patch", cd_m2=np.where(design.patch == k, 1.0, 0.0))
        effects.append(Effect("patch", (error,), k, name, n))
    return effects


def amplitude(solution: Solution, columns: Array) -> Amplitude:
    """Fit further columns, shape (k, n), in luminances less readings (score test; exact for linear models)."""
    seen = columns @ solution.left @ columns.T
    scale = np.sqrt(np.maximum(np.einsum("kn,nm,km->k", columns, solution.weight, columns), 1e-300))
    values, vectors = np.linalg.eigh(seen / np.outer(scale, scale))
    # Columns collinear with the response, or with each other at these patches, are dropped.
    kept = values > _LEFT
    vectors = vectors[:, kept] / scale[:, None]
    pull = vectors.T @ (columns @ solution.left @ solution.residual)
    explained = pull / values[kept]
    uncertainty = np.sqrt((vectors**2 / values[kept]).sum(axis=1)) if kept.any() else np.full(len(columns), inf)
    return Amplitude(vectors @ explained, uncertainty, float(pull @ explained), int(kept.sum()))


def assess(solution: Solution, effect: Effect) -> FittedEffect:
    """Fit an effect beside a solution; its uncertainty includes the scatter of the patches that it leaves."""
    columns = effect.columns(solution)
    plain = amplitude(solution, columns)
    if plain.n == 0 or solution.degrees_of_freedom <= plain.n:
        return FittedEffect(effect, plain)
    ratio = solution.luminance / solution.design.readings
    if ratio.max() > _FAR or ratio.min() < 1 / _FAR:
        solution = _where_it_leads(solution, effect, plain)
        columns = effect.columns(solution)
        plain = amplitude(solution, columns)
    spare = len(solution.design.patches) - solution.parameters.size - solution.design.n_effects - plain.n
    dof = float(max(spare, 1))
    size = residual_scatter(replace(solution, jacobian=np.column_stack([solution.jacobian, columns.T])))
    if size:
        scattered = replace(solution, covariance=covariance_with(solution, {"scatter_rel": size}))
        return FittedEffect(effect, amplitude(scattered, columns)._replace(dof=dof))
    # Even where the other patches seem not to scatter, they are few.
    return FittedEffect(effect, plain._replace(dof=dof) if effect.kind == "patch" else plain)


def _where_it_leads(solution: Solution, effect: Effect, plain: Amplitude) -> Solution:
    """Return the solution at the parameters of the fit with an effect: far from these its weights are wrong."""
    size = np.maximum(np.abs(plain.value), np.where(np.isfinite(plain.uncertainty), plain.uncertainty, 0.0))
    design = solution.design
    try:
        beside = solve(replace(design, shared=(*design.shared, *effect.within(FREE * size))), solution.candidate)
        return solution_at(design, solution.candidate, beside.parameters)
    except CalibrationError:
        return solution


def largest_of_each_kind(solution: Solution, effects: Iterable[Effect]) -> list[Effect]:
    """Return the effect of each kind that explains most without scatter, which makes all of a kind less significant."""
    best: dict[Kind, FittedEffect] = {}
    for effect in effects:
        plain = FittedEffect(effect, amplitude(solution, effect.columns(solution)))
        if effect.kind not in best or plain.amplitude.drop > best[effect.kind].amplitude.drop:
            best[effect.kind] = plain
    return [fitted.effect for fitted in best.values()]
