"""Whether what was seen in pictures, videos and sessions meets a requirement."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, Literal

from ..core.result import Finding, Result, html_table, info, warning
from ..core.table import Column, Table
from ..report.layout import Card, State
from ..report.text import cell_text, fixed
from .verdict import Verdict as Detected
from .verdict import cdp_verdict

if TYPE_CHECKING:
    from .requirement import Requirement

Verdict = Literal["met", "not met", "undecided"]
#: A requirement is met where its contrast is detected.
VERDICTS: dict[Detected, Verdict] = {
    "detected": "met",
    "not detected": "not met",
    "undecided": "undecided",
    "saturated": "undecided",
}
#: Colours of the verdicts.
STATES: dict[Verdict, State] = {"met": "good", "not met": "bad", "undecided": "open"}
#: The worst first.
_ORDER: tuple[Verdict, ...] = ("not met", "undecided", "met")
#: Most cards of a page.
_MOST_CARDS = 4


@dataclass(frozen=True)
class SeenContrast:
    """CDP of the required contrast at one place and time.

    Parameters
    ----------
    pair : str
        The two regions, or which neighbouring pixels.
    where : str
        Picture or frame; empty if there is one only.
    luminance_cd_m2 : float or None
        Of the darker region; None if it is not known.
    contrast : float
        As measured; nan if it is not known.
    saturated : bool
        Whether a region is.
    cdp : float
        Nan if there is none.
    interval : (float, float)
        Ends of its 95 % interval; nan if they are not known.
    scene_contrast : float or None
        By a luminance meter; None without one.
    """

    pair: str
    where: str
    luminance_cd_m2: float | None
    contrast: float
    saturated: bool
    cdp: float
    interval: tuple[float, float]
    scene_contrast: float | None = None


@dataclass(frozen=True)
class JudgedPair:
    """Whether a pair of regions meets a requirement, by the picture or frame that decides it.

    Parameters
    ----------
    pair : str
        The two regions, or which neighbouring pixels.
    verdict : {'met', 'not met', 'undecided'}
        Not met if it is not in one picture or frame, undecided if none could be judged.
    worst : SeenContrast or None
        What decides it, of the lowest CDP; None if nothing could be judged.
    margin : float or None
        CDP minus the limit.
    limit : str
        What the CDP there is limited by, or why nothing could be judged.
    n_judged, n_met, n_seen : int
        Pictures or frames that could be judged, those of them that meet the requirement, and all.
    """

    pair: str
    verdict: Verdict
    worst: SeenContrast | None
    margin: float | None
    limit: str
    n_judged: int
    n_met: int
    n_seen: int


@dataclass(frozen=True)
class Judgement:
    """Whether what was seen meets a requirement.

    Parameters
    ----------
    requirement : Requirement
        What must be detected.
    pairs : tuple of JudgedPair
        In the order of the evaluation.
    findings : tuple of Finding
        What the requirement asks and the pictures do not show.
    """

    requirement: Requirement
    pairs: tuple[JudgedPair, ...]
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """Verdict on all pairs: that of the worst."""
        return worst_verdict([pair.verdict for pair in self.pairs])

    @property
    def table(self) -> Table:
        """The verdict on each pair."""
        several = any(pair.n_seen > 1 for pair in self.pairs)
        columns = [column for column in COLUMNS if several or column.name not in _FOR_SEVERAL]
        note = required_text(self.requirement)
        return Table.of_items("requirement", self.requirement.name, tuple(columns), self.pairs, note)

    def __repr__(self) -> str:
        return f"<labcdp.Judgement {self.requirement.name}: {self.verdict}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        table = self.table
        shown = [column for column in table.columns if column.shown]
        rows = [[cell_text(column, row) for column in shown] for row in table.rows()]
        return html_table([column.label for column in shown], rows, repr(self)[1:-1]) + f"<p>{escape(table.note)}</p>"


def required_text(requirement: Requirement) -> str:
    """Return a requirement as a sentence."""
    low, high = requirement.luminance_cd_m2
    contrast, within, veil = 100 * requirement.contrast, 100 * requirement.epsilon, requirement.glare_cd_m2
    return (
        f"Required: CDP of at least {requirement.cdp_limit:g} for a contrast of {contrast:g} % within {within:g} % of "
        f"it, from {low:g} to {high:g} cd/m², behind a veil of {veil:g} cd/m²."
    )


def worst_verdict(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the worst of some verdicts; undecided if there are none."""
    return min(verdicts, key=_ORDER.index, default="undecided")


def judged_pairs(requirement: Requirement, seen: Iterable[SeenContrast]) -> Judgement:
    """Judge what was seen by a requirement.

    Parameters
    ----------
    requirement : Requirement
        What must be detected.
    seen : iterable of SeenContrast
        CDP of its contrast and tolerance.
    """
    by_pair: dict[str, list[SeenContrast]] = {}
    every = list(seen)
    for contrast in every:
        by_pair.setdefault(contrast.pair, []).append(contrast)
    pairs = tuple(_judge_pair(requirement, pair, contrasts) for pair, contrasts in by_pair.items())
    return Judgement(requirement, pairs, tuple(_not_judged(requirement, every)))


def _why_not(requirement: Requirement, contrast: SeenContrast) -> str:
    """Say why a contrast cannot be judged; empty if it can."""
    low, high = requirement.luminance_cd_m2
    if not isfinite(contrast.cdp):
        return "saturation" if contrast.saturated else "no CDP"
    if contrast.scene_contrast is not None and _is_off(requirement, contrast.scene_contrast):
        return "contrast outside the requirement"
    in_range = contrast.luminance_cd_m2 is None or low <= contrast.luminance_cd_m2 <= high
    return "" if in_range else "luminance outside the requirement"


def _is_off(requirement: Requirement, contrast: float) -> bool:
    return abs(contrast / requirement.contrast - 1) > requirement.epsilon


def _judge_pair(requirement: Requirement, pair: str, seen: Sequence[SeenContrast]) -> JudgedPair:
    limit = requirement.cdp_limit
    judged = [contrast for contrast in seen if not _why_not(requirement, contrast)]
    if not judged:
        why = ", ".join(sorted({_why_not(requirement, contrast) for contrast in seen}))
        return JudgedPair(pair, "undecided", None, None, why, 0, 0, len(seen))
    verdicts = [(_verdict(contrast, limit), contrast) for contrast in judged]
    verdict, worst = min(verdicts, key=lambda judged: (_ORDER.index(judged[0]), judged[1].cdp))
    n_met = sum(verdict == "met" for verdict, _ in verdicts)
    margin = worst.cdp - limit
    return JudgedPair(pair, verdict, worst, margin, _limit(requirement, worst), len(verdicts), n_met, len(seen))


def _verdict(contrast: SeenContrast, limit: float) -> Verdict:
    """Return the verdict on a contrast: where pixels are clipped, a high CDP proves nothing."""
    verdict = VERDICTS[cdp_verdict(contrast.cdp, contrast.interval, limit)]
    return "undecided" if contrast.saturated and verdict == "met" else verdict


def _limit(requirement: Requirement, worst: SeenContrast) -> str:
    """Return what keeps the CDP low or the verdict open: saturation, another contrast, U, or else the scatter."""
    if worst.saturated:
        return "saturation"
    off = isfinite(worst.contrast) and _is_off(requirement, worst.contrast)
    if off:
        return "measured contrast"
    # Less scatter would change nothing where the CDP itself reaches the limit.
    is_open = worst.interval[0] < requirement.cdp_limit <= worst.cdp
    return "uncertainty of the CDP" if is_open else "scatter of the pixels"


def _not_judged(requirement: Requirement, seen: Sequence[SeenContrast]) -> Iterator[Finding]:
    """Yield what the requirement asks and nobody could see."""
    if requirement.temperature_c is not None:
        yield warning("requirement-temperature", temperature_c=requirement.temperature_c)
    if requirement.glare_cd_m2 > 0:
        yield warning("requirement-glare", glare_cd_m2=requirement.glare_cd_m2)
    low, high = requirement.luminance_cd_m2
    known = [contrast.luminance_cd_m2 for contrast in seen if contrast.luminance_cd_m2 is not None]
    if len(known) < len(seen):
        yield warning("requirement-luminance-unknown", low_cd_m2=low, high_cd_m2=high)
    if known:
        judged = [
            contrast.luminance_cd_m2
            for contrast in seen
            if contrast.luminance_cd_m2 and not _why_not(requirement, contrast)
        ]
        ends = {"low_cd_m2": low, "high_cd_m2": high}
        if not judged and not any(low <= luminance <= high for luminance in known):
            yield warning("requirement-luminance-other", found=[min(known), max(known)], **ends)
        elif judged:
            yield warning("requirement-luminance-part", found=[min(judged), max(judged)], **ends)
    others = [
        contrast
        for contrast in seen
        if contrast.scene_contrast is not None and _is_off(requirement, contrast.scene_contrast)
    ]
    for pair in dict.fromkeys(contrast.pair for contrast in others):
        scene_contrast = next(contrast.scene_contrast for contrast in others if contrast.pair == pair)
        assert scene_contrast is not None
        yield warning("requirement-other-contrast", pair, contrast=scene_contrast, required=requirement.contrast)
    n_without = sum(not isfinite(contrast.cdp) for contrast in seen)
    if n_without:
        yield warning("requirement-without-cdp", n=n_without, n_seen=len(seen))
    if requirement.uncertainty_rel:
        yield info("requirement-uncertainty-of-chains")


#: Columns of the table of verdicts.
COLUMNS = (
    Column("pair", "bright / dark", "", "The two regions, or which neighbouring pixels."),
    Column("verdict", "verdict", "", "By the limit and the 95 % interval of the CDP."),
    Column("luminance_cd_m2", "at", "cd/m²", "Luminance of the darker region there, if it is known.",
           value="worst.luminance_cd_m2"),
    Column("where", "in", "", "Picture or frame that decides.", value="worst.where"),
    Column("measured_contrast", "measured contrast", "%", "Weber contrast of the means there.",
           value="worst.contrast"),
    Column("cdp", "lowest CDP", "", "Of the required contrast.", low="cdp_low", high="cdp_high", value="worst.cdp"),
    Column("cdp_low", "lowest CDP, low", "", "Lower end of its 95 % interval.", decimals=5, shown=False,
           value="worst.interval.0"),
    Column("cdp_high", "lowest CDP, high", "", "Upper end of its 95 % interval.", decimals=5, shown=False,
           value="worst.interval.1"),
    Column("margin", "margin", "", "Lowest CDP minus the limit.", decimals=4),
    Column("limit", "limited by", "", "Saturation, a measured contrast that is not the required one, the uncertainty "
           "of a CDP that itself reaches the limit, or the scatter of the pixels."),
    Column("n_met", "met in", "", "Pictures or frames that meet the requirement."),
    Column("n_judged", "of", "", "Pictures or frames that could be judged."),
    Column("n_seen", "all", "", "All pictures or frames.", shown=False),
)  # fmt: skip
_FOR_SEVERAL = ("where", "n_met", "n_judged", "n_seen")


def requirement_cards(result: Result) -> list[Card]:
    """Return a card for each pair that was judged by a requirement; none for a result without one."""
    cards = []
    for table in result.tables_named("requirement"):
        # The worst ones are those that decide.
        rows = sorted(table.rows(), key=lambda row: (_ORDER.index(row["verdict"]), _number(row["margin"])))
        cards += [_card(table, row) for row in rows[:_MOST_CARDS]]
    return cards


def _number(value: float | None) -> float:
    return inf if value is None else value


def _card(table: Table, row: Mapping[str, Any]) -> Card:
    verdict: Verdict = row["verdict"]
    lines = [row["pair"], f"limited by {row['limit']}"]
    if row["margin"] is None:
        return Card(table.title, verdict, row["limit"], (row["pair"],), state=STATES[verdict])
    if row["luminance_cd_m2"] is not None:
        lines.append(f"at {row['luminance_cd_m2']:.3g} cd/m²")
    if row.get("n_seen") is not None:
        lines.append(f"met in {row['n_met']} of {row['n_judged']}, decided by {row['where']}")
    margin = fixed(row["margin"], 3, sign=True)
    return Card(
        table.title, verdict, f"CDP {fixed(row['cdp'], 3)}, margin {margin}", tuple(lines), state=STATES[verdict]
    )


def verdicts_of(result: Result) -> dict[str, Verdict]:
    """Return the verdict on each pair of a result, of several videos on each video; none without a requirement."""
    return {
        " ".join(row[name] for name in ("video", "pair") if name in row): row["verdict"]
        for table in result.tables_named("requirement")
        for row in table.rows()
    }
