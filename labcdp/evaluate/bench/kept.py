"""Observations of a session that are kept beside a calibration, so that its frames need not be measured again."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration import PatchObservation
from ...calibration.record import SessionObservations, load_observations, save_observations
from ...core.errors import InputError
from ...core.frame import Frame
from ...session import MeterCertificate, Session
from .corrections import PlaneCorrections
from .observe import ObservedSession, field_diameter_px, included, input_sha256, session_readings
from .recorded import Report, by_exposure, by_patch

_log = logging.getLogger(__name__)

#: Name of the file beside a calibration.
OBSERVATIONS = "observations.json"
#: Changes whenever the same frames, regions and corrections give other observations than before.
_MEASUREMENT = 1


def keep_observations(sessions: Sequence[ObservedSession], path: Path) -> None:
    """Write the observations of sessions; nothing where a value is not finite, which a file cannot hold."""
    try:
        save_observations([_kept(session) for session in sessions], path)
    except InputError:
        raise
    except ValueError as error:
        _log.info("the observations are not kept (%s)", error)


def kept_session(
    session: Session,
    corrections: PlaneCorrections,
    path: Path,
    without: Sequence[str] = (),
    report: Report = lambda _done, _total: None,
    certificate: MeterCertificate | None = None,
) -> ObservedSession | None:
    """Return what the frames and readings of a session say, from kept observations; None if there are none of them.

    Parameters
    ----------
    session, corrections, without, report, certificate
        As for `labcdp.evaluate.bench.observe.observe_session`; corrections with the vignetting.
    path : Path
        File of `keep_observations`; it need not exist.

    Raises
    ------
    SessionError
        If a file of the session is missing or altered.
    InputError
        If `without` names an unknown patch or reading.
    """
    configuration, patches, unread = included(session, without, certificate)
    try:
        sessions = load_observations(path) if path.exists() else []
    except InputError as error:
        _log.info("%s: the frames are measured again", error)
        sessions = []
    key = _key(session, [patch.name for patch in patches], corrections)
    observations = next((kept for kept in sessions if kept.key == key), None)
    if observations is None:
        return None
    seen = {plane: {patch.name: list[PatchObservation]() for patch in patches} for plane in corrections}
    for o in observations.patches:
        seen[o.state.plane][o.patch].append(replace(o, vignetting=corrections[o.state.plane].vignetting))
    darks = {plane: [o for o in observations.darks if o.state.plane == plane] for plane in corrections}
    return ObservedSession(
        session,
        configuration,
        seen,
        darks,
        corrections,
        session_readings(session, configuration, [patch.name for patch in patches], unread),
        input_sha256(session),
        frozenset(observations.frames_sha256),
        _checked_frames(session, report),
    )


def _kept(observed: ObservedSession) -> SessionObservations:
    return SessionObservations(
        _key(observed.session, observed.names, observed.corrections),
        tuple(sorted(observed.frames_sha256)),
        tuple(replace(o, vignetting=None) for group in observed.by_plane.values() for o in group),
        tuple(o for group in observed.darks_by_plane.values() for o in group),
    )


def _checked_frames(session: Session, report: Report) -> dict[int, Frame]:
    """Check the files of all frames, and return the first frames of the target at each exposure, which maps show."""
    groups = [by_patch(group).get(None, []) for group in by_exposure(session, "light").values()]
    first, records, frames = {group[0].number for group in groups if group}, session.frames(), {}
    for done, record in enumerate(records, start=1):
        if record.number in first:
            frames[record.number] = session.load(record)
        else:
            session.require_unaltered([record])
        report(done, len(records))
    return frames


def _key(session: Session, patches: Sequence[str], corrections: PlaneCorrections) -> str:
    """Return a hash of all that observations of these patches follow from."""
    regions = {patch.name: patch.region() for patch in session.configuration.target.patches}
    content = {
        "measurement": _MEASUREMENT,
        "frames": [[f.number, f.role, f.patch, f.exposure_s, f.file.sha256] for f in session.frames()],
        "regions": [[name, _content(regions[name])] for name in patches],
        "planes": [
            [
                plane,
                field_diameter_px(session.configuration, plane),
                *map(_content, (correction.vignetting, correction.defects, correction.dark_library)),
            ]
            for plane, correction in corrections.items()
        ],
    }
    return hashlib.sha256(json.dumps(content, default=str).encode()).hexdigest()


def _content(value: Any) -> Any:
    """Return a dataclass as values JSON can hold, arrays by their hashes."""
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, hashlib.sha256(np.ascontiguousarray(value).data).hexdigest()]
    if is_dataclass(value):
        return [type(value).__name__, *(_content(getattr(value, part.name)) for part in fields(value))]
    return value
