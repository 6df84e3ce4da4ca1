"""Live numbers of an acquisition as a line and as a table."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..acquire import Live, PatchNumbers


def live_line(live: Live) -> str:
    """Sum up an exposure: the extremes of its patches, with their names."""
    parts = [f"{live.role} {live.exposure_s:.3g} s"]
    if live.patches:
        dark, bright = _extremes(live, lambda n: n.mean_dn)
        noise = max((n.temporal_noise_dn or 0.0 for n in live.patches), default=0.0)
        parts.append(f"mean {dark.mean_dn:.1f} ({dark.patch}) to {bright.mean_dn:.1f} DN ({bright.patch})")
        _, saturated = _extremes(live, lambda n: n.saturated_share)
        where = f" ({saturated.patch})" if saturated.saturated_share else ""
        parts.append(f"saturated {saturated.saturated_share:.2%}{where}")
        parts.append(f"noise {noise:.2f} DN")
        # The brightest unsaturated patch shows drift best; in dark patches noise hides it.
        steady = [n for n in live.patches if not n.saturated_share and n.drift_rel is not None]
        if steady:
            best = max(steady, key=lambda n: n.mean_dn)
            parts.append(f"drift {best.drift_rel:+.2%} ({best.patch})")
    if live.temperature_c is not None:
        parts.append(f"{live.temperature_c:.1f} C")
    return ", ".join(parts)


def live_table(live: Live) -> Any:
    """Make a rich table, one row a patch."""
    from rich.table import Table

    table = Table("patch", "mean DN", "saturated", "noise DN", "drift", box=None, padding=(0, 2, 0, 0))
    for column in table.columns[1:]:
        column.justify = "right"
    for n in live.patches:
        noise = "" if n.temporal_noise_dn is None else f"{n.temporal_noise_dn:.2f}"
        drift = "" if n.drift_rel is None else f"{n.drift_rel:+.2%}"
        table.add_row(n.patch, f"{n.mean_dn:.1f}", f"{n.saturated_share:.2%}", noise, drift)
    return table


def _extremes(live: Live, key: Callable[[PatchNumbers], float]) -> tuple[PatchNumbers, PatchNumbers]:
    return min(live.patches, key=key), max(live.patches, key=key)
