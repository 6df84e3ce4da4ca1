from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp.core.roi import Roi
from labcdp.evaluate.video.annotated import AnnotatedVideo, FrameImages, annotated_picture
from labcdp.tracking import TrackedRoi

GREY = np.tile(np.linspace(20, 220, 161).astype(np.uint8), (121, 1))
ROW = {"time_s": 0.4, "note": "", "cdp": np.array([0.5, 0.25]), "measured_contrast": 9.8}


def test_regions_are_drawn_where_they_are_and_nothing_else_over_the_picture() -> None:
    grey = np.full((500, 700), 90, np.uint8)
    tracked = TrackedRoi(Roi.rectangle("bright ä", 20, 60, 40, 25), 0.93, False)
    drawn = annotated_picture(7, grey, [tracked], ROW)
    changed = (drawn[:500] != grey[:, :, None]).any(axis=2)
    # Its border, in orange as blue, green, red, and its name above; nothing inside and nothing elsewhere.
    np.testing.assert_allclose(drawn[70, 20], (0, 159, 230), atol=60)
    assert changed[70, 60]
    assert not changed[64:82, 24:56].any()
    assert not changed[90:].any()


def test_nothing_stays_after_an_error(tmp_path: Path) -> None:
    def interrupted() -> None:
        with AnnotatedVideo(tmp_path / "annotated.mp4") as video:
            video(0, GREY, (), ROW)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("step_s", "fps"), [(0.015, 66.67), (1001 / 30000, 29.97), (60, 1.0), (1e-5, 500.0), (0.0, 25.0), (np.nan, 25.0)]
)
def test_plays_as_fast_as_the_video(tmp_path: Path, step_s: float, fps: float) -> None:
    with AnnotatedVideo(tmp_path / "annotated.mp4") as video:
        for number in range(3):
            video(number, GREY, (), ROW | {"time_s": number * step_s})
    reader = cv2.VideoCapture(str(tmp_path / "annotated.mp4"))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(fps, rel=1e-4)
    reader.release()


def test_frames_as_images_in_a_folder_named_after_the_video(tmp_path: Path) -> None:
    write = FrameImages.of_video(tmp_path, Path("/videos/rain.2.mp4"))
    write(12, GREY, (), ROW)
    write(1_000_000, 255 - GREY, (), ROW)
    folder = tmp_path / "rain.2"
    assert sorted(path.name for path in folder.iterdir()) == ["frame-000012.png", "frame-1000000.png"]
    np.testing.assert_array_equal(cv2.imread(str(folder / "frame-000012.png"), cv2.IMREAD_UNCHANGED), GREY)
