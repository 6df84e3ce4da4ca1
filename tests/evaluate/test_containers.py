"""One scene through all kinds of files: contrasts are within U of the truth, or a warning says that they may not be.

At the middle of the picture, in a corner, and from one to the other. With what the file does not state given, they are
right without a warning.
"""

from itertools import product

import numpy as np
import pytest
import tifffile
from PIL import Image

from labcdp.core.disk import parse_json
from labcdp.core.roi import Roi
from labcdp.core.table import Z_95
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.evaluate.picture.converter import make_converter
from labcdp.evaluate.picture.result import evaluate_picture
from labcdp.evaluate.picture.settings import ImageSettings
from labcdp.evaluate.video.dataset import restored
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.session import Session, SessionConfiguration

from ..files.conftest import write_dng
from ..files.video_files import write
from ..session.conftest import BENCH

#: A lens of 6 mm and 77 degrees from corner to corner.
FOCAL_M, PITCH_M, SHAPE = 6e-3, 12e-6, (480, 640)
#: Places x, y and luminances of patches of 60 pixels, 1 at the end of the scale.
PATCHES = {
    "middle bright": (290, 210, 0.55), "middle dark": (220, 210, 0.4),
    "corner bright": (560, 20, 0.55), "corner dark": (480, 20, 0.4),
}  # fmt: skip
ROIS = {name: Roi.rectangle(name, x + 6, y + 6, 48, 48) for name, (x, y, _) in PATCHES.items()}
#: In the middle, in the corner, and from one to the other.
PAIRS = (
    ("middle bright", "middle dark"), ("corner bright", "corner dark"), ("middle bright", "corner dark"),
)  # fmt: skip
TRUTH = 0.55 / 0.4 - 1
LENS = {"focal_length_m": FOCAL_M, "pixel_pitch_m": PITCH_M}
#: Warnings that a contrast may be another.
DOUBTS = ("encoding-assumed", "black-level-doubtful", "mosaic-doubtful")


@pytest.fixture(scope="module")
def light():
    """Light on the sensor: patches on a dark ground with darker lines, through the lens, with noise."""
    luminance = np.full(SHAPE, 0.25)
    luminance[::40] = luminance[:, ::40] = 0.002
    for x, y, value in PATCHES.values():
        luminance[y : y + 60, x : x + 60] = value
    v = Cos4Vignetting(FOCAL_M, PITCH_M).relative_illuminance(SHAPE)
    return luminance * v * (1 + 0.01 * np.random.default_rng(5).normal(size=SHAPE))


def srgb(values):
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)


def dn(values, top=255):
    return np.rint(top * np.clip(values, 0, 1)).astype(np.uint8 if top == 255 else np.uint16)


def in_colours(values, curve=srgb):
    """Light that is a little red."""
    return np.dstack([dn(curve(np.clip(part * values, 0, 1))) for part in (1.1, 1.0, 0.8)])


def behind_filter(values, parts=(0.55, 1.0, 1.0, 0.4)):
    found = values.copy()
    for at, part in enumerate(parts):
        found[at // 2 :: 2, at % 2 :: 2] *= part
    return found


def png(path, values):
    Image.fromarray(values).save(path)
    return path


def jpeg(path, values):
    Image.fromarray(values).save(path, quality=98, subsampling=0)
    return path


def tiff(path, values):
    tifffile.imwrite(path, values)
    return path


def linear(values):
    return values


#: Pictures by name: how they are written, and what their files do not state.
PICTURES = {
    "grey.png": (lambda path, light: png(path, dn(light)), {"encoding": "linear"}),
    "grey srgb.png": (lambda path, light: png(path, dn(srgb(light))), {"encoding": "srgb"}),
    "grey in rgb.png": (lambda path, light: png(path, np.dstack(3 * [dn(srgb(light))])), {"encoding": "srgb"}),
    "linear grey in rgb.png": (lambda path, light: png(path, np.dstack(3 * [dn(light)])), {"encoding": "linear"}),
    "colour.png": (lambda path, light: png(path, in_colours(light)), {"encoding": "srgb"}),
    "linear colour.png": (lambda path, light: png(path, in_colours(light, linear)), {"encoding": "linear"}),
    "grey.tif": (lambda path, light: tiff(path, dn(srgb(light))), {"encoding": "srgb"}),
    "colour.tif": (lambda path, light: tiff(path, in_colours(light)), {"encoding": "srgb"}),
    "grey.jpg": (lambda path, light: jpeg(path, dn(srgb(light))), {}),
    "colour.jpg": (lambda path, light: jpeg(path, in_colours(light)), {}),
    "12 bits.tif": (
        lambda path, light: tiff(path, 64 + dn(light / 4, 4031)), {"black_level_dn": 64.0, "bit_depth": 12}
    ),
    "bayer.png": (lambda path, light: png(path, dn(behind_filter(light))), {"bayer": "RGGB"}),
    "bayer.tif": (
        lambda path, light: tiff(path, 64 + dn(behind_filter(light / 4), 4031)),
        {"bayer": "RGGB", "black_level_dn": 64.0, "bit_depth": 12},
    ),
    "a.dng": (lambda path, light: write_dng(path, 64 + dn(behind_filter(light), 4031)), {}),
}  # fmt: skip


def grey_video(path, light):
    return write(path, "ffv1", "gray", [dn(light)] * 2)


def rgb_video(path, light):
    return write(path, "ffv1", "bgr0", [np.dstack([*3 * [dn(light)], dn(0 * light)])] * 2)


def srgb_video(path, light):
    return write(path, "ffv1", "gray", [dn(srgb(light))] * 2)


def lossy_video(path, light):
    luma = np.rint(16 + 219 * srgb(light)).astype(np.uint8)
    return write(path, "libx264", "yuv420p", [luma] * 2, {"crf": "4"})


def bayer_video(path, light):
    return write(path, "ffv1", "gray", [dn(behind_filter(light))] * 2)


VIDEOS = {
    "grey.mkv": (grey_video, {"encoding": "linear"}),
    "rgb.mkv": (rgb_video, {"encoding": "linear"}),
    "srgb.mkv": (srgb_video, {"encoding": "srgb"}),
    "lossy.mp4": (lossy_video, {}),
    "bayer.mkv": (bayer_video, {"bayer": "RGGB"}),
}


def by_picture(path, pair, encoding=None, **stated):
    """Contrast of a pair, its U, and codes of the warnings."""
    converter = make_converter(encoding=encoding, **stated)
    settings = ImageSettings(rois=tuple(ROIS[name] for name in pair), pairs=(pair,), converter=converter)
    evaluation, _, _ = evaluate_picture(settings, path, pages=False, surface=False)
    (found,) = evaluation.pairs
    sign = found.bright_region.roi.name == pair[0]
    return found.contrast.value, found.contrast.u, sign, evaluation.findings


def by_video(path, pair, **stated):
    settings = VideoSettings(None, tuple(ROIS[name] for name in pair), "fixed", **stated)
    found = evaluate_video(path, settings).isel(frame=0)
    sign = str(found.region.values[0]) == pair[0]
    findings = restored(parse_json(found.attrs["findings"]))
    return float(found.measured_contrast), float(found.u_measured_contrast), sign, findings


def off(contrast, u, brighter_as_expected):
    """How far a contrast is from the truth, over its U."""
    truth = TRUTH if brighter_as_expected else 1 / (1 + TRUTH) - 1
    return abs(contrast - truth), Z_95 * u


@pytest.mark.parametrize(("name", "pair"), [*product([*PICTURES, *VIDEOS], PAIRS)])
def test_the_contrast_is_within_its_uncertainty_or_a_warning_says_so(tmp_path, light, name, pair):
    make, missing = (PICTURES | VIDEOS)[name]
    path, evaluate = make(tmp_path / name, light), by_video if name in VIDEOS else by_picture
    *found, findings = evaluate(path, pair)
    deviation, expanded = off(*found)
    doubted = any(one.code.startswith(DOUBTS) and one.severity == "warning" for one in findings)
    assert deviation <= expanded or doubted
    # The file itself says that it lacks something, whatever the contrast.
    assert doubted == bool(missing)
    *found, findings = evaluate(path, pair, **missing, **LENS)
    deviation, expanded = off(*found)
    assert deviation <= expanded
    assert deviation < 0.02
    assert expanded < 0.15
    assert not any(one.code.startswith(DOUBTS) for one in findings)


@pytest.mark.parametrize("pair", PAIRS)
def test_a_session_has_the_lens_of_its_plan(tmp_path, light, new_frame, pair):
    plan = BENCH.replace("3.45e-6", f"{PITCH_M}")
    with Session.create(tmp_path / "session", SessionConfiguration.from_toml(plan, "bench.toml")) as session:
        session.add_frame(new_frame(dn(light, 4095), 1, exposure_s=0.005, black_level_register=None, readout=None))
    (frame,) = Session.open(tmp_path / "session").frames()
    path = tmp_path / "session" / frame.file.name
    for found in (by_video(tmp_path / "session", pair), by_picture(path, pair)):
        deviation, expanded = off(*found[:3])
        assert deviation <= expanded < 0.15
        assert deviation < 0.02
    # A copy elsewhere has no plan; what is given counts before that.
    (tmp_path / "frame.tif").write_bytes(path.read_bytes())
    assert off(*by_picture(tmp_path / "frame.tif", pair)[:3])[1] > 1.5 * expanded
    other = by_picture(path, pair, focal_length_m=1.0)
    assert off(*other[:3])[0] > 0.03
