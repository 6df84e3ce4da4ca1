"""Many pictures in a few numbers: mean, spread, worst and trend of the CDP of each pair; and the page of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.result import Result
from ...core.table import Column, Table, with_expanded
from ...report.drawing import finish, placed_figure, reported
from ...report.html import render_page
from ...report.layout import Block, Card, Links, Page, ReportFigure, Section, State, facts_table
from ...report.text import cell_text, fixed, percent, shortened, significant, with_half_width
from ..judgement import requirement_cards
from ..verdict import changes_of
from .image import MeasuredPicture

#: Colours of curves, and so the most of them.
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#8C6D1F", "black")
#: Cards of a page, and of one pair.
_MOST_CARDS, _MOST_OF_PAIR = 8, 2
#: Rows of the table of all pictures that is shown at once; a longer one is collapsed.
MOST_ROWS = 12
#: Pictures with the lowest CDP whose pages are named before those of all.
_MOST_WORST = 10
#: Pictures from which on a trend is given.
_LEAST_OF_TREND = 5

_COLUMNS = (
    Column("pair", "bright / dark region", "", "The two regions, or which neighbouring pixels."),
    Column("contrast", "target contrast", "%", "Contrast whose CDP is computed; empty if it is that of each picture.",
           digits=0),
    Column("n_pictures", "pictures", "", "Pictures that have a CDP of it."),
    Column("mean_cdp", "mean CDP", "", "Mean over these pictures.", decimals=4),
    Column("std_cdp", "standard deviation", "", "Of the CDP from picture to picture, with n - 1.", decimals=4),
    Column("lowest_cdp", "lowest CDP", "", "Lowest of them.", decimals=4),
    Column("lowest_picture", "in picture", "", "The first picture with the lowest CDP."),
    Column("lowest_number", "number of it", "", "Its number, in the order given.", shown=False),
    *with_expanded(
        Column("cdp_trend", "change first to last", "",
               "Change of the CDP from the first to the last picture, by a straight line over their order."),
        "", "expanded_cdp_trend",
    ),
    Column("n_detected", "detected", "", "Pictures in which the contrast is detected."),
    Column("n_not_detected", "not detected", "", "Pictures in which it is not."),
    Column("n_undecided", "undecided", "", "Pictures in which the 95 % interval of the CDP includes the limit."),
    Column("mean_measured_contrast", "mean measured contrast", "%", "Mean of the measured contrasts, without bounds."),
    Column("std_measured_contrast", "standard deviation of it", "%", "From picture to picture, with n - 1.", 2),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Series:
    """Rows of a pair and a target contrast, None for that of each picture, in the order of the pictures."""

    pair: str
    contrast: float | None
    rows: Sequence[Mapping[str, Any]]

    @property
    def known(self) -> list[Mapping[str, Any]]:
        """Rows that have a CDP."""
        return [row for row in self.rows if row["cdp"] is not None and np.isfinite(row["cdp"])]

    def values(self, name: str) -> NDArray[np.float64]:
        """Return the values of a column that are known and no bounds."""
        values = [row[name] for row in self.rows if not row.get(f"{name}_bound") and row[name] is not None]
        array: NDArray[np.float64] = np.array(values, dtype=float)
        known: NDArray[np.float64] = array[np.isfinite(array)]
        return known


def _series(cdp: Table) -> list[_Series]:
    rows_by_pair: dict[tuple[str, float | None], list[Mapping[str, Any]]] = {}
    for row in cdp.rows():
        # What is measured differs from picture to picture.
        contrast = row["contrast"] if row["contrast_origin"] == "given" else None
        rows_by_pair.setdefault((row["pair"], contrast), []).append(row)
    return [_Series(*key, rows) for key, rows in rows_by_pair.items()]


def summary_table(cdp: Table, limit: float) -> Table:
    """Return mean, spread, worst and trend of each pair and target contrast, from the table of all pictures."""
    note = (
        f"Detected: CDP ≥ {limit:g}. The change from the first to the last picture is that of a straight line over "
        "their order, ± U (95 %) by their scatter about it."
    )
    return Table.of_items("over_pictures", "Over all pictures", _COLUMNS, map(_row, _series(cdp)), note)


def _row(series: _Series) -> dict[str, Any]:
    known = series.known
    row: dict[str, Any] = {"pair": series.pair, "contrast": series.contrast, "n_pictures": len(known)}
    measured = series.values("measured_contrast")
    if measured.size:
        row["mean_measured_contrast"] = float(measured.mean())
    if measured.size > 1:
        row["std_measured_contrast"] = float(measured.std(ddof=1))
    verdicts = [row["verdict"] for row in known]
    row |= {f"n_{name.replace(' ', '_')}": verdicts.count(name) for name in ("detected", "not detected", "undecided")}
    if not known:
        return row
    cdp = np.array([row["cdp"] for row in known])
    worst = known[int(cdp.argmin())]
    row |= {"mean_cdp": float(cdp.mean()), "lowest_cdp": worst["cdp"]}
    row |= {"lowest_picture": worst["picture"], "lowest_number": worst["number"]}
    if cdp.size > 1:
        row["std_cdp"] = float(cdp.std(ddof=1))
    if cdp.size >= _LEAST_OF_TREND:
        row["cdp_trend"], row["expanded_cdp_trend"] = trend(
            np.array([row["number"] for row in known], dtype=float), cdp
        )
    return row


def trend(at: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the change of a straight line by least squares from its first to its last point, and its U (95 %).

    Parameters
    ----------
    at : ndarray of float, shape (n,)
        Rising.
    values : ndarray of float, shape (n,)
        At least three.
    """
    from scipy.stats import t

    x = at - at.mean()
    slope = float(x @ values / (x @ x))
    dof = at.size - 2
    left = values - values.mean() - slope * x
    u = sqrt(float(left @ left) / dof / float(x @ x))
    length = float(at[-1] - at[0])
    return slope * length, float(t.ppf(0.975, dof)) * u * length


def summary_cards(summary: Table, limit: float) -> Iterator[Card]:
    """Yield a card for each pair, of the contrasts where the answer changes."""
    pairs: dict[str, list[dict[str, Any]]] = {}
    for row in summary.rows():
        pairs.setdefault(row["pair"], []).append(row)
    most = _MOST_OF_PAIR if len(pairs) > 1 else _MOST_OF_PAIR + 1
    shown = [rows[at] for rows in pairs.values() for at in changes_of([*map(_answer, rows)], most)]
    for row in shown[:_MOST_CARDS]:
        yield _card(row, limit)


def _answer(row: Mapping[str, Any]) -> float | None:
    """Return how far the contrast is detected; where that is the same, the CDP decides."""
    if not row["n_pictures"]:
        return None
    return float((row["n_detected"] - row["n_not_detected"]) / row["n_pictures"] + row["mean_cdp"] / 100)


def _card(row: Mapping[str, Any], limit: float) -> Card:
    what = (
        "at the contrast of each picture" if row["contrast"] is None else f"target contrast {percent(row['contrast'])}"
    )
    n = row["n_pictures"]
    if not n:
        return Card(row["pair"], "no result", "", (what, "no picture has a CDP of it"), state="open")
    spread = "" if row["std_cdp"] is None else f", standard deviation {fixed(row['std_cdp'], 3)}"
    lines = [what, f"lowest CDP {fixed(row['lowest_cdp'], 3)} in {row['lowest_picture']}"]
    if row["cdp_trend"] is not None:
        lines.append(f"first to last {with_half_width(row['cdp_trend'], row['expanded_cdp_trend'])}")
    if row["mean_measured_contrast"] is not None:
        lines.append(f"mean measured contrast {significant(100 * row['mean_measured_contrast'], 3)} %")
    counts = [f"{row[key]} undecided" for key in ("n_undecided",) if row[key]]
    lines.append(", ".join([f"detected if CDP ≥ {limit:g}", *counts]))
    state: State = "good" if row["n_detected"] == n else "bad" if row["n_not_detected"] == n else "open"
    verdict = f"detected in {row['n_detected']} of {n}"
    return Card(row["pair"], fixed(row["mean_cdp"], 3), f"mean CDP{spread}", tuple(lines), verdict, state)


def trend_figure(cdp: Table, summary: Table, limit: float) -> ReportFigure:
    """Draw the CDP of the contrasts of the cards over the pictures in their order."""
    chosen = [series for series in _series(cdp) if series.known]
    means = [float(np.mean([row["cdp"] for row in series.known])) for series in chosen]
    drawn = [chosen[at] for at in changes_of(means, len(_COLOURS))]
    figure = placed_figure(9.0, 3.4)
    axes = figure.add_axes((0.08, 0.16, 0.6, 0.74))
    axes.axhline(limit, color="0.6", linewidth=0.8, linestyle=":")
    for curve, colour in zip(drawn, _COLOURS, strict=False):
        what = "" if curve.contrast is None else f", {percent(curve.contrast)}"
        numbers = [row["number"] for row in curve.known]
        axes.plot(numbers, [row["cdp"] for row in curve.known], ".-", color=colour, linewidth=0.8, markersize=4,
                  label=f"{shortened(curve.pair, 24)}{what}")  # fmt: skip
    axes.set_ylim(-0.02, 1.05)
    beside = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "frameon": False}
    finish(axes, "number of the picture, in the order given", "CDP", "CDP from picture to picture", **beside)
    left_out = f" {len(drawn)} of {len(summary)} are drawn." if len(drawn) < len(summary) else ""
    caption = f"CDP of each picture; the dotted line is the limit of {limit:g}.{left_out}"
    return reported("over-pictures", figure, caption, f"Curves of CDP over the pictures. {caption}")


def overview_page(result: Result, pictures: Sequence[MeasuredPicture], conversion: str) -> str:
    """Return the page over several pictures: mean, spread, worst and trend, then all rows and the page of each.

    Parameters
    ----------
    result : Result
        Of all pictures.
    pictures : sequence of MeasuredPicture
        In the order they were given.
    conversion : str
        Description of the conversion to luminance.
    """
    failed = sum(picture.source is None for picture in pictures)
    pages = {
        picture.number: (picture.file, f"{picture.folder}/report.html")
        for picture in pictures
        if picture.source is not None and picture.folder
    }
    evaluated = f"{len(pictures) - failed} of {len(pictures)} pictures were evaluated." if failed else ""
    cards: list[Card] = []
    lead: list[Block] = []
    sections = [Section("Requirement", [table]) for table in result.tables_named("requirement")]
    charts = [(picture.file, picture.chart) for picture in pictures if picture.chart is not None]
    if charts:
        from ..chart.figures import luminance_figure

        sections.append(Section("Chart", [luminance_figure(charts), *result.tables_named("dynamic_range")]))
    # Neighbours without light have no contrast at all.
    for cdp in result.tables_named("cdp"):
        summary, limit = result.table("over_pictures"), cdp["cdp_limit"][0]
        cards, lead = [*summary_cards(summary, limit)], [trend_figure(cdp, summary, limit)]
        sections += [
            Section("", [summary]),
            *(
                [Section("Pictures with the lowest CDP", [Links(_worst(cdp, pages))])]
                if len(pages) > _MOST_WORST
                else []
            ),
            Section("All pictures", [cdp], len(cdp) > MOST_ROWS),
        ]
    sections += [
        *([Section("Pages of the pictures", [Links([*pages.values()])], len(pages) > _MOST_WORST)] if pages else []),
        Section("Details", result.tables_named("regions", "pictures"), True),
        Section("Provenance", [facts_table([("conversion", conversion)])], collapsed=True),
    ]
    return render_page(
        Page.of(
            result,
            "Contrast detection probability (CDP) of pictures",
            evaluated,
            cards=[*requirement_cards(result), *cards],
            lead=lead,
            sections=sections,
        )
    )


def _worst(cdp: Table, pages: Mapping[int, tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the pages of the pictures with the lowest CDP, each with what it is of."""
    worst: dict[int, tuple[str, str]] = {}
    for row in cdp.sorted_by("cdp").rows():
        if row["cdp"] is not None and row["number"] in pages and len(worst) < _MOST_WORST:
            file, page = pages[row["number"]]
            text = f"{file}: CDP {cell_text(cdp.column('cdp'), row)} of {row['pair']}"
            worst.setdefault(row["number"], (text, page))
    return [*worst.values()]
