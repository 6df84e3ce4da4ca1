"""Compare subjects of one kind: each with the first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...chain import Chain
from ...chain.predict.chain import known_transitions
from ...core.disk import shortened
from ...core.errors import InputError, PredictionError
from ...metrics.contrast import TargetContrasts
from ..picture.settings import ImageSettings
from ..requirement import Requirement
from ..sweep.maps.map import MapAnalysis, analyse_map
from ..sweep.plan import Axis, Sweep
from ..sweep.run import run_sweep
from .grid import Difference, Grid, difference, map_grid, responsivity_grid
from .requirement import Judged, applied, judged, luminances
from .rows import Named, values_of
from .subject import Subject, read_subjects

if TYPE_CHECKING:
    from xarray import Dataset

#: Luminances at which chains are compared unless others are given: from starlight to a sunlit road sign.
LUMINANCES = Axis("scene.luminance_cd_m2", tuple(np.geomspace(0.001, 1e5, 121).tolist()))
#: How often ends of usable ranges are refined, and points between those around an end each time.
_REFINEMENTS, _POINTS = 2, 32
#: Longest text of a setting.
_LONGEST = 60


@dataclass(frozen=True)
class Question:
    """Question to chains: parameters to vary, contrast to detect, and tolerance.

    Parameters
    ----------
    axes : tuple of Axis
        Parameters that are varied.
    changes : mapping
        Parameters that are set in all chains.
    contrast : float, tuple of float or None
        Weber contrasts to be detected, fractions; None for that of each scene.
    epsilon : float
        Its relative tolerance.
    requirement : Requirement or None
        Requirement for each chain, which then gives luminances, contrast, conditions and tolerance of the question.
    """

    axes: tuple[Axis, ...] = (LUMINANCES,)
    changes: Mapping[str, Any] | None = None
    contrast: TargetContrasts = None
    epsilon: float = 0.5
    requirement: Requirement | None = None

    @classmethod
    def by(cls, requirement: Requirement, changes: Mapping[str, Any] | None = None) -> Question:
        """Return the question of a requirement, with parameters that are set in all chains."""
        return cls((luminances(requirement),), changes, None, requirement.epsilon, requirement)

    @property
    def configuration(self) -> dict[str, Any]:
        """Return it as values JSON can hold."""
        axes = {axis.parameter: list(axis.values) for axis in self.axes}
        required = {} if self.requirement is None else {"requirement": self.requirement.model_dump(mode="json")}
        question = {"contrast": self.contrast, "epsilon": self.epsilon, "set": dict(self.changes or {}), "axes": axes}
        return question | required


@dataclass(frozen=True, eq=False)
class Compared:
    """A value of one subject beside that of the first.

    Parameters
    ----------
    name : str
        The subject.
    first, other : Named
        The values.
    difference : Difference
        Other minus first.
    """

    name: str
    first: Named
    other: Named
    difference: Difference


@dataclass(frozen=True, eq=False)
class ComparisonEvaluation:
    """Things of one kind, each compared with the first.

    Parameters
    ----------
    subjects : tuple of Subject
        At least two, or one that is judged by a requirement.
    rows : tuple of Compared
        Values compared one by one.
    unmatched : tuple of str
        Quantities that only some subjects have.
    grid : Grid or None
        Curves or maps on the same axes.
    analyses : tuple of MapAnalysis
        Usable ranges of each map.
    question : Question or None
        Of chains.
    judged : tuple of Judged
        Whether each chain meets the requirement of the question, if there is one.
    """

    subjects: tuple[Subject, ...]
    rows: tuple[Compared, ...] = ()
    unmatched: tuple[str, ...] = ()
    grid: Grid | None = None
    analyses: tuple[MapAnalysis, ...] = ()
    question: Question | None = None
    judged: tuple[Judged, ...] = ()

    @property
    def kind(self) -> str:
        """Kind of the subjects."""
        return self.subjects[0].kind

    @property
    def settings(self) -> dict[str, list[str]]:
        """Settings in which the subjects differ, as text of each."""
        flat = [dict(_flat(subject.settings)) for subject in self.subjects]
        rows = {name: [text.get(name, "") for text in flat] for text in flat for name in text}
        return {
            name: [shortened(text, _LONGEST) for text in texts] for name, texts in rows.items() if len(set(texts)) > 1
        }


def compare_subjects(
    sources: Sequence[Any],
    question: Question | ImageSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ComparisonEvaluation:
    """Compare chains, maps, sessions, calibrations, characterisations or pictures; see `read_subjects`.

    Parameters
    ----------
    sources : sequence
        At least two; a chain that is judged by a requirement may be alone.
    question : Question, ImageSettings or None
        Question to chains, or settings for pictures; None for CDP over the luminance.
    progress : callable or None
        Called with the number of cells of a chain's prediction that are done, and of all.

    Raises
    ------
    InputError
        If subjects cannot be read or compared, or there is a question but no chain or no picture.
    """
    required = isinstance(question, Question) and question.requirement is not None
    pictures = question if isinstance(question, ImageSettings) else None
    subjects = read_subjects(sources, pictures, fewest=1 if required else 2)
    kind = subjects[0].kind
    picture_options = "regions and light", "picture"
    what, expected_kind = (
        picture_options if isinstance(question, ImageSettings) else ("parameters, contrast and tolerance", "chain")
    )
    if question is not None and kind != expected_kind:
        raise InputError(f"{what} are options for {expected_kind}s, {subjects[0].name} is a {kind}")
    if kind == "chain":
        return _chains(subjects, question if isinstance(question, Question) else Question(), progress)
    if kind == "sweep":
        maps = [subject.content for subject in subjects]
        return _maps(subjects, maps, [analyse_map(dataset) for dataset in maps])
    rows, unmatched = _rows(subjects)
    return ComparisonEvaluation(
        subjects, rows, unmatched, responsivity_grid(subjects) if kind == "calibration" else None
    )


def _chains(
    subjects: tuple[Subject, ...], question: Question, progress: Callable[[int, int], None] | None
) -> ComparisonEvaluation:
    """Predict all chains without random numbers, on the optical axis, as `labcdp.Chain.sweep` does."""
    maps, analyses, changed, verdicts = [], [], [], []
    for subject in subjects:
        chain: Chain = subject.content.with_(**question.changes) if question.changes else subject.content
        if question.requirement is not None:
            verdicts.append(judged(subject.name, chain, question.requirement))
            chain = applied(question.requirement, chain)
        wanted = Sweep(chain, question.axes, True, None, question.contrast, question.epsilon)
        try:
            maps.append(run_sweep(wanted, None, progress))
        except InputError as error:
            instead = "; or compare simulated maps of labcdp sweep" if isinstance(error, PredictionError) else ""
            raise InputError(f"{subject.name}: {error}{instead}") from error
        analyses.append(_refined(wanted, maps[-1]))
        changed.append(replace(subject, settings=chain.document))
    return replace(_maps(tuple(changed), maps, analyses), question=question, judged=tuple(verdicts))


def _refined(sweep: Sweep, dataset: Dataset) -> MapAnalysis:
    """Analyse a prediction, over the luminance alone with more points around each end of its usable ranges."""
    from xarray import concat

    (axis, *others), expected = sweep.axes, known_transitions(sweep.chain)
    analysis = analyse_map(dataset, expected=expected)
    for _ in range(0 if others or axis.parameter != LUMINANCES.parameter else _REFINEMENTS):
        intervals = [interval for usable in analysis.usable_ranges for interval in usable.intervals]
        brackets = {end.bracket for interval in intervals for end in interval.ends}
        inner = [
            (np.geomspace if low > 0 else np.linspace)(low, high, _POINTS + 2)[1:-1]
            for low, high in sorted(brackets)
            if low < high
        ]
        if inner:
            values = tuple(np.concatenate(inner).tolist())
            more = run_sweep(replace(sweep, axes=(replace(axis, values=values),)))
            dataset = concat([dataset, more], axis.parameter, data_vars="minimal").sortby(axis.parameter)
            analysis = analyse_map(dataset, expected=expected)
    return analysis


def _maps(
    subjects: tuple[Subject, ...], maps: Sequence[Dataset], analyses: Sequence[MapAnalysis]
) -> ComparisonEvaluation:
    return ComparisonEvaluation(subjects, grid=map_grid(subjects, maps), analyses=tuple(analyses))


def _rows(subjects: tuple[Subject, ...]) -> tuple[tuple[Compared, ...], tuple[str, ...]]:
    first, *others = (values_of(subject) for subject in subjects)
    rows = [
        Compared(subject.name, first[name], other[name], difference(first[name], other[name]))
        for name in first
        for subject, other in zip(subjects[1:], others, strict=True)
        if name in other
    ]
    for subject, values in zip(subjects, (first, *others), strict=True):
        if not values:
            raise InputError(
                f"{subject.name} has no values to compare: the plan names no pairs of patches; evaluate it with --pair "
                "and --contrast, and compare the results"
            )
    if not rows:
        ours, theirs = (", ".join(list(values)[:3]) for values in (first, others[0]))
        raise InputError(f"{subjects[0].name} and {subjects[1].name} have no quantity in common ({ours}; {theirs})")
    every = dict.fromkeys(name for named_values in (first, *others) for name in named_values)
    return tuple(rows), tuple(
        name for name in every if not all(name in named_values for named_values in (first, *others))
    )


def _flat(values: Any, name: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _flat(value, f"{name}.{key}" if name else str(key))
    elif isinstance(values, list | tuple) and any(isinstance(value, Mapping) for value in values):
        for number, value in enumerate(values, start=1):
            yield from _flat(value, f"{name} {number}")
    elif values is not None and name not in ("name", "description"):
        yield name, _text(values)


def _text(value: Any) -> str:
    """Write a setting: lists as "1, 2", lists of lists as "1, 2; 3, 4"."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        between = "; " if any(isinstance(item, list | tuple) for item in value) else ", "
        return between.join(map(_text, value))
    return str(value)
