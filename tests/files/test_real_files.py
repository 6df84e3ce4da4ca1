"""Files of real cameras, scanners and programs, which are not in the repository.

They lie in the folder that LABCDP_MATERIAL names, else in ``material`` beside the repository; each is known by its
name and hash. What is not there is skipped by name. They come from public collections: digicam_corpus (T. Thorsted),
hsexif, OpenEXR's and OpenImageIO's test images, exif-orientation-examples, read-roi, OpenCV's samples, imageio.
"""

import hashlib
import os
from pathlib import Path

import av
import numpy as np
import OpenEXR
import pytest
import rawpy
import tifffile
from PIL import Image, ImageOps

from labcdp.files import read_picture
from labcdp.files.video.open import open_video
from labcdp.files.video.selection import Position, Selection
from labcdp.files.video.source import frames_of
from labcdp.regions import load_regions

FOLDER = Path(os.environ.get("LABCDP_MATERIAL", Path(__file__).parents[3] / "material"))
SHA256 = dict(
    reversed(line.split(maxsplit=1))
    for line in Path(__file__).with_name("real_files.sha256").read_text(encoding="utf-8").splitlines()
)


def material(name):
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{name} is not in {FOLDER}")
    assert hashlib.sha256(path.read_bytes()).hexdigest() == SHA256[name]
    return path


def names(folder, *suffixes):
    return [name for name in SHA256 if name.startswith(f"{folder}/") and name.lower().endswith(suffixes)]


#: By their histograms: 42566 pixels of the first are at 1023 DN, the second is well exposed.
CLIPS_DN = {"CRW_0119.CRW": 1023, "CRW_0101.CRW": 1023, "RAW_NIKON_D1.NEF": 3827}


@pytest.mark.parametrize("name", names("raw", ".crw", ".nef", ".kdc"))
def test_the_dn_of_a_raw_are_those_of_libraw(name):
    path = material(name)
    picture = read_picture(path)
    with rawpy.imread(str(path)) as raw:
        np.testing.assert_array_equal(picture.frame.dn, raw.raw_image_visible)
        assert picture.frame.exposure_s == pytest.approx(raw.other.shutter_speed, rel=0.01)
    assert picture.frame.saturation_dn == CLIPS_DN.get(Path(name).name, picture.frame.saturation_dn)


@pytest.mark.parametrize("name", names("pictures", "minisblack-10.tif", "-12.tif", "-14.tif", "-16.tif"))
def test_packed_bits_agree_with_whole_bytes_of_the_same_flower(name):
    same = "flower-rgb-contig-16.tif" if "rgb" in name else "flower-minisblack-08.tif"
    one, other = (read_picture(material(path)).frame for path in (name, f"pictures/{same}"))
    # The program that made them cut off bits.
    step = max(1 / (2 ** int(name[-6:-4]) - 1), 1 / other.saturation_dn) * 1.01
    assert np.abs(one.dn / one.saturation_dn - other.dn / other.saturation_dn).max() <= step


# Carrots.exr has chromaticities of its own.
@pytest.mark.parametrize("name", [name for name in names("pictures", ".exr") if "Carrots" not in name])
def test_luminance_of_openexr(name):
    path = material(name)
    light = read_picture(path).light
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {key: one.pixels.astype(np.float64) for key, one in file.channels().items()}
    # Of XYZ files the green channel is Y.
    weights = {"R": 0.0, "G": 1.0, "B": 0.0} if "XYZ" in name else {"R": 0.2126, "G": 0.7152, "B": 0.0722}
    with np.errstate(invalid="ignore"):
        expected = channels["Y"] if "Y" in channels else sum(weights[c] * channels[c] for c in "RGB")
    np.testing.assert_allclose(light, expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("name", names("pictures", ".jpg"))
def test_photographs_are_turned_upright(name):
    path = material(name)
    picture = read_picture(path)
    with Image.open(path) as image:
        assert picture.shape == ImageOps.exif_transpose(image).size[::-1]
    upright = read_picture(material("pictures/Landscape_1.jpg"))
    assert np.corrcoef(picture.frame.dn[::7, ::7].ravel(), upright.frame.dn[::7, ::7].ravel())[0, 1] > 0.95


def test_pages_of_a_microscope_are_frames():
    path = material("pictures/calcium_imaging.tif")
    frames = frames_of(open_video(path), Selection(stop=Position(frames=20)))
    pages = tifffile.imread(path, key=range(20))
    for frame, page in zip(frames, pages, strict=True):
        np.testing.assert_array_equal(frame.frame.dn, page)


@pytest.mark.parametrize("name", names("video", ".mp4", ".avi"))
def test_real_videos_give_the_frames_that_ffmpeg_decodes(name):
    path = material(name)
    with av.open(str(path)) as container:
        n_decoded = sum(1 for _ in container.decode(video=0))
    found = list(frames_of(open_video(path), Selection(), needed=lambda number, _: number % 50 == 0))
    times = [one.time_s for one in found]
    assert sum(one.fault is None for one in found) == n_decoded
    # One file announces a frame more than it has.
    assert len(found) - n_decoded <= 1
    assert times == sorted(times)
    assert times[0] == 0


def test_combined_regions_of_imagej_have_the_areas_imagej_drew():
    """A rectangle of 61 x 42 pixels less one of 31 x 18; a ring of a brush; two others by their outlines."""
    (shape,) = load_regions(material("rois/composite-rect-in-rect.roi"))
    assert shape.rois()[0].area == 61 * 42 - 31 * 18
    for name in ("brush-donut", "brush-yin-yang", "oval-in-rect", "two-ovals"):
        (shape,) = load_regions(material(f"rois/composite-{name}.roi"))
        (roi,) = shape.rois()
        # Their lines follow the edges of pixels.
        assert int(roi.mask((400, 400)).sum()) == roi.area
