"""Images of the page. Profile, isolines, scale and export of a luminance map, against what it is made of."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.evaluate.picture.converter import make_converter
from labcdp.files.luminance_file import load_luminance
from labcdp.files.video.selection import Position
from labcdp.session import Session, example_session
from labcdp.web.regions.display import DisplayScale
from labcdp.web.regions.map_data import dataset_image, export_map, isolines, profile
from labcdp.web.regions.page_image import PageImage, video_image

from ..evaluate.video.videos import write

HEIGHT, WIDTH = 60, 90


@pytest.fixture
def image():
    """A plane of 1 to 2 cd/m² from left to right, with 3 % of each pixel alone and 4 % of all together."""
    light = np.broadcast_to(np.linspace(1, 2, WIDTH), (HEIGHT, WIDTH)).astype(np.float32)
    invalid = np.zeros((HEIGHT, WIDTH), np.uint8)
    invalid[0, 0] = Invalid.SATURATED
    luminance = LuminanceMap(light, np.full_like(light, 0.03), 0.04, invalid)
    return PageImage("plane", light, False, None, luminance, "cd/m^2")


def test_a_profile_reads_the_pixels_along_a_line_with_their_uncertainty(image):
    along = profile(image, (10.5, 5.5, 40.5, 45.5))
    assert (along.distance_px[0], along.distance_px[-1]) == (0, 50)
    columns = np.floor(10.5 + along.distance_px * 0.6).astype(int)
    assert along.luminance == pytest.approx(image.luminance.luminance_cd_m2[0, columns], abs=0.012)
    # Both parts are independent: 3 % and 4 % are 5 %.
    assert along.expanded / along.luminance == pytest.approx(1.96 * 0.05, rel=1e-3)
    # A map of its parts says the same, and so does the value under the pointer.
    of_parts = replace(image, light=lambda window: _cut(image.luminance, window))
    assert profile(of_parts, (10.5, 5.5, 40.5, 45.5)).expanded.tolist() == along.expanded.tolist()
    assert of_parts.readout(44.2, 3.3) == image.readout(44.2, 3.3) == "x 44, y 3 · 1.49 ± 0.15 cd/m²"
    # What is outside is left out.
    assert len(profile(image, (-20, 5, 20, 5)).luminance) == 21
    with pytest.raises(InputError, match="outside the image"):
        profile(image, (-20, 5, -2, 5))


def _cut(luminance, window):
    return LuminanceMap(
        luminance.luminance_cd_m2[window], luminance.random_rel[window], 0.04, luminance.invalid[window]
    )


def test_an_isoline_of_a_plane_is_straight(image):
    (line,) = isolines(image.luminance, [1.5])
    # The middle of the pixels of 1.5 cd/m².
    assert line.x == pytest.approx(0.5 * (WIDTH - 1) + 0.5, abs=0.01)
    assert np.ptp(line.y) == HEIGHT - 1


@pytest.mark.parametrize("name", ["linear", "logarithm"])
def test_colours_span_the_range_and_mark_what_is_beyond(image, name):
    scale = DisplayScale(name, 1.25, 1.75, ends_apart=True)
    values = np.array([-np.inf, 0.5, 1.25, np.sqrt(1.25 * 1.75) if name == "logarithm" else 1.5, 1.75, 3, np.inf])
    assert np.abs(scale.to_8_bit(values).astype(int) - [0, 1, 1, 127.5, 254, 254, 255]).max() <= 0.5
    assert np.argwhere(~np.isfinite(image.light_display)).tolist() == [[0, 0]]


def test_a_map_is_exported_once(image, tmp_path):
    scale = DisplayScale("linear", 1.0, 2.0)
    for name in ("map.csv", "map.png", "map.tif", "map.exr"):
        export_map(image, tmp_path / name, scale)
    light = image.luminance.luminance_cd_m2
    assert np.loadtxt(tmp_path / "map.csv", delimiter=",") == pytest.approx(light, rel=1e-5)
    for name in ("map.tif", "map.exr"):
        assert np.array_equal(load_luminance(tmp_path / name)[0].luminance_cd_m2, light)
    with pytest.raises(InputError, match="exists already"):
        export_map(image, tmp_path / "map.csv", scale)
    with pytest.raises(InputError, match="relative"):
        export_map(replace(image, unit="relative"), tmp_path / "other.tif", scale)


def test_a_map_that_python_saved_is_read(image, tmp_path):
    export_map(image, tmp_path / "map.tif", DisplayScale("linear", 1.0, 2.0))
    labcdp.read_image(tmp_path / "map.tif").to_dataset().to_netcdf(tmp_path / "map.nc")
    read = dataset_image(tmp_path / "map.nc")
    assert np.array_equal(read.luminance.luminance_cd_m2, image.luminance.luminance_cd_m2)
    # Without the common 4 %.
    assert read.readout(44.2, 3.3) == "x 44, y 3 · 1.494 ± 0.088 cd/m²"


# Frames of videos to draw on, against what was written


SHAPE = 48, 64


def frame(number):
    """Two halves, the right one brighter with each frame."""
    return np.where(np.arange(SHAPE[1]) < SHAPE[1] // 2, 20, 60 + 30 * number) * np.ones(SHAPE, dtype=np.uint8)


@pytest.fixture
def video(tmp_path):
    return write(tmp_path / "drive.mkv", [frame(number).astype(np.uint8) for number in range(5)])


def opened(path, at):
    return video_image(path, Position.parse(at, "--frame"), make_converter())


@pytest.mark.parametrize(("at", "number"), [("0", 0), ("3", 3), ("0.08s", 2), ("0.06s", 2)])
def test_the_frame_that_was_asked_for(video, at, number):
    image = opened(video, at)
    assert (image.values == frame(number)).all()
    assert (image.luminance.luminance_cd_m2 == frame(number) / 256).all()
    assert (image.name, image.unit, image.size) == (f"drive.mkv, frame {number}", "relative", SHAPE[::-1])
    assert "relative-luminance" in {one.code for one in image.findings}


def test_a_frame_of_a_session_and_of_a_folder_of_images(tmp_path):
    with Session.open(example_session()) as session:
        dn = session.load(session.frames("light")[1]).dn
    assert (opened(example_session(), "1").values == dn).all()
    for number in (8, 9, 10):
        assert cv2.imwrite(str(tmp_path / f"f{number}.png"), frame(number - 8).astype(np.uint8))
    assert (opened(tmp_path, "10").values == frame(2)).all()
