"""Reading: one value of a luminance meter, with unit, flags and uncertainty."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import datetime
from math import hypot, isfinite, nan, sqrt
from statistics import fmean, stdev
from typing import Any, ClassVar, Literal, get_args

from .disk import quoted, record_of
from .errors import InputError, naming
from .quantity import Quantity
from .result import html_table, number

#: 1 foot-lambert = (1 / pi) cd / ft^2, with 1 ft = 0.3048 m (exact by definition of the foot).
CD_M2_PER_FL = 3.4262590996353905

LuminanceUnit = Literal["cd/m2", "fL", "%"]
#: Models of meters on a port; `DRIVERS` of `labcdp.drivers.minolta.models` has a class for each.
SerialMeterModel = Literal["LS-110", "LS-100", "CS-100A", "LS-150", "LS-160", "CS-150", "CS-160"]
SERIAL_MODELS: tuple[str, ...] = get_args(SerialMeterModel)


def is_chromaticity(x: float, y: float) -> bool:
    """Whether x and y can be chromaticity coordinates of CIE 1931: X, Y and Z are positive.

    Examples
    --------
    >>> from labcdp.core.reading import is_chromaticity
    >>> is_chromaticity(0.3127, 0.3290), is_chromaticity(0.9, 0.3), is_chromaticity(0.0, 0.0)
    (True, False, False)
    """
    return 0 < x < 1 and 0 < y < 1 and x + y <= 1


@dataclass(frozen=True)
class MeterIdentity:
    """Which meter took a reading; serial number and calibration date come from the bench's configuration.

    Parameters
    ----------
    model, serial : str
        For example ``LS-110`` and ``73323007``.
    calibration_date : str or None
        ISO date of the last calibration, None if unknown.
    simulated : bool
        True for labcdp's simulated meter.

    Examples
    --------
    >>> from labcdp.core.reading import MeterIdentity
    >>> MeterIdentity("LS-110", "73323007", calibration_date="2026-03-01").model
    'LS-110'
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    model: str
    serial: str
    calibration_date: str | None = None
    simulated: bool = False


@dataclass(frozen=True)
class Reading:
    """One reading of a luminance meter.

    The error is kept in two parts. The scale part is common to all readings of one meter: it does not average
    down, and it cancels in contrast ratios. The random part differs from reading to reading.

    Parameters
    ----------
    value : float
        The number as sent, in `unit`.
    unit : {'cd/m2', 'fL', '%'}
        Unit the meter stated with this very reading.
    resolution : float
        Value of the last digit, in `unit`.
    scale_half_width_rel : float
        Bound of the meter's relative scale error (rectangular), as a fraction: 0.02 for +-2 %.
    digits_half_width : float
        Bound of the digit error (rectangular), in `unit`.
    repeatability_rel : float
        Standard deviation of repeated readings, relative to the value.
    peak : bool
        True if the meter held its peak, False for the present value.
    correction : {'preset', 'luminance', 'colour', 'both'} or None
        Which user correction the meter applied; None where it does not say: in ratio mode, and for other meters.
    held : bool
        True if the value was held, False if measured continuously.
    meter : MeterIdentity
        Which meter.
    timestamp : datetime
        Host time, with time zone.
    raw : str
        The reply as received, the text as typed or the row as read, for the record.
    chromaticity : (float, float) or None
        Coordinates x and y of CIE 1931 as a chroma meter gave them; None for a luminance meter.

    Examples
    --------
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.drivers.manual import MeterAccuracy, typed_reading
    >>> reading = typed_reading("3.5 fL", MeterAccuracy(0.02, 0.001, digits=2), MeterIdentity("L 1003", "4711"))
    >>> round(reading.luminance_cd_m2, 3), reading.resolution
    (11.992, 0.1)
    """

    value: float
    unit: LuminanceUnit
    resolution: float
    scale_half_width_rel: float
    digits_half_width: float
    repeatability_rel: float
    peak: bool
    correction: Literal["preset", "luminance", "colour", "both"] | None
    held: bool
    meter: MeterIdentity
    timestamp: datetime
    raw: str
    chromaticity: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.chromaticity is not None and not is_chromaticity(*self.chromaticity):
            raise InputError(f"chromaticity is {self.chromaticity}: give x and y above 0 with a sum up to 1")
        if not isfinite(self.value) or self.value < 0:
            raise InputError(f"a reading is a finite number of at least 0, got {self.value}")
        if self.unit not in ("cd/m2", "fL", "%"):
            raise InputError(f"unit is {quoted(self.unit)}: give 'cd/m2', 'fL' or '%'")
        if self.timestamp.tzinfo is None:
            raise InputError("timestamp has no time zone: give an aware datetime")

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        meter, unit = f"{self.meter.model} {self.meter.serial}", self.unit.replace("m2", "m²")
        return html_table(("reading", "meter", "taken"), [(f"{self.value:g} {unit}", meter, str(self.timestamp))])

    @property
    def cd_m2_per_unit(self) -> float:
        """Factor from `unit` to cd/m^2.

        Raises
        ------
        InputError
            For a ratio in %, which is not a luminance.
        """
        if self.unit == "%":
            raise InputError(
                f"the reading {quoted(self.raw)} is a ratio in %, not a luminance: set the meter to ABS and measure "
                "again"
            )
        return CD_M2_PER_FL if self.unit == "fL" else 1.0

    @property
    def luminance_cd_m2(self) -> float:
        """The reading in cd/m^2, converted if the meter stated fL; raises InputError for a ratio."""
        return self.value * self.cd_m2_per_unit

    @property
    def standard_uncertainty_common_rel(self) -> float:
        """Standard uncertainty of the common scale, relative (rectangular: bound / sqrt 3)."""
        return self.scale_half_width_rel / sqrt(3)

    @property
    def standard_uncertainty_random_cd_m2(self) -> float:
        """Standard uncertainty of the part that differs between readings, in cd/m^2."""
        return self.cd_m2_per_unit * hypot(self.digits_half_width / sqrt(3), self.repeatability_rel * self.value)

    def to_dict(self) -> dict[str, Any]:
        """All fields as values JSON can hold; the inverse is `from_dict`. A luminance meter has no chromaticity."""
        values = asdict(self) | {"timestamp": self.timestamp.isoformat()}
        if self.chromaticity is None:
            del values["chromaticity"]
        return values

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Reading:
        """Make a reading from what `to_dict` returned.

        Raises
        ------
        InputError
            If a field is missing, unknown or has an unusable value.
        """
        with naming("reading cannot be read"):
            return cls(**record_of(cls, values))


@dataclass(frozen=True)
class ReadingSeries:
    """Readings of the same light by one meter, and their mean.

    Parameters
    ----------
    readings : tuple of Reading
        At least one.

    Raises
    ------
    InputError
        If there is no reading, one is a ratio in %, or units, meters or corrections differ.

    Examples
    --------
    >>> from labcdp.core.reading import MeterIdentity, ReadingSeries
    >>> from labcdp.drivers.manual import MeterAccuracy, typed_reading
    >>> accuracy, meter = MeterAccuracy(0.02, 0.001, digits=2), MeterIdentity("L 1003", "4711")
    >>> series = ReadingSeries(tuple(typed_reading(text, accuracy, meter) for text in ("9.9", "10.0", "10.1")))
    >>> round(series.mean_cd_m2, 6), round(series.scatter_cd_m2, 6)
    (10.0, 0.1)
    """

    readings: tuple[Reading, ...]

    def __post_init__(self) -> None:
        if not self.readings:
            raise InputError("there are no readings to average: take at least one")
        first = self.readings[0]
        for reading in self.readings:
            _ = reading.luminance_cd_m2  # refuses a ratio
            if reading.meter != first.meter:
                raise InputError(
                    f"the readings come from meters {first.meter.model} {first.meter.serial} and "
                    f"{reading.meter.model} {reading.meter.serial}: average the readings of one meter"
                )
            if reading.unit != first.unit:
                raise InputError(
                    f"the readings {quoted(first.raw)} and {quoted(reading.raw)} are in {first.unit} and "
                    f"{reading.unit}: leave the meter's unit switch alone and measure again"
                )
            if None not in (reading.correction, first.correction) and reading.correction != first.correction:
                raise InputError(
                    f"the readings {quoted(first.raw)} and {quoted(reading.raw)} have the corrections "
                    f"{first.correction!r} and {reading.correction!r}: leave the meter's correction alone and measure "
                    "again"
                )

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        row = (str(len(self.readings)), f"{number(self.mean_cd_m2)} cd/m²", f"{100 * self.scatter_rel:.2g} %")
        return html_table(("readings", "mean", "scatter"), [row])

    @property
    def mean_cd_m2(self) -> float:
        """Mean, in cd/m^2."""
        return fmean(reading.luminance_cd_m2 for reading in self.readings)

    @property
    def scatter_cd_m2(self) -> float:
        """Sample standard deviation (n - 1), in cd/m^2; nan for one reading."""
        if len(self.readings) == 1:
            return nan
        return stdev(reading.luminance_cd_m2 for reading in self.readings)

    @property
    def scatter_rel(self) -> float:
        """Sample standard deviation relative to the mean; nan for one reading, or dark signal."""
        mean = self.mean_cd_m2
        return self.scatter_cd_m2 / mean if mean else nan

    @property
    def drift_rel(self) -> Quantity:
        """Change from the first to the last reading by a straight line, relative to the mean; u by the data sheet.

        nan for one reading, or dark signal.
        """
        n, mean = len(self.readings), self.mean_cd_m2
        if n == 1 or not mean:
            return Quantity(nan, nan)
        places = [2 * i / (n - 1) - 1 for i in range(n)]  # from -1 to 1
        size = sum(place**2 for place in places)
        slope = sum(p * r.luminance_cd_m2 for p, r in zip(places, self.readings, strict=True)) / size
        u = fmean(reading.standard_uncertainty_random_cd_m2 for reading in self.readings) / sqrt(size)
        return Quantity(2 * slope / mean, 2 * u / mean)

    @property
    def standard_uncertainty_random_cd_m2(self) -> float:
        """Standard uncertainty of the mean without the common scale, in cd/m^2.

        The larger of scatter / sqrt(n) (JCGM 100:2008, 4.2.3) and what digits and repeatability of the data sheet
        give. The repeatability averages down; the digits do not: the same light gives the same rounded number again.
        """
        n = len(self.readings)
        repeatability = sqrt(fmean((r.repeatability_rel * r.luminance_cd_m2) ** 2 for r in self.readings))
        digits = fmean(r.digits_half_width * r.cd_m2_per_unit / sqrt(3) for r in self.readings)
        stated = hypot(repeatability / sqrt(n), digits)
        return stated if n == 1 else max(stated, self.scatter_cd_m2 / sqrt(n))

    @property
    def standard_uncertainty_common_rel(self) -> float:
        """Standard uncertainty of the common scale, relative: the largest stated with the readings."""
        return max(reading.standard_uncertainty_common_rel for reading in self.readings)
