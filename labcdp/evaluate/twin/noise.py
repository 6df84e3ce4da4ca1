"""Noise and non-uniformity of a camera as its twin needs them: in DN, before rounding."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, sqrt

from ...calibration.emva.result import Characterisation, Quantity


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


def known(quantity: Quantity) -> float:
    """Return the standard uncertainty, 0 where it is not known."""
    return quantity.standard_uncertainty if isfinite(quantity.standard_uncertainty) else 0.0


def noise_of_characterisation(found: Characterisation) -> CameraNoise:
    """Return the noise that a characterisation after EMVA 1288 states; missing values are 0.

    A spread whose variance was less than that of its noise, which is stated as negative, is 0 too.
    """
    k = found.k_dn_per_e

    def in_dn(quantity: Quantity | None, unit: str) -> Quantity:
        if quantity is None or not isfinite(quantity.value):
            return Quantity(0.0, 0.0, unit, "not known")
        # Measured in DN: the uncertainty of K entered with the conversion to electrons, and is removed again.
        by_k = quantity.value * known(k) / k.value
        own = sqrt(max(known(quantity) ** 2 - by_k**2, 0.0))
        return Quantity(max(quantity.value, 0.0) * k.value, own * k.value, unit, quantity.note)

    prnu = found.prnu_pixel_rel or found.prnu_rel or Quantity(0.0, 0.0, "1", "not known")
    return CameraNoise(
        k_dn_per_e=k,
        read_noise_dn=in_dn(found.dark_noise_e, "DN"),
        prnu_rel=replace(prnu, value=max(prnu.value, 0.0)),
        dsnu_dn=in_dn(found.dsnu_pixel_e or found.dsnu_e, "DN"),
        row_dsnu_dn=in_dn(found.dsnu_row_e, "DN"),
        column_dsnu_dn=in_dn(found.dsnu_column_e, "DN"),
        dsnu_dn_s=in_dn(found.dsnu_e_s, "DN/s"),
    )
