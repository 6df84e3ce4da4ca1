"""The numbers of a video's frames: names, labels, units and meanings, for Datasets and spreadsheets alike."""

from __future__ import annotations

from ...core.table import Column


def _column(name: str, label: str, unit: str, decimals: int, meaning: str) -> Column:
    return Column(name, label, unit, meaning, decimals=decimals)


#: Stands for the unit of the video's means: cd/m² or none.
LIGHT = "light"
#: Over frame and contrast.
OF_CONTRAST = (
    _column("cdp", "CDP", "", 4, "Contrast detection probability."),
    _column("cdp_standard_uncertainty", "u of CDP", "", 4, "Standard uncertainty of the CDP."),
    _column("cdp_low", "CDP, low end of 95 %", "", 4, "Lower end of the 95 % interval of the CDP."),
    _column("cdp_high", "CDP, high end of 95 %", "", 4, "Upper end of the 95 % interval of the CDP."),
    _column("below", "share below", "", 4, "Share of pairs with a lower contrast."),
    _column("above", "share above", "", 4, "Share of pairs with a higher contrast."),
)
#: Over frame.
OF_FRAME = (
    _column("measured_contrast", "measured contrast", "%", 2, "Weber contrast of the regions' means."),
    _column(
        *("measured_contrast_standard_uncertainty", "u of measured contrast", "%", 2),
        "Standard uncertainty of the contrast.",
    ),
    _column("csnr", "CSNR", "", 2, "Contrast signal-to-noise ratio."),
    _column("csnr_standard_uncertainty", "u of CSNR", "", 3, "Standard uncertainty of the CSNR."),
    _column("reference_contrast", "reference contrast", "%", 2, "Contrast the frame is compared with."),
    _column("reference_cdp", "CDP of reference", "", 4, "Contrast detection probability of the reference contrast."),
    _column("reference_cdp_low", "CDP of reference, low end of 95 %", "", 4, "Lower end of its 95 % interval."),
    _column("reference_cdp_high", "CDP of reference, high end of 95 %", "", 4, "Upper end of its 95 % interval."),
)
#: Over frame and region.
OF_REGION = (
    _column("mean", "mean", LIGHT, 4, "Mean of the region."),
    _column("mean_standard_uncertainty", "u of mean", LIGHT, 5, "Standard uncertainty of the mean."),
    _column("snr", "spatial SNR", "", 2, "Mean over standard deviation of the pixels of the frame."),
    _column("snr_standard_uncertainty", "u of spatial SNR", "", 3, "Standard uncertainty of the spatial SNR."),
    _column("saturated", "share saturated", "", 4, "Share of saturated pixels."),
    _column("quality", "tracking quality", "", 3, "Quality of the tracking, 0 to 1."),
    _column("lost", "lost", "", 0, "Whether the region was lost: 1 or 0."),
    _column("centre_x", "centre x", "pixel", 2, "Middle of the region, to the right."),
    _column("centre_y", "centre y", "pixel", 2, "Middle of the region, down."),
)
#: Over frame, region and corner.
OF_CORNER = (
    _column("corner_x", "x", "pixel", 2, "Corners of the region, to the right."),
    _column("corner_y", "y", "pixel", 2, "Corners of the region, down."),
)
TIME = _column("time_s", "time", "s", 3, "Time since the first frame.")
NOTE = Column("note", "note", meaning="Why a value is missing, or a warning about it.")
FINDINGS = Column("findings", "findings", meaning="The notes with code, subject and values, as JSON.")


def names(columns: tuple[Column, ...]) -> tuple[str, ...]:
    """Return the names of columns."""
    return tuple(column.name for column in columns)
