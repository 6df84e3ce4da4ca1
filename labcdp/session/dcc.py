"""Calibration certificate of a luminance meter from and as a digital calibration certificate (DCC)."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from importlib.metadata import version
from math import hypot
from typing import Any, Protocol

from ..core.dcc import (
    LUMINANCE,
    MEASURED,
    NO_COUNTRY,
    REFERENCE,
    CertifiedQuantity,
    DigitalCertificate,
    write_dcc,
)
from ..core.errors import InputError
from ..core.reading import MeterIdentity


class StatedCertificate(Protocol):
    """What of a `MeterCertificate` a digital one states."""

    number: str
    laboratory: str
    date: date
    correction: float
    expanded_uncertainty_rel: float
    coverage_factor: float
    conditions: str
    model: str | None
    serial: str | None
    range_cd_m2: tuple[float, float] | None


def meter_certificate_values(certificate: DigitalCertificate) -> dict[str, Any]:
    """Return the keys of ``[meter.certificate]`` that a digital certificate of a luminance meter states.

    The correction is the mean of reference over measured luminance. U is the largest relative U of the ratios, enlarged
    by the largest deviation of one from the mean: one factor stands for all.

    Raises
    ------
    InputError
        If it has no luminances of reference and meter, or the ratios differ by more than U.

    Examples
    --------
    >>> from datetime import date
    >>> from labcdp.core.dcc import LUMINANCE, MEASURED, REFERENCE, CertifiedQuantity, DigitalCertificate
    >>> from labcdp.session.dcc import meter_certificate_values
    >>> day = date(2026, 3, 1)
    >>> true = CertifiedQuantity("L", REFERENCE, LUMINANCE, (10.1, 101.0), (0.1, 1.0))
    >>> shown = CertifiedQuantity("L", MEASURED, LUMINANCE, (10.0, 100.0))
    >>> made = DigitalCertificate("1234", day, day, "Lab", "", "DE", "", "", "", "meter", "", "LS-110", "4711",
    ...                           (true, shown))
    >>> values = meter_certificate_values(made)
    >>> round(values["correction"], 4), round(values["expanded_uncertainty_rel"], 4), values["range_cd_m2"]
    (1.01, 0.0099, (10.1, 101.0))
    """
    references = certificate.quantities_of_kind(REFERENCE, LUMINANCE)
    measured = certificate.quantities_of_kind(MEASURED, LUMINANCE)
    if not references or len(references) != len(measured):
        raise InputError(
            f"it has {len(references)} luminances {REFERENCE} and {len(measured)} {MEASURED} in cd/m²: give its values "
            "in a TOML file"
        )
    points = [point for pair in zip(references, measured, strict=True) for point in _points(*pair)]
    ratios = [reference / shown for reference, shown, _, _ in points]
    correction = sum(ratios) / len(ratios)
    U_rel = max(U for _, _, U, _ in points)  # noqa: N806 - the symbol of the GUM
    apart = max(abs(ratio / correction - 1) for ratio in ratios)
    if apart > U_rel:
        raise InputError(
            f"its corrections differ by up to {apart:.2%} from their mean, more than U of {U_rel:.2%}: choose one for "
            "your luminances, and give it in a TOML file"
        )
    lowest, highest = (f(reference for reference, *_ in points) for f in (min, max))
    values: dict[str, Any] = {
        "number": certificate.number,
        "laboratory": certificate.laboratory or "not stated",
        "date": certificate.end,
        "correction": correction,
        "expanded_uncertainty_rel": U_rel + apart,
        "coverage_factor": min(k for *_, k in points),
        "conditions": certificate.method,
    }
    stated = {"model": certificate.model, "serial": certificate.serial}
    values |= {key: value for key, value in stated.items() if value}
    return values | ({"range_cd_m2": (lowest, highest)} if lowest < highest else {})


def _points(reference: CertifiedQuantity, measured: CertifiedQuantity) -> Sequence[tuple[float, float, float, float]]:
    """Return luminance of reference and meter, relative U of their ratio, and k, for each point."""
    n = len(reference.values)
    if len(measured.values) != n or not (reference.expanded or measured.expanded):
        raise InputError(
            f"it has {n} luminances of the reference and {len(measured.values)} of the meter, "
            f"{'with' if reference.expanded or measured.expanded else 'without'} uncertainties: give its values in a "
            "TOML file"
        )
    if min(*reference.values, *measured.values) <= 0:
        raise InputError("it has a luminance that is not above 0: give its values in a TOML file")
    parts = [
        [U / value for U, value in zip(quantity.expanded or (0.0,) * n, quantity.values, strict=True)]
        for quantity in (reference, measured)
    ]
    factors = [
        quantity.coverage_factors * (n if len(quantity.coverage_factors) == 1 else 1)
        for quantity in (reference, measured)
    ]
    k = factors[0] if reference.expanded else factors[1]
    U_rel = [hypot(a, b) for a, b in zip(*parts, strict=True)]  # noqa: N806 - the symbol of the GUM
    return list(zip(reference.values, measured.values, U_rel, k, strict=True))


def meter_dcc(certificate: StatedCertificate, meter: MeterIdentity) -> bytes:
    """Return a certificate of a meter as XML, with the luminances at the ends of its range.

    Raises
    ------
    InputError
        If it states no range.

    Examples
    --------
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.session import MeterCertificate
    >>> from labcdp.session.dcc import meter_dcc
    >>> stated = {"number": "1234", "laboratory": "PTB", "date": "2026-03-31", "expanded_uncertainty_rel": 0.012}
    >>> meter_dcc(MeterCertificate(**stated, range_cd_m2=(1.0, 1000.0)), MeterIdentity("LS-110", "4711"))[:5]
    b'<?xml'
    """
    if certificate.range_cd_m2 is None:
        raise InputError("a digital certificate states luminances: give range_cd_m2 in [meter.certificate]")
    references = certificate.range_cd_m2
    shown = tuple(reference / certificate.correction for reference in references)
    expanded = tuple(certificate.expanded_uncertainty_rel * reference for reference in references)
    k = (certificate.coverage_factor,)
    return write_dcc(
        DigitalCertificate(
            number=certificate.number,
            begin=certificate.date,
            end=certificate.date,
            laboratory=certificate.laboratory,
            laboratory_address="not stated",
            country=NO_COUNTRY,
            customer="not stated",
            customer_address="not stated",
            person="not stated",
            item="luminance meter",
            manufacturer="not stated",
            model=certificate.model or meter.model,
            serial=certificate.serial or meter.serial,
            quantities=(
                CertifiedQuantity("luminance", REFERENCE, LUMINANCE, references, expanded, k),
                CertifiedQuantity("luminance shown by the meter", MEASURED, LUMINANCE, shown),
            ),
            method=certificate.conditions,
            software=version("labcdp"),
        )
    )
