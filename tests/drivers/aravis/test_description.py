"""Hostile GenICam descriptions are refused in one line before Aravis parses them."""

import io
import zipfile

import pytest

from labcdp.drivers.aravis import description
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera import CameraError
from labcdp.drivers.simulated import gige_camera
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera
from tests.drivers.conftest import SMALL, Ramp


def chain(n, last):
    links = "".join(f'<Integer Name="N{i}"><pValue>N{i + 1}</pValue></Integer>' for i in range(n - 1))
    return f'<R>{links}<Integer Name="N{n - 1}"><pValue>{last}</pValue></Integer></R>'


HOSTILE = {
    "itself": (chain(1, "N0"), "'N0' follows from itself"),
    "cycle of 2": (chain(2, "N0"), "follows from itself"),
    "cycle of 1000": (chain(1000, "N500"), "follows from itself"),
    "long chain": (chain(1000, "M"), "chain of more than 256"),
    "category": ('<R><Category Name="Root"><pFeature>Root</pFeature></Category></R>', "'Root' follows from itself"),
    "formula": ('<R><IntSwissKnife Name="A"><pVariable Name="X">A</pVariable></IntSwissKnife></R>', "from itself"),
    "nesting": ("<a>" * 5000 + "</a>" * 5000, "nested more than"),
    "entities": ('<!DOCTYPE a [<!ENTITY b "c"><!ENTITY d "&b;&b;">]><a>&d;</a>', "document type"),
    "no XML": ("<a><b></a>", "not valid XML"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_description_is_refused_before_it_is_parsed(aravis, monkeypatch, kind):
    text, said = HOSTILE[kind]
    monkeypatch.setattr(gige_camera, "description", lambda *_: text)
    with SimulatedGigECamera(SMALL, Ramp()), pytest.raises(CameraError, match=said) as error, AravisCamera("127.0.0.1"):
        pass
    assert "\n" not in str(error.value)


def test_bounds_that_depend_on_each_others_values_are_no_cycle():
    text = b"""<R><Integer Name="Width"><pValue>W</pValue><pMax>WM</pMax></Integer>
    <IntSwissKnife Name="WM"><pVariable Name="O">Offset</pVariable></IntSwissKnife>
    <Integer Name="Offset"><pValue>O</pValue><pMax>OM</pMax></Integer>
    <IntSwissKnife Name="OM"><pVariable Name="W">Width</pVariable></IntSwissKnife></R>"""
    description.check_text(text)


def test_archives_and_texts_without_end_are_refused_without_the_memory(monkeypatch):
    monkeypatch.setattr(description, "_MOST_TEXT_BYTES", 10**5)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.xml", b" " * 10**6)
    for data, said in ((packed.getvalue(), "unpacks to more"), (packed.getvalue()[:-30], "cannot be unpacked")):
        with pytest.raises(description.UnusableError, match=said):
            description._unpacked(data)
    with pytest.raises(description.UnusableError, match="more than"):
        description.check_text(b" " * (10**5 + 1))


def test_a_description_elsewhere_or_of_any_size_is_refused(aravis, monkeypatch):
    for url, said in (
        (b"file:///dev/zero", "not kept in the camera"),
        (b"Local:a.zip;10000;FFFFFFF0", "bytes, more than"),
    ):
        monkeypatch.setattr(description, "_read", lambda *_, url=url: url)
        with pytest.raises(CameraError, match=said):
            description.check_description("127.0.0.1")
