"""One independent error of a fit."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FitError:
    """One independent error of a fit, for one standard uncertainty.

    An error of the dark signal acts twice: on converted frames by `dark`, and on the fit by `relative`.

    Parameters
    ----------
    source : str
        ``fit``, ``gain``, ``linearity`` or ``dark and temperature``.
    net_dn : tuple of float
        Signals above dark, ascending.
    relative : tuple of float
        Relative error of the luminance at these signals, at the calibration's own gain; straight lines between.
    gain_rel : tuple of float
        Additional error at each further gain, in their order.
    dark : tuple of float
        Errors of the dark model's offset_dn, rate_dn_s and 1 / T_d at the gain `dark_gain_db`; empty for none.
    dark_gain_db : float or None
        Gain of that dark model.
    dof : float or None
        Degrees of freedom of the standard uncertainty; None if it is known.
    """

    source: str
    net_dn: tuple[float, ...]
    relative: tuple[float, ...]
    gain_rel: tuple[float, ...] = ()
    dark: tuple[float, ...] = ()
    dark_gain_db: float | None = None
    dof: float | None = None
