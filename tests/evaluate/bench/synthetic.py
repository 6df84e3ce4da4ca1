"""Sessions of simulated cameras whose truth is known, recorded without an acquisition."""

from datetime import UTC, datetime, timedelta

import numpy as np

from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.session import Session, SessionConfiguration

START = datetime(2026, 3, 1, 12, tzinfo=UTC)
CAMERA = CameraIdentity("Acme", "Test", "1", simulated=True)


def configuration(rois, **changes):
    """Configuration of a target whose patches have these names and regions (x, y, width, height)."""
    document = {
        "name": "bench",
        "operator": "A. Müller",
        "camera": {"pixel_pitch_m": 4e-6},
        "lens": {"model": "Prime", "serial": "7", "focal_length_m": 0.002, "f_number": 2.8},
        "meter": {"model": "LS-110", "serial": "73323007"},
        "source": {"spectrum": "D65"},
        "target": {"name": "patches", "patch": [{"name": name, "roi": roi} for name, roi in rois.items()]},
        "plan": {},
    }
    return SessionConfiguration.model_validate(document | changes)


def frame(dn, exposure_s, number, **changes):
    """One frame of 12 bits, unless told otherwise."""
    values = {
        "gain_db": 0.0, "bit_depth": 12, "saturation_dn": 4095.0, "black_level_dn": 64.0, "pixel_format": "Mono12",
        "colour_filter": None, "temperature_c": 35.0, "timestamp": START + timedelta(seconds=number),
        "camera_timestamp_ns": number, "frame_id": number, "camera": CAMERA,
    }  # fmt: skip
    return Frame(dn=dn, exposure_s=exposure_s, **values | changes)


def exposed(sensor, light_e_s, exposures_s, n, first=0, gain_db=0.0, temperature_c=35.0, **changes):
    """`n` frames of each exposure in the light, electrons per second and pixel, and as many dark ones; with roles."""
    shown = [(role, t) for role in ("light", "dark") for t in exposures_s for _ in range(n)]
    for number, (role, exposure_s) in enumerate(shown, start=first + 1):
        rate = light_e_s if role == "light" else np.zeros(sensor.shape)
        now = {"temperature_c": temperature_c, "seed": 11, "exposure_index": number, "threads": 1}
        dn = sensor.expose(rate, exposure_s, gain_db, **now)
        yield frame(dn, exposure_s, number, gain_db=gain_db, temperature_c=temperature_c, **changes), role


def reading(value, seconds):
    """One reading of a meter with a repeatability of 0.2 %, whose scale is known to 2 %."""
    return Reading(
        value=round(value, 2), unit="cd/m2", resolution=0.01, scale_half_width_rel=0.02, digits_half_width=0.02,
        repeatability_rel=0.002, peak=False, correction="preset", held=False, meter=MeterIdentity("LS-110", "73323007"),
        timestamp=START + timedelta(seconds=seconds), raw="",
    )  # fmt: skip


def record(path, configuration, frames, luminances_cd_m2=None, seed=0, start_s=0):
    """Write a session of (frame, role), and three readings of each patch that scatter by 0.2 %; returns its path."""
    rng = np.random.default_rng(seed)
    with Session.create(path, configuration) as session:
        session.add_frames([(one, role, None) for one, role in frames])
        for i, (name, value) in enumerate((luminances_cd_m2 or {}).items()):
            for j in range(3):
                session.add_reading(reading(value * (1 + rng.normal(0, 0.002)), start_s + 60 * i + j), name)
    return path


def again(path, session, frames, patches=None, **changes):
    """Write a session anew: `frames` makes (frame, role, patch) of (frame, role), `patches` are new names of some."""
    with Session.create(path, session.configuration.model_copy(update=changes)) as new:
        recorded = [(session.load(one), one.role) for one in session.frames()]
        new.add_frames([*frames(recorded)])
        for one in session.readings():
            if patches is None or one.patch in patches:
                new.add_reading(one.reading, (patches or {}).get(one.patch, one.patch))
    return path
