"""The table of colour separation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...core.table import Column, Table, with_interval
from .measure import PairColours

_NOTE = (
    "Distance is the Mahalanobis distance of the mean colours by the pooled covariance; CSP = Φ(distance / 2), the "
    "share of pixels that are on their side of the best plane between both. The counted share has each region with a "
    "covariance of its own. Pairs detected is the share of all pairs of pixels whose difference of chromaticity is "
    "within the tolerance of that of the means."
)


def colour_table(pictures: Sequence[tuple[str, tuple[PairColours, ...]]], several: bool) -> Table:
    """Return the separation of pairs of regions in pictures, by the names of their files."""
    items = [(file, pair, pair.separation) for file, pairs in pictures for pair in pairs]
    picture = Column("picture", "picture", "", "Name of the file.", shown=several, value="0")
    columns = (
        Column("pair", "regions", "", "The two regions.", value="1.name"),
        *with_interval(Column("distance", "distance", "", "Mahalanobis distance, pooled covariance.", 3,
                              value="2.distance.value"), "2.distance.interval"),
        *with_interval(Column("csp", "CSP", "", "Colour separation probability, pooled covariance.", decimals=4,
                              value="2.csp.value"), "2.csp.interval"),
        *with_interval(Column("csp_counted", "counted share", "", "Share of pixels nearer to their own region, each "
                              "region with a covariance of its own.", decimals=4, value="2.csp_counted.value"),
                       "2.csp_counted.interval"),
        *with_interval(Column("detected", "pairs detected", "", "Share of the pairs of pixels that keep the "
                              "difference of chromaticity.", decimals=4, value="2.detected.value"),
                       "2.detected.interval"),
        Column("u_distance", "u of distance", "", "Standard uncertainty.", 2, shown=False, value="2.distance.u"),
        Column("u_csp", "u of CSP", "", "Standard uncertainty.", 2, shown=False, value="2.csp.u"),
        Column("u_csp_counted", "u of counted share", "", "Standard uncertainty.", 2, shown=False,
               value="2.csp_counted.u"),
        Column("u_detected", "u of pairs detected", "", "Standard uncertainty.", 2, shown=False, value="2.detected.u"),
        Column("csp_bound", "least share", "", "Bhattacharyya bound of the share of pixels nearer to their own region.",
               shown=False, value="2.csp_bound"),
        Column("tolerance", "tolerance", "%", "Of the difference of chromaticity.", 0, shown=False, value="2.epsilon"),
    )  # fmt: skip
    ordered = (picture, *columns) if several else (*columns, replace(picture, shown=False))
    return Table.of_items("colour_separation", "Colour separation", ordered, items, _NOTE)
