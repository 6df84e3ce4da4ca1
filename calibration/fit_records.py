"""Records of a fit beside its parameters: models, checks, left-out data and errors; findings of a calibration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Literal, TypeAlias

from ..core.dn import ResponseKind
from ..core.errors import InputError, require_not_negative
from ..core.result import Finding, info, unique, warning

#: Reason for leaving data out.
Reason: TypeAlias = Literal[
    "saturated",
    "clipped at 0 DN",
    "outside the response of the bracket",
    "not above the dark signal",
    "not usable at any exposure",
    "not usable in all planes",
    "below the meter's range",
    "copy of another reading",
]


#: Below any camera's, in DN s^-1 / (cd m^-2).
_LEAST_RESPONSIVITY = 1e-30


@dataclass(frozen=True)
class ModelStep:
    """A candidate model.

    Parameters
    ----------
    kind : {'linear', 'quadratic', 'cubic', 'gamma', 'knees', 'pchip', 'table'}
        The response.
    n_parameters : int
        Free parameters, the responsivity among them.
    leave_one_out_rel : float
        Root mean square of the relative deviations of patches from a fit without them.
    chosen : bool
        Whether the calibration uses it.
    reason : Finding
        Why it was selected or not.
    """

    kind: ResponseKind
    n_parameters: int
    leave_one_out_rel: float
    chosen: bool
    reason: Finding


@dataclass(frozen=True)
class FitTest:
    """A check of one of the model's assumptions.

    Parameters
    ----------
    name : str
        ``glare``, ``exposure reciprocity``, ``drift``, ``vignetting``, ``scatter``, ``dark signal``, ``gain``.
    value, standard_uncertainty : float
        Deviation with its uncertainty, in `unit`; both 0 if it could not be tested.
    unit : str
        Unit of the two.
    significant : bool
        Whether it is significant.
    finding : Finding
        Resulting finding; a warning if significant.
    """

    name: str
    value: float
    standard_uncertainty: float
    unit: str
    significant: bool
    finding: Finding

    @property
    def tested(self) -> bool:
        """Whether the check was possible."""
        return self.value != 0 or self.standard_uncertainty != 0


@dataclass(frozen=True)
class LeftOut:
    """Data left out of the fit.

    Parameters
    ----------
    patch : str
        Name of the patch.
    exposure_s : float or None
        The exposure left out; None if it is a reading, or the whole patch.
    reading : int or None
        Which of the patch's readings, counted from 1; None if it is an exposure, or the whole patch.
    reason : str
        Reason.
    """

    patch: str
    exposure_s: float | None
    reading: int | None
    reason: Reason


#: Exposures that are left out, which is normal in exposure bracketing.
_EXPOSURE_CODES = ("exposure-saturated", "exposure-clipped", "exposure-outside-response", "exposure-not-above-dark")
_EXPOSURES = "exposures-left-out"


def summarised(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return each finding once, with those of single exposures that are left out as one; a table has them all."""
    findings = unique(findings)
    patches = [finding.subject for finding in findings if finding.code in _EXPOSURE_CODES]
    of_others = [finding.values["patches"] for finding in findings if finding.code == _EXPOSURES]
    patches += [f"{name}" for names in of_others if isinstance(names, list) for name in names]
    kept = (finding for finding in findings if finding.code not in (*_EXPOSURE_CODES, _EXPOSURES))
    return (*kept, *([info(_EXPOSURES, patches=list(dict.fromkeys(patches)))] if patches else []))


@dataclass(frozen=True)
class FitError:
    """One independent error of a fit, for one standard uncertainty.

    An error of the dark signal acts twice: on converted frames by `dark`, and on the fit by `relative`. So does one of
    the vignetting, on converted frames by its pattern over the image.

    Parameters
    ----------
    source : str
        ``fit``, ``gain``, ``linearity``, ``dark and temperature``, ``vignetting`` or ``flat field``.
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
    pattern : int or None
        Number of the vignetting's pattern; None for another error.
    """

    source: str
    net_dn: tuple[float, ...]
    relative: tuple[float, ...]
    gain_rel: tuple[float, ...] = ()
    dark: tuple[float, ...] = ()
    dark_gain_db: float | None = None
    dof: float | None = None
    pattern: int | None = None


@dataclass(frozen=True)
class ResponsivityFit:
    """Fit of the responsivity with its quality measures.

    Parameters
    ----------
    responsivity_dn_s_cd_m2 : float
        R at small signals, linearised DN per second and cd/m^2 on the optical axis (DN s^-1 / (cd m^-2)), at the
        calibration's own gain.
    random_rel : float
        Relative standard uncertainty of R without the meter's scale.
    chi_squared : float
        Sum of squared standardised residuals of the observations by the stated errors, correlations respected.
    degrees_of_freedom : int
        Observations (patches times exposures) less parameters.
    scatter_rel, scatter_dn : float
        Unexplained standard deviation of patches and observations relative to the luminance, and of observations in DN.
        0 if the stated errors suffice.
    intercept_dn_s, intercept_standard_uncertainty_dn_s : float or None
        Free intercept, fitted as a test only; None if all patches have about the same luminance.
    glare_cd_m2 : float
        Intercept that the fit found, glare if positive: it depends on the scene, and is the standard uncertainty of
        any luminance.
    dark_offset_dn, dark_rate_dn_s : float
        Size of an offset of light frames to dark frames that the fit found, and of a change of the dark current: the
        standard uncertainty of any signal, and of one after an exposure of 1 s.
    rim_rel : float
        By how much the rims of the patches' regions make them brighter than what is inside, relative, on average.
    dof, scatter_dof : float or None
        Degrees of freedom of `random_rel` and `scatter_rel` (Welch and Satterthwaite); None if they are known.

    Raises
    ------
    InputError
        If the responsivity is not positive, or an uncertainty negative.

    Examples
    --------
    >>> from labcdp import Session
    >>> from labcdp.session import example_session
    >>> responsivity = Session.open(example_session()).calibrate().calibration.responsivity
    >>> responsivity.responsivity_dn_s_cd_m2 > 0, responsivity.degrees_of_freedom > 0
    (True, True)
    """

    responsivity_dn_s_cd_m2: float
    random_rel: float
    chi_squared: float
    degrees_of_freedom: int
    scatter_rel: float
    scatter_dn: float
    intercept_dn_s: float | None
    intercept_standard_uncertainty_dn_s: float | None
    dof: float | None = None
    scatter_dof: float | None = None
    glare_cd_m2: float = 0.0
    dark_offset_dn: float = 0.0
    dark_rate_dn_s: float = 0.0
    rim_rel: float = 0.0

    def __post_init__(self) -> None:
        r = self.responsivity_dn_s_cd_m2
        if not _LEAST_RESPONSIVITY < r < inf:
            raise InputError(f"responsivity_dn_s_cd_m2 is {r:g}: a camera that sees light has a positive one")
        require_not_negative(
            random_rel=self.random_rel,
            chi_squared=self.chi_squared,
            degrees_of_freedom=self.degrees_of_freedom,
            scatter_rel=self.scatter_rel,
            scatter_dn=self.scatter_dn,
            dark_offset_dn=self.dark_offset_dn,
            dark_rate_dn_s=self.dark_rate_dn_s,
        )


def undecided_cause(*causes: tuple[str, str, str]) -> Finding:
    """Return the finding of several causes that cannot be told apart: each in words, its code, and what would tell."""
    names, codes, remedies = (list(column) for column in zip(*causes, strict=True))
    return warning("one-of", causes=names, codes=codes, remedies="; ".join(remedies))


#: Causes that frames show, as of `undecided_cause`.
SETTLING = ("first frames unlike the others (image lag)", "first-frames-differ", "discard the first frames")
FLICKERING = ("a light that flickers", "flicker", "take more frames, in a steady light")
#: The same in a session after the calibration.
FLICKERING_NOW = (FLICKERING[0], "flicker-changed", FLICKERING[2])
DISAGREEING = ("a pulsed lamp, or other exposure times", "exposures-disagree", "use a steady lamp")
