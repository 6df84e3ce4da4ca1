"""Recorded sessions of a bench: calibration, evaluation, and results as a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..calibration import AnyCalibration, Calibration, ColourCalibration, load_any, save
from ..core.errors import InputError
from ..core.result import InputFile, html_table
from ..evaluate.bench.calibrate import calibrate_recorded
from ..evaluate.bench.corrections import UniformLight, require_same_optics
from ..evaluate.bench.observe import ObservedSession
from ..evaluate.bench.session import chosen_contrasts, evaluate_session, observe_calibrated
from ..evaluate.bench.session_result import session_input
from ..report.text import warning_texts
from ..session import ContrastConfiguration
from ..session import Session as _Session
from .arguments import Contrasts, Pairs, PathArgument, as_contrasts, as_names, as_number, as_pair_names, as_path
from .session_result import SessionResult


class Session(_Session):
    """A recorded session; ``Session.open("my-session")`` opens one, `labcdp.session.Session` has its records.

    Examples
    --------
    >>> import labcdp
    >>> from labcdp.session import example_session
    >>> labcdp.Session.open(example_session()).calibrate().calibration
    <Calibration of Allied Vision Technologies Manta_G-505B (SIM-503363706, simulated)>
    """

    def calibrate(
        self,
        *more: Session | PathArgument,
        without: Sequence[str] = (),
        hold_out: Sequence[str] = (),
        flat_field: Session | PathArgument | None = None,
        nonuniformity_rel: float = 0.01,
        response: Literal["debevec"] | None = None,
    ) -> CalibratedSession:
        """Fit the camera's conversion from DN to cd/m^2, as ``labcdp calibrate`` does.

        Parameters
        ----------
        *more : Session or path
            Further sessions of the same camera and lens, at other gains or temperatures.
        without : sequence of str
            Patches to leave out, and single readings as ``PATCH:NUMBER``, counted from 1.
        hold_out : sequence of str
            Patches that the fit is tested with instead of using them.
        flat_field : Session, path or None
            Session recorded with uniform light that fills the image; None for cos^4 of the lens.
        nonuniformity_rel : float
            Standard uncertainty of the uniform light across the image, a fraction.
        response : {'debevec'} or None
            Find the camera's response from the session's exposures as a bracket; None for linear, or as the readings
            ask for.

        Returns
        -------
        CalibratedSession

        Raises
        ------
        CalibrationError
            If the session does not support a calibration.
        SessionError
            If a file is missing or altered.
        InputError
            If an argument cannot be used.
        """
        others = [
            session if isinstance(session, _Session) else Session.open(as_path(session, "a session"))
            for session in more
        ]
        if response not in (None, "debevec"):
            raise InputError(f"response is {response!r}: give 'debevec' or None")
        uniform = None
        if flat_field is not None:
            flat = flat_field if isinstance(flat_field, _Session) else Session.open(as_path(flat_field, "flat_field"))
            require_same_optics(self, flat)
            uniform = UniformLight.read(flat, nonuniformity_rel)
        (observed, *_), calibration = calibrate_recorded(
            [self, *others],
            uniform,
            without=as_names(without, "without"),
            held_out=as_names(hold_out, "hold_out"),
            bracket=response is not None,
        )
        return CalibratedSession(self, calibration, observed)

    def evaluate(
        self,
        calibration: AnyCalibration | PathArgument,
        contrasts: Contrasts | None = None,
        epsilon: float | str | None = None,
        *,
        pairs: Pairs | None = None,
        without: Sequence[str] = (),
    ) -> SessionResult:
        """Evaluate luminance and CDP of the patches, as ``labcdp evaluate`` does.

        Parameters
        ----------
        calibration : Calibration or path
            Of the same camera and settings.
        contrasts : float, str, array_like of them, or None
            Contrasts to be detected, fractions or percentages such as "50%"; None for those of the configuration.
        epsilon : float or None
            Their relative tolerance; None for that of the configuration, and 0.5 for `pairs`.
        pairs : sequence of (str, str) or None
            Bright and dark patch; None for those of the configuration. They need `contrasts`.
        without : sequence of str
            Patches to leave out, and single readings as ``PATCH:NUMBER``, counted from 1.

        Raises
        ------
        CalibrationError
            If the calibration is not for these frames.
        SessionError
            If a file is missing or altered.
        InputError
            If an argument cannot be used.
        """
        chosen = self._contrasts(contrasts, epsilon, pairs)
        path, inputs = None, [session_input(self)]
        if not isinstance(calibration, Calibration | ColourCalibration):
            path = as_path(calibration, "calibration")
            calibration = load_any(path)
            inputs.append(InputFile.of("calibration", path))
        seen = observe_calibrated(self, calibration, as_names(without, "without"), beside=path)
        return SessionResult(evaluate_session(*seen, chosen), tuple(inputs))

    def _contrasts(
        self, contrasts: Contrasts | None, epsilon: float | str | None, pairs: Pairs | None
    ) -> list[ContrastConfiguration]:
        """Return pairs of patches with contrasts as given, or else as configured."""
        if pairs is not None and contrasts is None:
            raise InputError("pairs need contrasts: give contrasts, fractions (1.0 is 100 %)")
        values = as_contrasts(contrasts, 0.5 if epsilon is None else epsilon).values
        tolerance = None if epsilon is None else as_number(epsilon, "epsilon")
        given = None if pairs is None else as_pair_names(pairs, "patches")
        return chosen_contrasts(self.configuration, given, values, tolerance)

    def __repr__(self) -> str:
        patches = len(self.configuration.target.patches)
        return f"<labcdp.Session {self.path.name}: {self.configuration.name}, {patches} patches>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        configuration = self.configuration
        rows = [("contrast", f"{pair.bright} / {pair.dark}, {pair.contrast:g}") for pair in configuration.contrasts]
        patches = ", ".join(patch.name for patch in configuration.target.patches)
        return html_table(("", ""), [("folder", str(self.path)), ("patches", patches), *rows], configuration.name)


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedSession:
    """A session with the calibration made from it; made by `Session.calibrate`.

    Parameters
    ----------
    session : Session
        The session.
    calibration : Calibration or ColourCalibration
        Converts frames of this camera to cd/m^2.
    observed : ObservedSession
        Measurements in frames and readings of the patches that were not left out.
    """

    session: Session
    calibration: AnyCalibration
    observed: ObservedSession

    def evaluate(
        self,
        contrasts: Contrasts | None = None,
        epsilon: float | str | None = None,
        *,
        pairs: Pairs | None = None,
    ) -> SessionResult:
        """Evaluate the session with its calibration; parameters as for `Session.evaluate`."""
        chosen = self.session._contrasts(contrasts, epsilon, pairs)
        evaluation = evaluate_session(self.observed, self.calibration, chosen)
        return SessionResult(evaluation, (session_input(self.session),))

    def save(self, path: PathArgument) -> Path:
        """Write the calibration file; raises InputError if it exists or cannot be written."""
        file = as_path(path, "the calibration")
        if file.exists():
            raise InputError(f"{file} exists: choose another name")
        save(self.calibration, file)
        return file

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the calibration."""
        return warning_texts(self.calibration.findings)

    def __repr__(self) -> str:
        low, high = self.calibration.range_cd_m2
        return f"<labcdp.CalibratedSession {self.session.path.name}: {low:.3g} to {high:.3g} cd/m²>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        residuals = self.calibration.residuals
        rows = [(row.patch, f"{100 * row.deviation_rel:+.2f} %") for row in residuals]
        return html_table(("patch", "camera from meter"), rows, repr(self)[1:-1])
