from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from labcdp.core.result import warning
from labcdp.core.roi import Roi
from labcdp.evaluate.video.annotated import AnnotatedVideo, FrameImages, annotated_picture
from labcdp.tracking import TrackedRoi

ROW = {
    "time_s": 0.4,
    "note": "",
    "cdp": np.array([0.5, 0.25]),
    "measured_contrast": 9.8,
    "reference_contrast": 10.0,
    "reference_cdp": 0.93,
    "reference_cdp_low": 0.9,
    "reference_cdp_high": 0.95,
}


def grey(width: int = 161, height: int = 121) -> NDArray[np.uint8]:
    return np.tile(np.linspace(20, 220, width).astype(np.uint8), (height, 1))


def regions(lost: bool = False) -> tuple[TrackedRoi, TrackedRoi]:
    return (
        TrackedRoi(Roi.rectangle("bright ä", 20, 30, 40, 25), 0.93, False),
        TrackedRoi(
            Roi("dark", ((90, 50), (130, 55), (110, 90))),
            0.8,
            lost,
            (warning("tracking-region-gone", "dark"),) if lost else (),
        ),
    )


def close_to(picture: Any, colour: tuple[int, int, int], within: int = 30) -> Any:
    return (np.abs(picture.astype(int) - colour) <= within).all(axis=2)


def test_regions_are_drawn_where_they_are() -> None:
    picture = annotated_picture(7, grey(700, 500), regions(), ROW)
    # Left edge of the first region at half its height; orange as blue, green, red.
    assert close_to(picture[42:44, 17:23], (0, 159, 230), 60).any()
    assert not close_to(picture[42:44, 30:50], (0, 159, 230), 60).any()
    np.testing.assert_array_equal(picture[200:490, :, 0], grey(700, 500)[200:490])


def test_nothing_stays_after_an_error(tmp_path: Path) -> None:
    def broken() -> None:
        with AnnotatedVideo(tmp_path / "annotated.mp4") as video:
            video(0, grey(), regions(), ROW)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("step_s", "fps"), [(0.015, 66.67), (1001 / 30000, 29.97), (60, 1.0), (1e-5, 500.0), (0.0, 25.0), (np.nan, 25.0)]
)
def test_plays_as_fast_as_the_video(tmp_path: Path, step_s: float, fps: float) -> None:
    with AnnotatedVideo(tmp_path / "annotated.mp4") as video:
        for number in range(3):
            video(number, grey(), (), ROW | {"time_s": number * step_s})
    reader = cv2.VideoCapture(str(tmp_path / "annotated.mp4"))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(fps, rel=1e-4)
    reader.release()


def test_frames_as_images_in_a_folder_named_after_the_video(tmp_path: Path) -> None:
    write = FrameImages.of_video(tmp_path, Path("/videos/rain.2.mp4"))
    write(12, grey(), regions(), ROW)
    write(1_000_000, 255 - grey(), (), ROW)
    folder = tmp_path / "rain.2"
    assert sorted(path.name for path in folder.iterdir()) == ["frame-000012.png", "frame-1000000.png"]
    np.testing.assert_array_equal(cv2.imread(str(folder / "frame-000012.png"), cv2.IMREAD_UNCHANGED), grey())
