"""Clear pixels, RCCB and RCCC: read, split and calibrated as Bayer is, with the clear ones for luminance."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile

import labcdp
from labcdp.calibration.frames.measure import split
from labcdp.core.errors import InputError
from labcdp.files import Companding
from labcdp.session import SessionConfiguration

from ...series_camera import BLACK_DN, CODES, VALUES, SeriesCamera
from ..conftest import make_frame
from ..test_series_camera import imported

FILTERS = ("RCCB", "CRBC", "CBRC", "BCCR", "RCCC", "CRCC", "CCRC", "CCCR")
#: Sensitivities of the pixels to the light of the patches, over those of the clear ones.
SENSITIVITY = {"R": 0.45, "C": 1.0, "B": 0.25}
FRONT = Companding("front", CODES, VALUES, 12, black_value=BLACK_DN)


def behind(name, shape):
    """Sensitivity of each pixel."""
    cell = np.array([SENSITIVITY[colour] for colour in name]).reshape(2, 2)
    return np.tile(cell, (shape[0] // 2, shape[1] // 2))


@pytest.mark.parametrize("name", FILTERS)
def test_luminance_of_a_picture_is_that_of_its_clear_pixels(tmp_path, name):
    values = np.random.default_rng(1).integers(100, 4000, (40, 60)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "mosaic.tif", values)
    image = labcdp.read_image(tmp_path / "mosaic.tif", bayer=name, bit_depth=12, no_vignetting=True)
    places = [divmod(at, 2) for at, colour in enumerate(name) if colour == "C"]
    clear = np.mean([values[y::2, x::2] for y, x in places], axis=0)
    assert len(places) == name.count("C")
    assert np.asarray(image.luminance) * 4096 == pytest.approx(clear, rel=1e-6)
    assert "clear-pixels-only" in [finding.code for finding in image.findings]
    with pytest.raises(InputError, match="bayer is 'RCCG': give RGGB, "):
        labcdp.read_image(tmp_path / "mosaic.tif", bayer="RCCG")


@pytest.mark.parametrize("name", FILTERS)
def test_planes_have_the_pixels_of_their_colour(name):
    dn = np.arange(48).reshape(6, 8)
    planes = split(replace(make_frame(dn), colour_filter=name))
    colours = np.tile(np.array(list(name)).reshape(2, 2), (3, 4))
    assert np.isin(planes["R"].dn, dn[colours == "R"]).all()
    assert np.isin(planes["B"].dn, dn[colours == ("B" if "B" in name else "C")]).all()
    for plane in ("Gr", "Gb"):
        assert np.isin(planes[plane].dn, dn[colours == "C"]).all()
    assert np.array_equal(np.sort(np.concatenate([p.dn.ravel() for p in planes.values()])), np.arange(48))


class Filtered(SeriesCamera):
    """A series camera behind a filter."""

    name = "RCCB"

    def codes(self, scene_cd_m2, exposure_s, rng):
        """Codes of a frame behind the filter."""
        scene = scene_cd_m2 * behind(self.name, scene_cd_m2.shape)
        return super().codes(scene, exposure_s, rng)


class FilteredRCCC(Filtered):
    """Of red and three clear pixels."""

    name = "RCCC"


@pytest.mark.parametrize("kind", [Filtered, FilteredRCCC])
def test_a_session_is_calibrated_behind_its_filter(tmp_path, kind):
    camera = kind()
    session = imported(tmp_path, camera, capture=kind.codes, colour_filter=kind.name)
    frame = session.load(session.frames("light")[0])
    assert (frame.colour_filter, frame.companding) == (kind.name, FRONT)
    assert SessionConfiguration.load(tmp_path / "bench.toml").camera.colour_filter == kind.name
    calibration = session.calibrate().calibration
    names = dict(zip(("R", "Gr", "Gb", "B"), ("R", "C", "C", "C" if kind is FilteredRCCC else "B"), strict=True))
    for plane in calibration.planes:
        fit, truth = plane.responsivity, camera.dn_s_cd_m2 * SENSITIVITY[names[plane.state.plane]]
        assert abs(fit.responsivity_dn_s_cd_m2 / truth - 1) < 4 * fit.random_rel
    rows = session.evaluate(calibration).evaluation.patches
    for row, truth in zip(rows, camera.luminances_cd_m2, strict=True):
        low, high = row.calibrated.interval_95_cd_m2
        assert low < truth < high
