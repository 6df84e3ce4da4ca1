"""What a fit found out beside its parameters: the ladder of models, tests, what was left out, the budget."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..response import ResponseKind


@dataclass(frozen=True)
class ModelStep:
    """One model of the ladder.

    Parameters
    ----------
    kind : {'linear', 'quadratic', 'pchip', 'table'}
        The response.
    n_parameters : int
        Free parameters, the responsivity among them.
    leave_one_out_rel : float
        Root mean square of the relative deviations of patches from a fit without them.
    chosen : bool
        Whether the calibration uses it.
    reason : str
        Why it was chosen, or was not, in plain words.
    """

    kind: ResponseKind
    n_parameters: int
    leave_one_out_rel: float
    chosen: bool
    reason: str


@dataclass(frozen=True)
class FitTest:
    """A test of what the model takes for granted.

    Parameters
    ----------
    name : str
        ``glare``, ``exposure reciprocity``, ``drift``, ``fall-off``, ``scatter``, ``darkness``, ``gain``.
    value, standard_uncertainty : float
        Deviation that was found, and how well it is known, in `unit`.
    unit : str
        Unit of the two.
    significant : bool
        Whether it is more than chance.
    meaning : str
        What it says, in plain words, with what to do if it is significant.
    """

    name: str
    value: float
    standard_uncertainty: float
    unit: str
    significant: bool
    meaning: str


@dataclass(frozen=True)
class LeftOut:
    """Something the fit does not use.

    Parameters
    ----------
    patch : str
        Name of the patch.
    exposure_s : float or None
        The exposure left out; None if it is a reading, or the whole patch.
    reading : int or None
        Which of the patch's readings, counted from 1; None if it is an exposure, or the whole patch.
    reason : str
        Why, in plain words.
    """

    patch: str
    exposure_s: float | None
    reading: int | None
    reason: str


@dataclass(frozen=True)
class BudgetRow:
    """One row of an uncertainty budget (JCGM 100:2008, table H.1).

    Parameters
    ----------
    source : str
        Where the error comes from: ``meter scale``, ``meter digits``, ``meter f1'``, ``patch uniformity``, ``shot and
        read noise``, ``dark and temperature``, ``linearity``, ``flat field``, ``exposure time``, ``gain``, ``spectral
        mismatch``, ``glare``, ``drift``, ``fit``.
    standard_uncertainty_rel : float
        Its relative contribution to the luminance.
    distribution : {'normal', 'rectangular'}
        Of the error.
    common : bool
        True if all patches of one calibration share it, so that it (nearly) cancels in a contrast.
    evaluation : {'A', 'B'}
        A: from statistics of this session. B: from a data sheet, a certificate or judgement.
    basis : str
        What the figure rests on, in plain words; also why it is 0 where it is not known.
    included : bool
        Whether it is part of the stated intervals; `basis` says why if it is not.
    """

    source: str
    standard_uncertainty_rel: float
    distribution: Literal["normal", "rectangular"]
    common: bool
    evaluation: Literal["A", "B"]
    basis: str
    included: bool = True
