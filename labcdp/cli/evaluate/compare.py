"""Command compare: results of one kind side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..options import parse_changes
from ..output import FORCE_OPTION, OPEN_OPTION, output_option, results_folder, show_page
from ..terminal import JSON_OPTION, fraction_of_percent, print_result, progress_bars, say

if TYPE_CHECKING:
    from ...evaluate.compare.compare import Question

_CHAINS = "For chains: "


def compare(
    context: typer.Context,
    things: list[str] = typer.Argument(
        metavar="A B...",
        help="Chains (presets or files), maps of sweeps, sessions, calibrations, or results of labcdp evaluate, image "
        "or characterise; files or folders of results. Each is compared with the first.",
    ),
    over: list[str] = typer.Option(
        [],
        help=f"{_CHAINS}parameter and its values, as for labcdp sweep; may be repeated.",
        show_default="scene.luminance_cd_m2=0.001:100000:121:log",
    ),
    contrast: str | None = typer.Option(
        None, help=f"{_CHAINS}contrast to detect, for example 100%; default: contrast of each scene."
    ),
    epsilon: str | None = typer.Option(None, help=f"{_CHAINS}relative tolerance of the contrast.", show_default="50%"),
    changes: list[str] = typer.Option(
        [], "--set", help=f"{_CHAINS}set a parameter in all, for example scene.contrast=30%; may be repeated."
    ),
    output: Path | None = output_option("A-compare"),
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Compare chains, sessions, calibrations, characterisations, pictures or sweeps, side by side on one page.

    Chains are predicted without random numbers: CDP over the luminance, usable range and difference. Sessions are
    evaluated with their own calibrations. All others are compared by their results: values with U, z and significance,
    in which the errors of one meter or calibration are not counted as independent.

    Example: labcdp compare manta-g505 my-chain.toml --contrast 50%
    """
    from ...evaluate.compare.compare import compare_things
    from ...evaluate.compare.page import write_comparison
    from ...evaluate.compare.result import compare_result

    question = _question(over, contrast, epsilon, changes)
    with results_folder(context, things[0], output, force) as results:
        with progress_bars() as bars:
            found = compare_things(things, question, lambda done, total: bars.update("Cells", done, total))
        result = compare_result(found)
        write_comparison(found, result, results)
    print_result(result, as_json)
    say(f"Report: {results.folder / 'report.html'}")
    show_page(results.folder / "report.html", open_page)


def _question(over: list[str], contrast: str | None, epsilon: str | None, changes: list[str]) -> Question | None:
    """Return what chains are asked; None if no option for them is given."""
    from ...evaluate.compare.compare import LUMINANCES, Question
    from ...evaluate.sweep.axis import parse_axis

    if not (over or contrast or epsilon or changes):
        return None
    return Question(
        tuple(parse_axis(text) for text in over) or (LUMINANCES,),
        parse_changes(changes),
        None if contrast is None else fraction_of_percent(contrast, "--contrast"),
        fraction_of_percent(epsilon or "50%", "--epsilon"),
    )
