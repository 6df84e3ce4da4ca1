"""Columns of regions, their contrast and its CDP, for the tables and Datasets of pictures, videos and sessions."""

from __future__ import annotations

from dataclasses import replace

from ..core.table import Column, uncertain, with_bound

#: Columns that take their values from a `Cdp`: the probability, and the shares of the pairs to either side.
CDP = (
    Column("cdp", "CDP", "", "Share of the pairs of pixels that are detected.", low="cdp_low", high="cdp_high",
           value="cdp"),
    Column("cdp_low", "CDP, low", "", "Lower end of the 95 % interval, by pixels and calibration.", decimals=5,
           shown=False, value="interval.0"),
    Column("cdp_high", "CDP, high", "", "Upper end of the 95 % interval.", decimals=5, shown=False,
           value="interval.1"),
    Column("u_cdp", "u of CDP", "", "Standard uncertainty, by pixels and calibration.", 2, shown=False,
           value="u"),
)  # fmt: skip
SHARES = (
    Column("below", "share below", "", "Share of the pairs with a lower contrast.", decimals=4, value="below"),
    Column("above", "share above", "", "Share of the pairs with a higher contrast.", decimals=4, value="above"),
    Column("undefined", "undefined", "", "Share of the pairs without light; they count as below.", shown=False,
           value="undefined"),
)  # fmt: skip
TARGET = Column("contrast", "target contrast", "%", "Contrast whose CDP is computed.", value="contrast")
#: Columns that take their values from a `Pair`.
CONTRAST = with_bound(
    uncertain(
        Column("measured_contrast", "measured contrast", "%", "Weber contrast of the means.", value="contrast.value"),
        u="contrast.u",
    ),
    "bound",
)
CSNR = uncertain(
    Column("csnr", "CSNR", "", "Mean over standard deviation of the contrasts of all pairs of pixels.", 3,
           value="csnr.value"),
    u="csnr.u",
)  # fmt: skip


def region_columns(unit: str, unit_of: str = "") -> tuple[Column, ...]:
    """Return the columns of a `RegionLight`, in a unit or in those of a column."""
    return (
        Column("region", "region", value="roi.name"),
        Column("pixels", "pixels", meaning="Number of its pixels, all of which are used.", value="n_pixels"),
        *with_bound(
            uncertain(Column("mean", "mean", unit, "Mean luminance.", unit_of=unit_of), u="u"),
            "bound",
        ),
        Column("std", "standard deviation", unit, "Of the pixels, with n - 1.", 3, unit_of=unit_of),
        *uncertain(Column("snr", "spatial SNR", "", "Mean over standard deviation of the pixels.", 3,
                          value="snr.value"), u="snr.u"),
    )  # fmt: skip


def invalid_share(reason: str, shown: bool = False) -> Column:
    """Return the column of a `RegionLight` with the share of the pixels that are invalid for a reason."""
    return Column(
        reason, reason.replace("_", " "), "%", "Share of the pixels that are not valid for this reason.", 2,
        shown=shown, value=lambda region: float(region.invalid_shares.get(reason, 0.0)),
    )  # fmt: skip


def by_itself(*columns: Column) -> tuple[Column, ...]:
    """Return columns as variables, each by itself: u stays, which a bound has none of, and U goes."""
    kept = (column for column in columns if not (column.name.startswith("expanded_") or column.name.endswith("_bound")))
    return tuple(replace(column, expanded="", low="", high="", bound="") for column in kept)
