"""Noise and non-uniformity of a camera as its twin needs them: in DN, before rounding."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, sqrt

from ..calibration.emva.result import Characterisation, Quantity
from ..calibration.pixel_statistics import pixel_statistics
from ..errors import CalibrationError
from ..session import Session
from .twin_rounding import DITHERED_DN2, DarkSpread, largest_unseen_spread, unrounded


@dataclass(frozen=True)
class CameraNoise:
    """Noise of a camera in DN, at the gain of the session.

    Parameters
    ----------
    k_dn_per_e : Quantity
        Overall system gain K.
    read_noise_dn : Quantity
        Temporal noise of a pixel at zero exposure, before rounding.
    prnu_rel : Quantity
        Standard deviation of the pixels' gains over their mean.
    dsnu_dn, row_dsnu_dn, column_dsnu_dn : Quantity
        Standard deviation of the offsets of pixels, rows and columns at zero exposure.
    dsnu_dn_s : Quantity
        Standard deviation of the pixels' dark currents, DN per second.
    """

    k_dn_per_e: Quantity
    read_noise_dn: Quantity
    prnu_rel: Quantity
    dsnu_dn: Quantity
    row_dsnu_dn: Quantity
    column_dsnu_dn: Quantity
    dsnu_dn_s: Quantity


@dataclass(frozen=True)
class Darkness:
    """Dark frames of one exposure.

    Parameters
    ----------
    mean_dn : float
        Mean over pixels and frames.
    spread : DarkSpread
        Spread of the values, as rounded by the converter.
    n_pixels, n_frames : int
        How many they are.
    """

    mean_dn: float
    spread: DarkSpread
    n_pixels: int
    n_frames: int


def shortest_darkness(session: Session) -> Darkness:
    """Measure the dark frames of a session at its shortest exposure; raises CalibrationError without any."""
    records = session.frames("dark")
    if not records:
        raise CalibrationError("the session has no dark frames: cover the lens and go on with the acquisition")
    shortest_s = min(record.exposure_s for record in records)
    seen = pixel_statistics(session.load(record) for record in records if record.exposure_s == shortest_s)
    temporal_dn2 = float(seen.variance_dn2.mean())
    spatial_dn2 = max(float(seen.mean_dn.var()) - temporal_dn2 / seen.n_frames, 0.0)
    return Darkness(float(seen.mean_dn.mean()), DarkSpread(temporal_dn2, spatial_dn2), seen.mean_dn.size, seen.n_frames)


def known(quantity: Quantity) -> float:
    """Return the standard uncertainty, 0 where it is not known."""
    return quantity.standard_uncertainty if isfinite(quantity.standard_uncertainty) else 0.0


def noise_of_characterisation(found: Characterisation, darkness: Darkness) -> CameraNoise:
    """Return the noise that a characterisation after EMVA 1288 states; what it lacks is 0 and not known.

    Where darkness has less noise than rounding hides, the standard states a least value; the dark frames then give
    what fits them.

    Parameters
    ----------
    found : Characterisation
        Of the camera.
    darkness : Darkness
        Its dark frames.
    """
    k = found.k_dn_per_e

    def in_dn(quantity: Quantity | None, unit: str) -> Quantity:
        if quantity is None or not isfinite(quantity.value):
            return Quantity(0.0, 0.0, unit, "not known")
        # What was measured is in DN: the uncertainty of K went in when it was made electrons, and goes out again.
        by_k = quantity.value * known(k) / k.value
        own = sqrt(max(known(quantity) ** 2 - by_k**2, 0.0))
        return Quantity(quantity.value * k.value, own * k.value, unit, quantity.note)

    read_noise_dn = in_dn(found.dark_noise_e, "DN")
    dsnu_dn = in_dn(found.dsnu_pixel_e or found.dsnu_e, "DN")
    row_dn, column_dn = in_dn(found.dsnu_row_e, "DN"), in_dn(found.dsnu_column_e, "DN")
    if darkness.spread.total_dn2 < DITHERED_DN2:
        read_noise_dn, dsnu_dn = _coarse(darkness, row_dn.value**2 + column_dn.value**2)
    return CameraNoise(
        k_dn_per_e=k,
        read_noise_dn=read_noise_dn,
        prnu_rel=found.prnu_pixel_rel or found.prnu_rel or Quantity(0.0, 0.0, "1", "not known"),
        dsnu_dn=dsnu_dn,
        row_dsnu_dn=row_dn,
        column_dsnu_dn=column_dn,
        dsnu_dn_s=in_dn(found.dsnu_e_s, "DN/s"),
    )


def _coarse(dark: Darkness, of_lines_dn2: float) -> tuple[Quantity, Quantity]:
    """Read noise and DSNU below the converter's step, with what the dark frames leave open."""
    rounded = dark.spread
    largest = largest_unseen_spread(dark.mean_dn, rounded.total_dn2, dark.n_pixels * dark.n_frames)
    if largest is not None:
        note = "darkness has two DN only, which tells an upper limit of its noise"
        # Evenly distributed from 0 to the limit.
        parts = (sqrt(part / rounded.total_dn2) for part in (rounded.temporal_dn2, rounded.spatial_dn2))
        read, dsnu = (Quantity(part * largest / 2, part * largest / sqrt(12), "DN", note) for part in parts)
        return read, dsnu
    best = unrounded(dark.mean_dn, rounded)
    relative = sqrt(2 / max(dark.n_pixels - 1, 1))
    moved = DarkSpread(rounded.temporal_dn2 * (1 + relative), rounded.spatial_dn2 * (1 + relative))
    other = unrounded(dark.mean_dn, moved)
    note = "before rounding, by the dark frames; the noise is less than a DN"

    def root(value: float, elsewhere: float) -> Quantity:
        return Quantity(sqrt(value), abs(sqrt(elsewhere) - sqrt(value)), "DN", note)

    # Rows and columns have their own parameters.
    pixels, elsewhere = (max(one.spatial_dn2 - of_lines_dn2, 0.0) for one in (best, other))
    return root(best.temporal_dn2, other.temporal_dn2), root(pixels, elsewhere)
