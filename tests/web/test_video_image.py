"""Frames of videos to draw on, against what was written."""

import cv2
import numpy as np
import pytest

from labcdp.evaluate.picture.conversion import picture_conversion
from labcdp.files.video.selection import Position
from labcdp.session import Session, example_session
from labcdp.web.regions.page_image import video_image

from ..evaluate.video.videos import write

SHAPE = 48, 64


def frame(number):
    """Two halves, the right one brighter with each frame."""
    return np.where(np.arange(SHAPE[1]) < SHAPE[1] // 2, 20, 60 + 30 * number) * np.ones(SHAPE, dtype=np.uint8)


@pytest.fixture
def video(tmp_path):
    return write(tmp_path / "drive.mkv", [frame(number).astype(np.uint8) for number in range(5)])


def opened(path, at):
    return video_image(path, Position.parse(at, "--frame"), picture_conversion(None, None, None))


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
