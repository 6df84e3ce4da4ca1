"""Command compare: results of one kind side by side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import typer

from ...core.errors import InputError
from ...evaluate.compare.compare import LUMINANCES, Question, compare_subjects
from ...evaluate.compare.page import write_comparison
from ...evaluate.compare.result import compare_result
from ...evaluate.compare.subject import picture_task
from ...evaluate.picture.result import PictureTask
from ...evaluate.sweep.plan import parse_axis
from ..options import parse_changes
from ..output import Results
from ..pictures.picture_options import PictureLightOptions
from ..terminal import fraction_of_percent, progress_bars

_CHAINS = "For chains: "


@dataclass(frozen=True)
class QuestionOptions:
    """Options for what chains are asked."""

    over: list[str] = typer.Option(
        [],
        help=f"{_CHAINS}parameter and its values, as for labcdp sweep; may be repeated.",
        show_default="scene.luminance_cd_m2=0.001:100000:121:log",
    )
    contrast: str | None = typer.Option(
        None,
        help="For chains and pictures: contrast to detect, for example 100%; default: contrast of each scene, measured "
        "contrast of each pair.",
    )
    epsilon: str | None = typer.Option(
        None, help="For chains and pictures: relative tolerance of the contrast.", show_default="50%"
    )
    roi: Path | None = typer.Option(
        None, "--roi", help="For pictures: region file, .json of labcdp rois, or .roi or .zip of ImageJ."
    )
    changes: list[str] = typer.Option(
        [], "--set", help=f"{_CHAINS}set a parameter in all, for example scene.contrast=30%; may be repeated."
    )

    def asked(self) -> Question | None:
        """Return what chains are asked; None if no option for them is given."""
        if self.roi is not None or not (self.over or self.contrast or self.epsilon or self.changes):
            return None
        return Question(
            tuple(parse_axis(text) for text in self.over) or (LUMINANCES,),
            parse_changes(self.changes),
            None if self.contrast is None else fraction_of_percent(self.contrast, "--contrast"),
            fraction_of_percent(self.epsilon or "50%", "--epsilon"),
        )

    def of_pictures(self, light: PictureLightOptions) -> PictureTask | None:
        """Return what pictures are asked; None without regions.

        Raises
        ------
        InputError
            If there are options for chains beside regions, or options for pictures without.
        """
        if self.roi is None:
            given = [f"--{name.replace('_', '-')}" for name, value in vars(light).items() if value is not None]
            if given:
                raise InputError(f"{given[0]} is an option for pictures: give their regions with --roi, too")
            return None
        if self.over or self.changes:
            raise InputError("--over and --set are options for chains, --roi is one for pictures: leave one out")
        return picture_task(
            self.roi,
            light.conversion(),
            tuple(light.inputs({"regions": self.roi})),
            None if self.contrast is None else (fraction_of_percent(self.contrast, "--contrast"),),
            fraction_of_percent(self.epsilon or "50%", "--epsilon"),
        )


def compare(
    context: typer.Context,
    question: QuestionOptions,
    light: PictureLightOptions,
    results: Results,
    subjects: list[str] = typer.Argument(
        metavar="A B...",
        help="Chains (presets or files), maps of sweeps, sessions, calibrations, pictures (with --roi), or results of "
        "labcdp evaluate, image or characterise; files or folders of results. Each is compared with the first.",
    ),
) -> None:
    """Compare chains, sessions, calibrations, characterisations, pictures or sweeps, side by side on one page.

    Chains are predicted without random numbers: CDP over the luminance, usable range and difference. Sessions are
    evaluated with their own calibrations, pictures as by labcdp image. All others are compared by their results: values
    with U, z and significance, in which the errors of one meter or calibration are not counted as independent.

    Example: labcdp compare manta-g505 my-chain.toml --contrast 50%
    """
    asked, pictures = question.asked(), question.of_pictures(light)
    with results.folder(context, subjects[0]) as folder:
        with progress_bars() as bars:
            found = compare_subjects(subjects, asked, lambda done, total: bars.update("Cells", done, total), pictures)
        result = compare_result(found)
        write_comparison(found, result, folder)
    results.show(result, folder)
