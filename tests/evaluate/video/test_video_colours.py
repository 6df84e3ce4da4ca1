"""Colours of regions in videos: those of the same pixels as a picture, frame by frame."""

import cv2
import numpy as np
import pytest
from openpyxl import load_workbook

import labcdp as package
from labcdp.regions import RectangleShape, save_regions

from ...files.video_files import write

REGIONS = [RectangleShape("sign", 8, 10, 40, 60), RectangleShape("wall", 72, 10, 40, 60)]


def pictures(n=3):
    """A sign that pales from frame to frame, 8 bits of red, green and blue."""
    rng, made = np.random.default_rng(6), []
    for number in range(n):
        image = np.full((80, 128, 3), (110, 115, 112), dtype=float)
        image[:, :60] = 160 - 10 * number, 90 + 5 * number, 80
        made.append((image + rng.normal(0, 4, image.shape)).round().astype(np.uint8))
    return made


@pytest.mark.parametrize("kind", ["rgb24", "yuv444p"])
def test_a_picture_is_a_video_of_one_frame(tmp_path, kind):
    frames = pictures()
    if kind == "rgb24":
        planes = frames
    else:
        # BT.601 of full range, as JPEG has it; rounding adds noise of half a DN.
        planes = [
            tuple(np.moveaxis(cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb)[..., [0, 2, 1]], -1, 0)) for image in frames
        ]
    full = {"options": {"qp": "0"}} if kind == "rgb24" else {"color_range": 2, "colorspace": 5}
    path = write(tmp_path / "a.mkv", "libx264rgb" if kind == "rgb24" else "ffv1", kind, planes, **full)
    save_regions(tmp_path / "regions.json", REGIONS, (128, 80))
    video = package.open_video(path, encoding="srgb", no_vignetting=True)
    measured = video.track(tmp_path / "regions.json", method="fixed").cdp(0.2, colours=True).isel(pair=0)
    for number, image in enumerate(frames):
        assert cv2.imwrite(str(tmp_path / "a.png"), image[..., ::-1])
        picture = package.read_image(tmp_path / "a.png", encoding="srgb", no_vignetting=True)
        alone = picture.regions(tmp_path / "regions.json").colour_separation().isel(pair=0)
        for name in ("colour_distance", "csp", "colours_detected", "colour_distance_low"):
            tolerance = 1e-3 if kind == "rgb24" else 0.02
            assert float(measured[name][number]) == pytest.approx(float(alone[name]), rel=tolerance), name
    assert (np.diff(measured["colour_distance"]) < 0).all()


def test_command_writes_colours_and_says_where_there_are_none(tmp_path, labcdp):
    frames = pictures()
    write(tmp_path / "a.mkv", "libx264rgb", "rgb24", frames, {"qp": "0"})
    write(tmp_path / "grey.mkv", "ffv1", "gray", [image[..., 1] for image in frames])
    save_regions(tmp_path / "regions.json", REGIONS, (128, 80))
    common = ("--roi", "regions.json", "--method", "fixed", "--colours", "--contrast", "20%")
    done = labcdp("video", "a.mkv", *common)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "a-video" / "report.html").read_text()
    assert "Colour separation over the frames" in page
    sheets = load_workbook(tmp_path / "a-video" / "results.xlsx")
    assert "CSP" in [cell.value for cell in next(sheets["Frames"].iter_rows())]
    done = labcdp("video", "grey.mkv", *common)
    assert done.returncode == 1
    assert "the video is grey" in done.stderr
