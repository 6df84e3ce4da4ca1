"""Digital calibration certificates: as other programs write them, as labcdp does, and damaged ones."""

from contextlib import suppress
from dataclasses import replace
from datetime import date
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.dcc import (
    LUMINANCE,
    MEASURED,
    REFERENCE,
    CertifiedQuantity,
    DigitalCertificate,
    read_dcc,
    write_dcc,
)
from labcdp.core.errors import ConfigurationError, InputError
from labcdp.core.reading import MeterIdentity
from labcdp.session import MeterCertificate

#: A certificate by hand: two languages, points one by one, units in another order, U as D-SI 2.2 has it.
BY_HAND = """<?xml version="1.0" encoding="UTF-8"?>
<!-- by hand -->
<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="3.3.0">
 <dcc:administrativeData>
  <dcc:coreData>
   <dcc:countryCodeISO3166_1>DE</dcc:countryCodeISO3166_1>
   <dcc:uniqueIdentifier>D-K-15123-2026-03</dcc:uniqueIdentifier>
   <dcc:beginPerformanceDate>2026-03-01</dcc:beginPerformanceDate>
   <dcc:endPerformanceDate>2026-03-02</dcc:endPerformanceDate>
  </dcc:coreData>
  <dcc:items><dcc:item>
   <dcc:name><dcc:content lang="de">Leuchtdichtemesser</dcc:content>
     <dcc:content lang="en">luminance meter</dcc:content></dcc:name>
   <dcc:manufacturer><dcc:name><dcc:content>Konica Minolta</dcc:content></dcc:name></dcc:manufacturer>
   <dcc:model>LS-110</dcc:model>
   <dcc:identifications>
    <dcc:identification><dcc:issuer>customer</dcc:issuer><dcc:value>Inv. 7</dcc:value></dcc:identification>
    <dcc:identification><dcc:issuer>manufacturer</dcc:issuer><dcc:value>73323007</dcc:value></dcc:identification>
   </dcc:identifications>
  </dcc:item></dcc:items>
  <dcc:calibrationLaboratory><dcc:contact>
   <dcc:name><dcc:content lang="de">Lichtlabor</dcc:content></dcc:name>
   <dcc:location><dcc:street>Weg</dcc:street><dcc:streetNo>7</dcc:streetNo></dcc:location>
  </dcc:contact></dcc:calibrationLaboratory>
 </dcc:administrativeData>
 <dcc:measurementResults><dcc:measurementResult><dcc:results><dcc:result><dcc:data><dcc:list>
  POINTS
 </dcc:list></dcc:data></dcc:result></dcc:results></dcc:measurementResult></dcc:measurementResults>
</dcc:digitalCalibrationCertificate>
"""
POINT = """
  <dcc:quantity refType="basic_referenceValue"><si:real><si:value>{true}</si:value>
   <si:unit>\\metre\\tothe{{-2}}\\candela</si:unit>
   <si:measurementUncertaintyUnivariate><si:expandedMU><si:valueExpandedMU>{U}</si:valueExpandedMU>
   <si:coverageFactor>2.0</si:coverageFactor></si:expandedMU></si:measurementUncertaintyUnivariate></si:real></dcc:quantity>
  <dcc:quantity refType="basic_measuredValue other"><si:real><si:value>{shown}</si:value>
   <si:unit>\\candela\\per\\metre\\squared</si:unit></si:real></dcc:quantity>"""


def by_hand(*points):
    text = "".join(POINT.format(true=true, shown=shown, U=U) for true, shown, U in points)
    return BY_HAND.replace("POINTS", text).encode()


@pytest.fixture
def load(tmp_path):
    def load(data):
        path = tmp_path / "meter.xml"
        path.write_bytes(data)
        return MeterCertificate.load(path)

    return load


def test_a_certificate_of_a_meter_by_hand(load):
    certificate = load(by_hand((10.1, 10.0, 0.1), (1010.5, 1000.0, 12.126), (0.505, 0.5, 0.005)))
    assert (certificate.number, certificate.laboratory) == ("D-K-15123-2026-03", "Lichtlabor")
    assert (certificate.date, certificate.model, certificate.serial) == (date(2026, 3, 2), "LS-110", "73323007")
    ratios = [1.01, 1.0105, 1.01]
    mean = sum(ratios) / 3
    assert certificate.correction == pytest.approx(mean)
    # One factor stands for all points: its deviation from them is added to the largest U.
    assert certificate.expanded_uncertainty_rel == pytest.approx(0.012 + 1.0105 / mean - 1)
    assert (certificate.coverage_factor, certificate.range_cd_m2) == (2.0, (0.505, 1010.5))


@pytest.mark.parametrize(
    ("points", "problem"),
    [
        ([], r"it has 0 luminances basic_referenceValue and 0 basic_measuredValue in cd/m²: give its values in a TOML"),
        ([(10, 10, 0.1), (100, 90, 1)], "its corrections differ by up to 5.26% from their mean, more than U of 1.00%"),
        ([(10, 0, 0.1)], "it has a luminance that is not above 0"),
        ([("ten", 10, 0.1)], "has text that is not a number"),
        ([(float("inf"), 10, 0.1)], "not finite"),
    ],
)
def test_what_cannot_be_used_is_said(load, points, problem):
    with pytest.raises(ConfigurationError, match=rf"meter\.xml.*{problem}"):
        load(by_hand(*points))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b'schemaVersion="3.3.0"', b'schemaVersion="2.4.0"', "not a digital calibration certificate of version 3"),
        (b"2026-03-02<", b"2.3.2026<", "endPerformanceDate is '2.3.2026': give an ISO date"),
        (b"<dcc:uniqueIdentifier>D-K-15123-2026-03", b"<dcc:uniqueIdentifier>", "it lacks uniqueIdentifier"),
        (b"</dcc:coreData>", b"", "it is not XML"),
        (b"<!-- by hand -->", b'<!DOCTYPE a [<!ENTITY b "c">]>', "it has a document type definition"),
    ],
)
def test_damaged_certificates(load, old, new, problem):
    data = by_hand((10.1, 10.0, 0.1))
    assert old in data
    with pytest.raises(ConfigurationError, match=problem):
        load(data.replace(old, new))


def test_a_meters_certificate_comes_back_as_it_was_written(load):
    stated = {"number": "1234", "laboratory": "PTB", "date": date(2026, 3, 31), "expanded_uncertainty_rel": 0.012}
    certificate = MeterCertificate(**stated, correction=1.004, coverage_factor=2.1, range_cd_m2=(0.1, 5000.0))
    again = load(certificate.to_dcc(MeterIdentity("LS-110", "73323007")))
    assert (again.model, again.serial) == ("LS-110", "73323007")
    same = ("number", "laboratory", "date", "coverage_factor", "range_cd_m2")
    assert [getattr(again, name) for name in same] == [getattr(certificate, name) for name in same]
    assert again.correction == pytest.approx(1.004)
    assert again.expanded_uncertainty_rel == pytest.approx(0.012)
    with pytest.raises(InputError, match="give range_cd_m2"):
        certificate.model_copy(update={"range_cd_m2": None}).to_dcc(MeterIdentity("LS-110", "1"))


DAY = date(2026, 3, 1)
#: Text as XML gives it back: without control characters, and blanks at the ends.
TEXTS = st.text(st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="\ufffe\uffff"), max_size=20).map(
    str.strip
)
NUMBERS = st.floats(1e-9, 1e9)


@given(number=TEXTS.filter(bool), others=st.lists(TEXTS, min_size=9, max_size=9), values=st.lists(NUMBERS, min_size=1))
def test_whatever_is_written_is_read_again(number, others, values):
    expanded = tuple(0.01 * value for value in values)
    quantity = CertifiedQuantity("L", REFERENCE, LUMINANCE, tuple(values), expanded, (2.0,) * len(values))
    made = DigitalCertificate(number, DAY, DAY, *others[:2], "DE", *others[2:9], (quantity,), "how", ("so",), "0.2")
    again = read_dcc(write_dcc(made), "it")
    assert again == made


@given(st.binary(max_size=200), st.integers(0, 2000))
def test_whatever_is_damaged_is_an_error_or_a_certificate(damage, at):
    quantity = CertifiedQuantity("L", MEASURED, LUMINANCE, (1.0,), (0.1,))
    words = ("a", "b", "DE", "c", "d", "e", "f", "g", "h", "i")
    data = write_dcc(DigitalCertificate("1", DAY, DAY, *words, (quantity,)))
    with suppress(InputError):
        read_dcc(data[:at] + damage + data[at + len(damage) :], "it")


def test_elements_stand_in_the_order_of_the_schema():
    """Of dcc.xsd 3.1.2 and SI_Format.xsd 2.1.0; the whole was checked with them once."""
    quantity = CertifiedQuantity("L", MEASURED, LUMINANCE, (1.0, 2.0), (0.1, 0.2), (2.0, 2.1))
    words = ("a", "b", "DE", "c", "d", "e", "f", "g", "h", "i")
    made = DigitalCertificate("1", DAY, DAY, *words, (quantity,), "how", ("so",), "0.2")
    root = ElementTree.fromstring(write_dcc(made))

    def children(path):
        (parent,) = [root] if not path else root.findall(path)
        return [child.tag.partition("}")[2] for child in parent]

    dcc, si = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
    assert root.get("schemaVersion") == "3.1.2"
    assert children("") == ["administrativeData", "measurementResults"]
    administrative = [
        "dccSoftware",
        "coreData",
        "items",
        "calibrationLaboratory",
        "respPersons",
        "customer",
        "statements",
    ]
    assert children(f"{dcc}administrativeData") == administrative
    item = f"{dcc}administrativeData/{dcc}items/{dcc}item"
    assert children(item) == ["name", "manufacturer", "model", "identifications"]
    assert children(f".//{dcc}measurementResult") == ["name", "usedMethods", "results"]
    assert children(f".//{si}realListXMLList") == ["valueXMLList", "unitXMLList", "expandedUncXMLList"]
    uncertainty = ["uncertaintyXMLList", "coverageFactorXMLList", "coverageProbabilityXMLList"]
    assert children(f".//{si}expandedUncXMLList") == uncertainty


def test_characters_that_xml_does_not_have_are_replaced():
    quantity = CertifiedQuantity("L", MEASURED, LUMINANCE, (1.0,))
    words = ("a", "b", "DE", "c", "d", "e", "f", "g", "h", "i")
    made = DigitalCertificate("1", DAY, DAY, *words, (quantity,))
    assert read_dcc(write_dcc(replace(made, laboratory="a\x00b\ud800")), "it").laboratory == "a\ufffdb\ufffd"


def test_a_signature_is_noted_and_a_warning_says_that_it_was_not_checked(load, caplog):
    plain = by_hand((10.1, 10.0, 0.1))
    signed = plain.replace(
        b"</dcc:digitalCalibrationCertificate>",
        b'<ds:Signature xmlns:ds="http://www.w3.org/2000/09/xmldsig#"/></dcc:digitalCalibrationCertificate>',
    )
    assert (read_dcc(signed, "it").is_signed, read_dcc(plain, "it").is_signed) == (True, False)
    assert load(signed) == load(plain)
    (record,) = caplog.records
    assert "its signature was not checked: check it with a program of the laboratory's or of PTB" in record.message
