"""Sessions of a world, written by labcdp's session writer: the only way from this bench into labcdp."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

import numpy as np

import labcdp
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.files import shipped_curve
from labcdp.session import SessionConfiguration
from labcdp.session.records import Role

from .camera import Device, applied_s, expose, warming
from .captures import full_scale, sent
from .lamp import light_of_lamp
from .meter import SESSION_S, Shown, lamp
from .target import Target
from .world import FOCAL_LENGTH_M, FULL_SCALE_DN, PITCH_M, World

START = datetime(2026, 3, 1, 12, tzinfo=UTC)
#: The lights are taken in the first sixth of a session, the readings until five sixths, the dark frames last.
LIGHT_S, READ_S = SESSION_S / 6, SESSION_S * 5 / 6


class Recorder:
    """Writes the frames of one camera and the readings of one meter.

    Parameters
    ----------
    device : Device
        The camera.
    rng : numpy.random.Generator
        Of all noise.
    folder : Path
        Where sessions are made.
    """

    def __init__(self, device: Device, rng: np.random.Generator, folder: Path) -> None:
        self.device, self._rng, self._folder = device, rng, folder
        self._frames = count(1)
        #: Light of the lamp in the first frame of each exposure of the last session, relative to its mean.
        self.light: dict[float, float] = {}

    def record(
        self,
        name: str,
        target: Target,
        shown: Sequence[Shown],
        *,
        frames: tuple[int, int],
        exposures_s: Sequence[float] | None = None,
        contrast: dict[str, object] | None = None,
        after: float | None = None,
    ) -> labcdp.Session:
        """Record a target: light frames, readings, dark frames.

        Parameters
        ----------
        name : str
            Of the folder.
        target : Target
            The patches and their light.
        shown : sequence of Shown
            The meter's readings.
        frames : (int, int)
            Light and dark frames of each exposure.
        exposures_s : sequence of float or None
            Exposure times; None for those of the world.
        contrast : dict or None
            Contrast to evaluate.
        after : float or None
            Factor on the responsivity by focusing anew after the calibration, whose lamp then stays as at the first
            frame; None for the calibration itself.
        """
        world = self.device.world
        exposures_s = exposures_s or world.exposures_s
        configuration = _configuration(world, name, target, contrast, exposures_s)
        session = labcdp.Session.create(self._folder / name, configuration)
        n_light, n_dark = frames
        times = np.linspace(0, LIGHT_S, len(exposures_s) * n_light)
        # A camera that is triggered by the lamp begins each frame at one phase of it.
        phase = float(self._rng.uniform()) if world.ripple_rel and world.locked else None
        taken: list[tuple[Frame, Role, str | None]] = []
        self.light, before_s = {}, None
        in_order = np.repeat(exposures_s, n_light)[:: -1 if world.longest_first else 1].tolist()
        for exposure_s, second in zip(in_order, times.tolist(), strict=True):
            light = target.scene * lamp(world, second) if after is None else target.scene
            device = warming(self.device, second) if after is None else self.device
            of_lamp = light_of_lamp(world, exposure_s, self._rng, phase)
            self.light.setdefault(exposure_s, of_lamp)
            dn = expose(device, light, exposure_s, self._rng, 1.0 if after is None else after, of_lamp, before_s)
            before_s = applied_s(world, exposure_s) * of_lamp
            taken.append((self.frame(dn, exposure_s, second, device.world.temperature_c), "light", None))
        covered = warming(self.device, READ_S) if after is None else self.device
        for exposure_s in np.repeat(exposures_s, n_dark).tolist():
            dn = expose(covered, 0.0, exposure_s, self._rng)
            taken.append((self.frame(dn, exposure_s, READ_S, covered.world.temperature_c), "dark", None))
        session.add_frames(taken)
        for reading in _readings(world, shown):
            session.add_reading(*reading)
        return session

    def frame(self, dn: np.ndarray, exposure_s: float, second: float, temperature_c: float | None = None) -> Frame:
        """Return DN as a frame of this camera; of its temperature in the end if none is given."""
        world = self.device.world
        if temperature_c is None:
            temperature_c = world.temperature_c
        number, is_linear = next(self._frames), bool(world.captures) and not world.coded
        return Frame(
            dn=dn,
            exposure_s=exposure_s,
            gain_db=0.0,
            bit_depth=20 if is_linear else 12,
            saturation_dn=float(sent(np.array(full_scale(world)), world) if world.captures else FULL_SCALE_DN),
            black_level_dn=None,
            pixel_format="BayerRG12" if world.bayer else "Mono20" if is_linear else "Mono12",
            companding=shipped_curve("AR0231") if world.coded else None,
            colour_filter="RG" if world.bayer else None,
            temperature_c=temperature_c if world.stated_temperature else None,
            timestamp=START + timedelta(days=world.days, seconds=float(second)),
            camera_timestamp_ns=number,
            frame_id=number,
            camera=CameraIdentity("worlds", "camera", "1"),
        )


def _readings(world: World, shown: Sequence[Shown]) -> Iterator[tuple[Reading, str]]:
    for one in shown:
        yield (
            Reading(
                value=one.value_cd_m2,
                unit="cd/m2",
                resolution=world.resolution_cd_m2,
                scale_half_width_rel=world.scale_half_width_rel,
                digits_half_width=world.digits * world.resolution_cd_m2,
                repeatability_rel=world.repeatability_rel,
                peak=False,
                correction="preset",
                held=False,
                meter=MeterIdentity("meter", "1", one.calibrated),
                timestamp=START + timedelta(days=world.days, seconds=one.second),
                raw=f"{one.value_cd_m2:.6g}",
            ),
            one.patch,
        )


def _configuration(
    world: World,
    name: str,
    target: Target,
    contrast: dict[str, object] | None,
    exposures_s: Sequence[float],
) -> SessionConfiguration:
    # Without a correction: a lens so long that cos^4 is 1.
    focal_length_m = 1.0 if world.correction == "none" else FOCAL_LENGTH_M
    # A user who keeps the lens locked says so; one who does not leaves it to labcdp.
    known = {} if world.breathing_rel else {"refocus_rel": world.stated_change_rel}
    # Of these lenses a user knows that they are cos^4, of others only what labcdp takes for granted.
    known |= {"vignetting_rel": 0.0} if world.vignetting == "cos4" else {}
    return SessionConfiguration.model_validate(
        {
            "name": name,
            "operator": "worlds",
            "camera": {"pixel_pitch_m": PITCH_M} | ({"encoding": "AR0231"} if world.coded else {}),
            "lens": {"model": "lens", "serial": "1", "focal_length_m": focal_length_m, "f_number": 2.8} | known,
            "meter": {
                "model": "meter",
                "entry": "by hand",
                "serial": "1",
                "scale_half_width_rel": world.scale_half_width_rel,
                "repeatability_rel": world.repeatability_rel,
                "digits": world.digits,
            },
            "source": {"spectrum": "LED-B4"},
            "target": {
                "name": "target",
                "patch": [{"name": n, "roi": [float(v) for v in box]} for n, box in target.regions.items()],
            },
            "contrast": [] if contrast is None else [contrast],
            "plan": {"exposures_s": list(exposures_s), "readings_per_patch": world.readings},
        }
    )
