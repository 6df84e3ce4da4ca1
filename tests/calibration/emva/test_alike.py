"""Data sets with images that are copies, of another depth, or of another level."""

import re
import shutil

import cv2
import numpy as np
import pytest

from labcdp.calibration.emva import characterise_data_set
from labcdp.core.errors import InputError
from labcdp.evaluate.camera.figures import signal_figures

from .conftest import KnownCamera, Recording, write_data_set, write_image

SMALL = KnownCamera(shape=(24, 32))
SHORT = Recording(levels=10, stack=4)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write_data_set(tmp_path_factory.mktemp("sound") / "set", SMALL, SHORT)


@pytest.fixture
def index(sound, tmp_path):
    """A copy to spoil."""
    shutil.copytree(sound.parent, tmp_path / "set")
    return tmp_path / "set" / sound.name


def read(index, name):
    return cv2.imread(str(index.parent / "images" / name), cv2.IMREAD_UNCHANGED)


def line_of(index, name):
    lines = index.read_text().splitlines()
    return next(number for number, line in enumerate(lines, start=1) if line.endswith(name))


def refused(index, message):
    with pytest.raises(InputError, match=message) as caught:
        characterise_data_set(index)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("copy", "original"),
    [("b_003_001.png", "b_003_000.png"), ("d_005_000.png", "b_004_001.png")],
)
def test_copies_are_refused(index, copy, original):
    images = index.parent / "images"
    shutil.copy(images / original, images / copy)
    first, second = sorted((original, copy), key=lambda name: line_of(index, name))
    where = rf"line {line_of(index, second)}: {second} has the same pixels as {first} \(line {line_of(index, first)}\)"
    refused(index, rf"EMVA1288_Data\.txt, {where}: no two exposures are alike".replace(".png", r"\.png"))


def test_eight_bits_among_sixteen_are_refused(index):
    image = read(index, "b_003_001.png")
    write_image(index.parent / "images" / "b_003_001.png", (image >> 4).astype(np.uint8))
    refused(index, r"b_003_001\.png has 8 bits per value, b_000_000\.png \(line 5\) has 16: give all images as")


@pytest.mark.parametrize(
    ("name", "photons", "others"),
    [
        ("d_004_001.png", 18_000.0, r"d_004_000\.png \(line \d+\) one of \d+\.?\d* DN"),
        ("b_004_001.png", 14_000.0, r"b_004_000\.png \(line \d+\) one of \d+\.?\d* DN"),
        ("b_010_002.png", 15_000.0, r"the other 3 images of its block \d+ DN"),
    ],
)
def test_an_image_of_another_level_is_refused(index, name, photons, others):
    (other,) = SMALL.images(photons, 0.01, 1, np.random.default_rng(77))
    write_image(index.parent / "images" / name, other)
    # Of a pair either may be named first.
    either, others = name.replace("001.png", r"00[01]\.png"), others.replace("000", "00[01]")
    refused(index, rf"line \d+: {either} has a mean of .* DN, {others}, which noise does not explain: one of them")


def test_flicker_of_the_lamp_passes(tmp_path):
    class Flickering(KnownCamera):
        def images(self, photons, exposure_s, count, rng):
            return [SMALL.images(photons * rng.uniform(0.996, 1.004), exposure_s, 1, rng)[0] for _ in range(count)]

    found = characterise_data_set(write_data_set(tmp_path / "set", Flickering(shape=SMALL.shape), SHORT))
    assert found.k_dn_per_e.value == pytest.approx(0.25, rel=0.2)


def test_a_level_with_wrong_photons_is_flagged(index):
    text = index.read_text()
    photons = re.search(r"b \S+ (\S+)\ni images\\b_005_000", text)[1]
    index.write_text(text.replace(f" {photons}\ni images\\b_005_000", f" {1.2 * float(photons)}\ni images\\b_005_000"))
    (finding,) = (one for one in characterise_data_set(index).findings if one.code == "not-linear")
    assert -0.3 < finding.values["deviation_rel"] < -0.1


def test_without_photons_there_is_no_responsivity(index):
    # The light grows as the exposure does.
    index.write_text(re.sub(r"^b (\S+) \S+$", r"b \1 0", index.read_text(), flags=re.MULTILINE))
    found = characterise_data_set(index)
    assert found.responsivity is None
    assert found.quantum_efficiency is None
    assert found.saturation_photons is None
    assert abs(found.k_dn_per_e.value - 0.25) < 4 * found.k_dn_per_e.standard_uncertainty
    assert "photons-unknown" in [one.code for one in found.findings]
    assert len(signal_figures(found)) == 5
