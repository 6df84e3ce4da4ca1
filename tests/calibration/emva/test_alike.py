"""Data sets with images that are copies, of another depth, or of another level."""

import re
import shutil

import cv2
import numpy as np
import pytest

from labcdp.calibration.emva.data_set import characterise_data_set
from labcdp.core.errors import InputError

from .conftest import SHORT, SMALL, KnownCamera, write_data_set, write_image


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write_data_set(tmp_path_factory.mktemp("sound") / "set", SMALL, SHORT)


@pytest.fixture
def index(sound, tmp_path):
    """A copy to spoil."""
    shutil.copytree(sound.parent, tmp_path / "set")
    return tmp_path / "set" / sound.name


def refused(index, message):
    with pytest.raises(InputError, match=message):
        characterise_data_set(index)


@pytest.mark.parametrize(("copy", "original"), [("b_003_001.png", "b_003_000.png"), ("d_005_000.png", "b_004_001.png")])
def test_copies_and_eight_bits_among_sixteen_are_refused(index, copy, original):
    images = index.parent / "images"
    shutil.copy(images / original, images / copy)
    refused(index, rf"has the same pixels as .*{re.escape(min(original, copy, key=index.read_text().index))}")
    write_image(images / copy, (cv2.imread(str(images / original), cv2.IMREAD_UNCHANGED) >> 4).astype(np.uint8))
    refused(index, rf"{copy[:5]}.* has 8 bits per value, b_000_000\.png \(line 5\) has 16")


@pytest.mark.parametrize(
    ("name", "photons"), [("d_004_001.png", 18_000.0), ("b_004_001.png", 14_000.0), ("b_010_002.png", 15_000.0)]
)
def test_an_image_of_another_level_is_refused(index, name, photons):
    (other,) = SMALL.images(photons, 0.01, 1, np.random.default_rng(77))
    write_image(index.parent / "images" / name, other)
    refused(index, rf"{name[:5]}.* has a mean of .* DN, .* which noise does not explain: one of them")


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
    assert [found.responsivity, found.quantum_efficiency, found.saturation_photons] == [None] * 3
    assert abs(found.k_dn_per_e.value - 0.25) < 4 * found.k_dn_per_e.u
