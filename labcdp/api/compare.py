"""Things of one kind side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from xarray import Dataset

from ..calibration import AnyCalibration
from ..core.errors import InputError
from ..core.result import InputFile, html_table
from ..evaluate.compare.compare import LUMINANCES, ComparisonEvaluation, Question, compare_subjects
from ..evaluate.compare.requirement import Judged
from ..evaluate.compare.result import answer, compare_result
from ..evaluate.compare.subject import picture_settings
from ..evaluate.picture.settings import ImageSettings
from ..evaluate.requirement import Requirement
from ..evaluate.sweep.plan import Axis
from ..files.transfer import Encoding
from ..report.files import envelope
from ..report.text import finding_text, text_table
from .arguments import Contrasts, PathArgument, as_contrasts, as_number, as_path
from .picture import Stated, converter_of
from .session import CalibratedSession


def compare(
    *subjects: Any,
    contrast: Contrasts | None = None,
    epsilon: float | str = 0.5,
    progress: Callable[[int, int], None] | None = None,
    regions: PathArgument | None = None,
    requirement: Requirement | PathArgument | None = None,
    **options: Any,
) -> Comparison:
    """Compare chains, sweeps, sessions, calibrations, characterisations or pictures, as ``labcdp compare`` does.

    Parameters
    ----------
    *subjects : path, Chain, Dataset, Session, SessionResult, CalibratedSession or Calibration
        At least two of one kind; each is compared with the first. A path is a preset, or a file or folder that
        ``labcdp compare`` takes; of a picture, with its regions.
    contrast : float, str, array_like of them, or None
        For chains and pictures: Weber contrasts to be detected, fractions or percentages such as "50%"; None for that
        of each scene, or the measured one of each pair.
    epsilon : float
        For chains and pictures: its relative tolerance.
    progress : callable or None
        Called with the number of cells of a chain's prediction that are done, and of all.
    regions : path or None
        For pictures: region file.
    requirement : Requirement, path or None
        For chains: what each is judged by, in the place of contrast, tolerance and varied parameters; `judged` of the
        comparison has the verdicts.
    **options
        For chains: parameters and their values, as for `Chain.sweep`; none for a range of luminances. For pictures:
        what `read_image` takes, such as ``calibration``.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If subjects cannot be read or compared.

    Examples
    --------
    >>> import labcdp
    >>> first, second = (labcdp.Chain.load("manta-g505").with_(optics__f_number=f) for f in (2.8, 4.0))
    >>> labcdp.compare(first, second, scene__luminance_cd_m2=[1.0, 10.0], contrast=1.0).to_dataset()["value"].dims
    ('subject', 'scene.luminance_cd_m2')
    """
    sources = [subject.calibration if isinstance(subject, CalibratedSession) else subject for subject in subjects]
    epsilon = as_number(epsilon, "epsilon")
    if regions is not None:
        return Comparison(
            compare_subjects(sources, _picture_comparison(regions, contrast, epsilon, **options), progress)
        )
    if requirement is not None:
        if contrast is not None or epsilon != 0.5 or any(np.ndim(value) for value in options.values()):
            raise InputError("a requirement has its own contrast, tolerance and luminances: leave out those given")
        if not isinstance(requirement, Requirement):
            requirement = Requirement.load(as_path(requirement, "requirement"))
        changes = {name if "." in name else name.replace("__", "."): value for name, value in options.items()}
        return Comparison(compare_subjects(sources, Question.by(requirement, changes), progress))
    varied = tuple(Axis(name if "." in name else name.replace("__", "."), values) for name, values in options.items())
    with_question = contrast is not None or epsilon != 0.5 or varied
    targets = as_contrasts(contrast, epsilon).targets
    question = Question(varied or (LUMINANCES,), None, targets, epsilon) if with_question else None
    return Comparison(compare_subjects(sources, question, progress))


def _picture_comparison(
    regions: PathArgument,
    contrast: Contrasts | None,
    epsilon: float,
    calibration: PathArgument | AnyCalibration | None = None,
    camera_spec: PathArgument | None = None,
    encoding: Encoding | None = None,
    **stated: Unpack[Stated],
) -> ImageSettings:
    """Return the settings with which pictures are evaluated, from the arguments of `compare` and `read_image`."""
    files = {"calibration": calibration, "camera specification": camera_spec}
    return picture_settings(
        as_path(regions, "regions"),
        converter_of(calibration, camera_spec, encoding, stated, Stated),
        tuple(InputFile.of(role, Path(path)) for role, path in files.items() if isinstance(path, str | PathLike)),
        as_contrasts(contrast, epsilon).values,
        epsilon,
    )


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Things side by side; made by `compare`.

    Parameters
    ----------
    comparison : labcdp.evaluate.compare.compare.ComparisonEvaluation
        All results.

    Examples
    --------
    >>> import labcdp
    >>> first, second = (labcdp.Chain.load("manta-g505").with_(optics__f_number=f) for f in (2.8, 4.0))
    >>> found = labcdp.compare(first, second, scene__luminance_cd_m2=[1.0, 10.0], contrast=1.0)
    >>> found.to_dataset()["value"].shape
    (2, 2)
    """

    comparison: ComparisonEvaluation

    @property
    def answer(self) -> str:
        """The differences in a sentence or two."""
        return "; ".join(finding_text(finding) for finding in answer(self.comparison))

    @property
    def judged(self) -> tuple[Judged, ...]:
        """The verdict on each chain by the requirement, if one was given."""
        return self.comparison.judged

    def to_dict(self) -> dict[str, Any]:
        """Return the content of results.json."""
        return envelope(compare_result(self.comparison))

    def to_dataset(self) -> Dataset:
        """Return values and differences: of curves and maps over subject and axes, else a row for each quantity."""
        grid = self.comparison.grid
        if grid is None:
            dataset = compare_result(self.comparison).table("differences").to_dataset()
            for variable in dataset.values():
                # Each row has a unit of its own.
                variable.attrs.pop("units", None)
            return dataset
        dims = ["subject", *(axis.name for axis in grid.axes)]
        values = np.stack([np.asarray(array.value) for array in grid.values])
        unknown = np.full_like(values[:1], np.nan)
        data = {
            name: (
                dims,
                np.concatenate([unknown, *(getattr(difference, part)[None] for difference in grid.differences)]),
            )
            for name, part in (("difference", "value"), ("difference_low", "low"), ("difference_high", "high"))
        }
        coordinates: dict[str, Any] = {"subject": [subject.name for subject in self.comparison.subjects]}
        coordinates |= {axis.name: axis.values for axis in grid.axes}
        attributes = {"title": grid.quantity, "relative": int(grid.relative)}
        return Dataset({"value": (dims, values), **data}, coordinates, attributes)

    def __repr__(self) -> str:
        names = ", ".join(subject.name for subject in self.comparison.subjects)
        return f"<labcdp.Comparison of {self.comparison.kind}s {names}: {self.answer}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        table = compare_result(self.comparison).tables[0]
        heads, rows = text_table(table)
        return html_table(tuple(heads), [tuple(row) for row in rows], repr(self)[1:-1])
