"""Digital calibration certificates (DCC) of PTB: XML with what a certificate states, for machines.

Version 3.1.2 is written (https://ptb.de/dcc/v3.1.2/); versions 3 are read. Quantities are those of D-SI 2
(https://ptb.de/si/v2.1.0/). Elements are built and found by Python's own ``xml.etree``; what is written was checked
with lxml against dcc.xsd 3.1.2, which is no part of labcdp. Signatures are noted, not checked.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from math import isfinite
from typing import Final
from xml.etree import ElementTree

from .disk.files import quoted
from .errors import InputError, naming

VERSION: Final = "3.1.2"
DCC: Final = "https://ptb.de/dcc"
SI: Final = "https://ptb.de/si"
_SCHEMA_INSTANCE: Final = "http://www.w3.org/2001/XMLSchema-instance"
#: Element of an XML signature (W3C, XML Signature Syntax and Processing).
_SIGNATURE: Final = "{http://www.w3.org/2000/09/xmldsig#}Signature"
#: Units of D-SI that are used here, in the BIPM's SI as siunitx writes them.
LUMINANCE: Final = r"\candela\metre\tothe{-2}"
ONE: Final = r"\one"
#: Kinds of quantities by the DCC's good practice.
REFERENCE, MEASURED = "basic_referenceValue", "basic_measuredValue"
#: Country that is not stated, among the codes that ISO 3166 leaves to users.
NO_COUNTRY: Final = "ZZ"
_COVERAGE_PROBABILITY: Final = 0.95
#: Characters that XML 1.0 does not have, section 2.2.
_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
#: Start of a file: an XML declaration, a comment, or the root.
_START: Final = re.compile(rb"(?:\xef\xbb\xbf)?\s*<")


@dataclass(frozen=True)
class CertifiedQuantity:
    """A quantity of a certificate, at one or several points.

    Parameters
    ----------
    name : str
        In words.
    kind : str
        ``refType`` of the DCC, for example `REFERENCE` or `MEASURED`.
    unit : str
        In D-SI, for example `LUMINANCE`.
    values, expanded : tuple of float
        Values, and their expanded uncertainties U; of the latter none if they are not stated.
    coverage_factors : tuple of float
        k of U, one for all values or one for each.

    Raises
    ------
    InputError
        If values and uncertainties do not fit together, or are not finite.

    Examples
    --------
    >>> from labcdp.core.dcc import LUMINANCE, REFERENCE, CertifiedQuantity
    >>> CertifiedQuantity("luminance", REFERENCE, LUMINANCE, (1.0, 100.0), (0.02, 1.5)).coverage_factors
    (2.0,)
    """

    name: str
    kind: str
    unit: str
    values: tuple[float, ...]
    expanded: tuple[float, ...] = ()
    coverage_factors: tuple[float, ...] = (2.0,)

    def __post_init__(self) -> None:
        n = len(self.values)
        if n == 0 or len(self.expanded) not in (0, n) or len(self.coverage_factors) not in (1, n):
            raise InputError(
                f"quantity {quoted(self.name)} has {n} values, {len(self.expanded)} uncertainties and "
                f"{len(self.coverage_factors)} coverage factors: give one uncertainty for each value"
            )
        if not all(map(isfinite, (*self.values, *self.expanded, *self.coverage_factors))):
            raise InputError(f"quantity {quoted(self.name)} has a number that is not finite")


@dataclass(frozen=True)
class DigitalCertificate:
    """What a digital calibration certificate states.

    Parameters
    ----------
    number : str
        Unique identifier.
    begin, end : date
        First and last day of the calibration.
    laboratory, laboratory_address, country : str
        Who calibrated; the country as two letters (ISO 3166).
    customer, customer_address : str
        For whom.
    person : str
        Who is responsible.
    item, manufacturer, model, serial : str
        What was calibrated.
    quantities : tuple of CertifiedQuantity
        The results.
    method : str
        How they were found.
    statements : tuple of str
        What else is declared, for example on traceability.
    software : str
        Version of labcdp.
    is_signed : bool
        Whether it was read with an XML signature, which is not checked.

    Examples
    --------
    >>> from datetime import date
    >>> from labcdp.core.dcc import DigitalCertificate, read_dcc, write_dcc
    >>> from labcdp.core.dcc import LUMINANCE, MEASURED, CertifiedQuantity
    >>> day, measured = date(2026, 3, 1), CertifiedQuantity("luminance", MEASURED, LUMINANCE, (10.0,), (0.1,))
    >>> made = DigitalCertificate("1234", day, day, "Lab", "Street 1", "DE", "Lab", "Street 1", "N. N.",
    ...                           "luminance meter", "Konica Minolta", "LS-110", "4711", (measured,))
    >>> read_dcc(write_dcc(made), "my.xml") == made
    True
    """

    number: str
    begin: date
    end: date
    laboratory: str
    laboratory_address: str
    country: str
    customer: str
    customer_address: str
    person: str
    item: str
    manufacturer: str
    model: str
    serial: str
    quantities: tuple[CertifiedQuantity, ...]
    method: str = ""
    statements: tuple[str, ...] = ()
    software: str = ""
    is_signed: bool = False

    def quantities_of_kind(self, kind: str, unit: str) -> tuple[CertifiedQuantity, ...]:
        """Return the quantities of a kind and unit."""
        return tuple(q for q in self.quantities if kind in q.kind.split() and _same_unit(q.unit, unit))


def is_dcc(data: bytes) -> bool:
    """Whether a file is, by its start, a digital calibration certificate.

    Examples
    --------
    >>> from labcdp.core.dcc import is_dcc
    >>> is_dcc(b"<?xml version='1.0'?><dcc:digitalCalibrationCertificate"), is_dcc(b"number = 1")
    (True, False)
    """
    return _START.match(data) is not None and b"digitalCalibrationCertificate" in data[:4096]


# Writing


def write_dcc(certificate: DigitalCertificate) -> bytes:
    """Return a certificate as XML; characters that XML does not have become U+FFFD.

    Examples
    --------
    See `DigitalCertificate`.
    """
    ElementTree.register_namespace("dcc", DCC)
    ElementTree.register_namespace("si", SI)
    ElementTree.register_namespace("xsi", _SCHEMA_INSTANCE)
    root = ElementTree.Element(_dcc("digitalCalibrationCertificate"), {"schemaVersion": VERSION})
    root.set(f"{{{_SCHEMA_INSTANCE}}}schemaLocation", f"{DCC} {DCC}/v{VERSION}/dcc.xsd")
    administrative = _add(root, "administrativeData")
    _add_software(administrative, certificate.software)
    _add_core(administrative, certificate)
    _add_item(administrative, certificate)
    laboratory = _add(administrative, "calibrationLaboratory")
    _add_contact(laboratory, "contact", certificate.laboratory, certificate.laboratory_address)
    person = _add(_add(administrative, "respPersons"), "respPerson")
    _text(_add(_add(person, "person"), "name"), certificate.person)
    _add(person, "mainSigner", "true")
    _add_contact(administrative, "customer", certificate.customer, certificate.customer_address)
    if certificate.statements:
        statements = _add(administrative, "statements")
        for statement in certificate.statements:
            _text(_add(_add(statements, "statement"), "declaration"), statement)
    _add_results(root, certificate)
    ElementTree.indent(root)
    data: bytes = ElementTree.tostring(root, "utf-8", xml_declaration=True)
    return data + b"\n"


def _dcc(name: str) -> str:
    return f"{{{DCC}}}{name}"


def _si(name: str) -> str:
    return f"{{{SI}}}{name}"


def _add(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, _dcc(name))
    child.text = None if text is None else _NOT_XML.sub("\ufffd", text)
    return child


def _text(parent: ElementTree.Element, text: str) -> None:
    _add(parent, "content", text).set("lang", "en")


def _add_software(parent: ElementTree.Element, version: str) -> None:
    software = _add(_add(parent, "dccSoftware"), "software")
    _text(_add(software, "name"), "labcdp")
    _add(software, "release", version)
    _add(software, "type", "application")


def _add_core(parent: ElementTree.Element, certificate: DigitalCertificate) -> None:
    core = _add(parent, "coreData")
    for name, text in (
        ("countryCodeISO3166_1", certificate.country),
        ("usedLangCodeISO639_1", "en"),
        ("mandatoryLangCodeISO639_1", "en"),
        ("uniqueIdentifier", certificate.number),
        ("beginPerformanceDate", certificate.begin.isoformat()),
        ("endPerformanceDate", certificate.end.isoformat()),
        ("performanceLocation", "laboratory"),
    ):
        _add(core, name, text)


def _add_item(parent: ElementTree.Element, certificate: DigitalCertificate) -> None:
    item = _add(_add(parent, "items"), "item")
    _text(_add(item, "name"), certificate.item)
    _text(_add(_add(item, "manufacturer"), "name"), certificate.manufacturer)
    _add(item, "model", certificate.model)
    identification = _add(_add(item, "identifications"), "identification")
    _add(identification, "issuer", "manufacturer")
    _add(identification, "value", certificate.serial)
    _text(_add(identification, "name"), "Serial number")


def _add_contact(parent: ElementTree.Element, name: str, who: str, address: str) -> None:
    contact = _add(parent, name)
    _text(_add(contact, "name"), who)
    _add(contact, "eMail", "")  # the schema asks for it, and it is not known
    _text(_add(_add(contact, "location"), "further"), address)


def _add_results(root: ElementTree.Element, certificate: DigitalCertificate) -> None:
    measured = _add(_add(root, "measurementResults"), "measurementResult")
    _text(_add(measured, "name"), certificate.item)
    if certificate.method:
        method = _add(_add(measured, "usedMethods"), "usedMethod")
        _text(_add(method, "name"), "Method")
        _text(_add(method, "description"), certificate.method)
    result = _add(_add(measured, "results"), "result")
    _text(_add(result, "name"), "Results")
    data = _add(result, "data")
    for stated in certificate.quantities:
        quantity = _add(data, "quantity")
        quantity.set("refType", stated.kind)
        _text(_add(quantity, "name"), stated.name)
        listed = ElementTree.SubElement(quantity, _si("realListXMLList"))
        _add_si(listed, "valueXMLList", _numbers(stated.values))
        _add_si(listed, "unitXMLList", stated.unit)
        if stated.expanded:
            uncertainty = _add_si(listed, "expandedUncXMLList")
            _add_si(uncertainty, "uncertaintyXMLList", _numbers(stated.expanded))
            _add_si(uncertainty, "coverageFactorXMLList", _numbers(stated.coverage_factors))
            _add_si(uncertainty, "coverageProbabilityXMLList", _numbers((_COVERAGE_PROBABILITY,)))


def _add_si(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, _si(name))
    child.text = text
    return child


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


# Reading


def read_dcc(data: bytes, source: str) -> DigitalCertificate:
    """Read a digital calibration certificate of version 3; messages call it `source`.

    Texts are those in English, else the first. What is not stated is an empty text.

    Raises
    ------
    InputError
        If it is not XML, not a certificate of version 3, or lacks number, date or item.

    Examples
    --------
    See `DigitalCertificate`.
    """
    with naming(source):
        root = _parsed(data)
        version = root.get("schemaVersion", "")
        if root.tag != _dcc("digitalCalibrationCertificate") or not version.startswith("3."):
            raise InputError(
                f"it is not a digital calibration certificate of version 3 (root {quoted(root.tag)}, version "
                f"{quoted(version)}): give one, or its values in a TOML file"
            )
        core = _required(root, "administrativeData/coreData")
        item = _required(root, "administrativeData/items/item")
        laboratory = _path(root, "administrativeData/calibrationLaboratory/contact")
        customer = _path(root, "administrativeData/customer")
        software = _path(root, "administrativeData/dccSoftware/software")
        statements = root.iterfind(_steps("administrativeData/statements/statement/declaration"))
        return DigitalCertificate(
            number=_required_text(core, "uniqueIdentifier"),
            begin=_date(core, "beginPerformanceDate"),
            end=_date(core, "endPerformanceDate"),
            laboratory=_content(laboratory, "name"),
            laboratory_address=_address(laboratory),
            country=_plain(core, "countryCodeISO3166_1"),
            customer=_content(customer, "name"),
            customer_address=_address(customer),
            person=_content(_path(root, "administrativeData/respPersons/respPerson/person"), "name"),
            item=_content(item, "name"),
            manufacturer=_content(_path(item, "manufacturer"), "name"),
            model=_plain(item, "model"),
            serial=_serial(item),
            quantities=tuple(_quantities(root)),
            method=_content(_path(root, "measurementResults/measurementResult/usedMethods/usedMethod"), "description"),
            statements=tuple(_content(statement) for statement in statements),
            software=_plain(software, "release"),
            is_signed=next(root.iter(_SIGNATURE), None) is not None,
        )


def _parsed(data: bytes) -> ElementTree.Element:
    # Entities can grow without bound, and a certificate needs none.
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise InputError("it has a document type definition, which a digital calibration certificate has not")
    try:
        return ElementTree.fromstring(data)  # noqa: S314 - without entities, and of a limited size
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"it is not XML ({error})") from error


def _steps(path: str) -> str:
    return "/".join(_dcc(step) for step in path.split("/"))


def _path(parent: ElementTree.Element | None, path: str) -> ElementTree.Element | None:
    return None if parent is None else parent.find(_steps(path))


def _required(parent: ElementTree.Element, path: str) -> ElementTree.Element:
    child = _path(parent, path)
    if child is None:
        raise InputError(f"it lacks {path}")
    return child


def _plain(parent: ElementTree.Element | None, path: str) -> str:
    child = _path(parent, path)
    return "" if child is None else (child.text or "").strip()


def _required_text(parent: ElementTree.Element, path: str) -> str:
    if not (text := _plain(parent, path)):
        raise InputError(f"it lacks {path}")
    return text


def _date(core: ElementTree.Element, name: str) -> date:
    text = _required_text(core, name)
    try:
        return date.fromisoformat(text[:10])
    except ValueError:
        raise InputError(f"{name} is {quoted(text)}: give an ISO date") from None


def _content(parent: ElementTree.Element | None, path: str | None = None) -> str:
    """Return the English of several texts, else the first."""
    holder = parent if path is None else _path(parent, path)
    texts = [] if holder is None else holder.findall(_dcc("content"))
    english = [text for text in texts if text.get("lang") == "en"]
    return next((text.text.strip() for text in (*english, *texts) if text.text), "")


def _address(contact: ElementTree.Element | None) -> str:
    location = _path(contact, "location")
    if location is None:
        return ""
    parts = [(part.text or "").strip() or _content(part) for part in location]
    return ", ".join(part for part in parts if part)


def _serial(item: ElementTree.Element) -> str:
    """Return the maker's identification of an item, else the first."""
    identifications = item.findall(_steps("identifications/identification"))
    of_maker = [one for one in identifications if _plain(one, "issuer") == "manufacturer"]
    return next((_plain(one, "value") for one in (*of_maker, *identifications)), "")


def _quantities(root: ElementTree.Element) -> Iterator[CertifiedQuantity]:
    results = _path(root, "measurementResults")
    for quantity in () if results is None else results.iterfind(f".//{_steps('result')}//{_dcc('quantity')}"):
        kind, name = quantity.get("refType", ""), _content(quantity, "name")
        for form, suffix in (("real", ""), ("realListXMLList", "XMLList")):
            for stated in quantity.findall(_si(form)):
                yield _quantity(stated, name, kind, suffix)


def _quantity(stated: ElementTree.Element, name: str, kind: str, suffix: str) -> CertifiedQuantity:
    values = _floats(stated, f"value{suffix}", name)
    # U in D-SI 2.1, and from 2.2 on.
    expanded = _floats(stated, f"uncertainty{suffix}", name) or _floats(stated, f"valueExpandedMU{suffix}", name)
    factors = _floats(stated, f"coverageFactor{suffix}", name) or (2.0,)
    unit = next(stated.iter(_si(f"unit{suffix}")), None)
    units = set() if unit is None else set((unit.text or "").split())
    if len(expanded) == 1:
        expanded *= len(values)
    return CertifiedQuantity(name, kind, units.pop() if len(units) == 1 else "", values, expanded, factors)


def _floats(parent: ElementTree.Element, name: str, quantity: str) -> tuple[float, ...]:
    holder = next(parent.iter(_si(name)), None)
    words = [] if holder is None else (holder.text or "").split()
    try:
        return tuple(float(word) for word in words)
    except ValueError:
        raise InputError(f"{name} of quantity {quoted(quantity)} has text that is not a number") from None


def _same_unit(unit: str, other: str) -> bool:
    """Whether two units of D-SI are the same, in any order of their factors."""
    if unit == other:
        return True
    factors = []
    for text in (unit, other):
        plain = re.sub(r"\\per\\metre(?:\\squared|\\tothe\{2\})", r"\\metre\\tothe{-2}", text)
        factors.append(sorted(re.findall(r"\\[a-z]+(?:\\tothe\{-?\d+\})?", plain)))
    return factors[0] == factors[1]
