"""The driver of each model of meter on a port."""

from __future__ import annotations

from typing import Any, Final

from ...core.errors import InputError
from ...core.reading import MeterIdentity
from ...session import MeterConfiguration
from .cs100a import MinoltaCS100A
from .ls import MinoltaLS100, MinoltaLS110
from .meter import SerialMeter
from .port import Port
from .program import MinoltaCS150, MinoltaCS160, MinoltaLS150, MinoltaLS160, OwnProgramMeter

#: Driver of each model.
DRIVERS: Final[dict[str, type[SerialMeter]]] = {
    driver.data_sheet.model: driver
    for driver in (
        MinoltaLS100,
        MinoltaLS110,
        MinoltaCS100A,
        MinoltaLS150,
        MinoltaLS160,
        MinoltaCS150,
        MinoltaCS160,
    )
}


def configured_meter(
    described: MeterConfiguration,
    port: str | Port | None = None,
    identity: MeterIdentity | None = None,
    **options: Any,
) -> SerialMeter:
    """Return the driver of the meter that a configuration describes, not yet open.

    Parameters
    ----------
    described : MeterConfiguration
        Of a meter on a port.
    port : str or Port or None
        Its port; None for that of the configuration.
    identity : MeterIdentity or None
        Of the meter; None for that of the configuration.
    **options
        ``timeout_s``, ``attempts``, ``patience_s`` and ``transcript`` of the driver.

    Raises
    ------
    InputError
        If the meter is not on a port, no port is given, or the model does not have the correction.

    Examples
    --------
    >>> from labcdp.drivers.minolta.models import configured_meter
    >>> from labcdp.session import MeterConfiguration
    >>> configured_meter(MeterConfiguration(model="CS-100A", serial="4711", port="/dev/ttyUSB0")).identity.model
    'CS-100A'
    """
    if not described.is_connected:
        raise InputError(f'meter.entry is "{described.entry}": give "serial" or "program" for a meter on a port')
    identity = identity or described.identity
    where = port or described.port
    if where is None:
        raise InputError("meter.port is missing: give the port of the meter")
    driver = OwnProgramMeter if described.entry == "program" else DRIVERS[described.model]
    if isinstance(where, str):
        where = driver.named_port(where, described.rtscts)
    response, correction = described.response, described.correction
    if described.entry == "program":
        accuracy = {name: getattr(described, name) for name in ("scale_half_width_rel", "repeatability_rel", "digits")}
        return OwnProgramMeter(where, identity, response=response, correction=correction, **accuracy, **options)
    return driver.configured(where, identity, response=response, correction=correction, **options)
