"""The registers of the simulated camera: reading, writing, and values after power-on."""

from __future__ import annotations

from typing import Any

from ...camera import CameraError
from .device import Readout, SimulatedDevice
from .genicam import Address, feature, initial_values

#: Steps of the register of the temperature.
TEMPERATURE_STEPS_PER_C = feature("DeviceTemperature")["steps"]


class Registers:
    """Registers of Aravis' simulator.

    Parameters
    ----------
    fake : Aravis.FakeCamera
        Camera of Aravis' simulator.
    """

    def __init__(self, fake: Any) -> None:
        self._fake = fake

    def read(self, address: int) -> int:
        """Return a number."""
        return int(self._fake.read_register(address).value)

    def write(self, address: int, value: int) -> None:
        """Store a number."""
        self._fake.write_register(address, value)

    def write_text(self, address: Address, text: str, length: int) -> None:
        """Store text of less than `length` letters; raises CameraError if it is longer."""
        raw = text.encode("ascii")
        if len(raw) >= length:
            raise CameraError(f"{text!r} is too long for the camera's register: use up to {length - 1} letters")
        for start in range(0, length, 4):
            self.write(address + start, int.from_bytes(raw.ljust(length, b"\0")[start : start + 4], "big"))

    def switch_on(self, device: SimulatedDevice) -> None:
        """Store the values of a device after power-on."""
        self.write_text(Address.VENDOR, device.vendor, 32)
        self.write_text(Address.MODEL, device.model, 32)
        self.write_text(Address.MANUFACTURER_INFO, "labcdp simulated camera", 48)
        numbers = initial_values(device.features) | {
            Address.SENSOR_WIDTH: device.width,
            Address.SENSOR_HEIGHT: device.height,
            Address.WIDTH: device.width,
            Address.HEIGHT: device.height,
            Address.FRAME_PERIOD_US: round(1e6 / device.frame_rate_hz),
            Address.BLACK_LEVEL: round(device.black_level_dn),
            Address.TEMPERATURE: round(device.temperature_c * TEMPERATURE_STEPS_PER_C),
            Address.TICK_FREQUENCY_HIGH: 0,
        }
        for address, value in numbers.items():
            self.write(address, value)

    def readout(self, device: SimulatedDevice) -> Readout:
        """Return the current readout of a device."""
        return Readout(
            x=self.read(Address.OFFSET_X),
            y=self.read(Address.OFFSET_Y),
            width=self.read(Address.WIDTH),
            height=self.read(Address.HEIGHT),
            binning=(self.read(Address.BINNING_HORIZONTAL), self.read(Address.BINNING_VERTICAL)),
            black_level_change_dn=self.read(Address.BLACK_LEVEL) - round(device.black_level_dn),
            mirrored=(self.read(Address.REVERSE_X) != 0, self.read(Address.REVERSE_Y) != 0),
        )
