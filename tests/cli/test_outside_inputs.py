"""Files as other programs write them, in `outside`: each has a contrast that is known without labcdp."""

import io
import shutil
from contextlib import redirect_stdout, suppress
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import tifffile

from labcdp.cli.app import app
from labcdp.core.errors import InputError
from labcdp.files import read_picture
from labcdp.regions import load_regions

from ..conftest import valid

OUTSIDE = Path(__file__).with_name("outside")


def srgb(code):
    """IEC 61966-2-1."""
    return code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4


#: Grey 200 and 60 of 8 bits, as sRGB and as linear values.
CODED, LINEAR = srgb(200 / 255) / srgb(60 / 255) - 1, 200 / 60 - 1


def evaluated(command, path, regions, *options):
    arguments = [command, path, "--roi", OUTSIDE / regions, *options, "--json", "--output"]
    with TemporaryDirectory() as folder, redirect_stdout(io.StringIO()) as printed:
        arguments.append(Path(folder) / "out")
        app([*map(str, arguments)], standalone_mode=False)
    return valid(printed.getvalue())


def codes(results):
    return {finding["code"] for finding in results["findings"]}


@pytest.mark.parametrize(
    ("name", "regions", "contrast", "tolerance_rel"),
    [
        # 40000 and 10000; cICP says linear (ITU-T H.273: 8), or sRGB (13).
        ("png-cicp-linear.png", "60x40", 3, 1e-3),
        ("png-cicp-srgb-grey.png", "60x40", srgb(40000 / 65535) / srgb(10000 / 65535) - 1, 1e-3),
        # gAMA 45455 of 40 and 10.
        ("png-gama-only.png", "60x40", 4**2.2 - 1, 1e-3),
        ("tiff-linear-icc.tif", "60x40", 3, 1e-3),
        # Steps of the 8 bits after the codec: a level of 1 in 25 is 4 %.
        ("jpeg-linear-icc.jpg", "60x40", 3.09, 5e-3),
        # ImageJ: 300 and 100.
        ("imagej-signed16.tif", "60x40", 2, 1e-3),
        ("imagej-calibrated.tif", "60x40", 2, 1e-3),
        # 2000 and 500 above the black level of each pixel.
        ("dng-black-4x4.dng", "160x120", 3, 1e-3),
        ("dng-black-delta-rows.dng", "160x120-top", 3, 1e-3),
        ("dng-float-black.dng", "160x120", 3, 1e-3),
        ("motion-photo.jpg", "60x40", CODED, 2e-3),
        ("palette-1-bit.tif", "60x40", CODED, 2e-3),
    ],
)
def test_pictures_have_the_contrast_that_they_state(name, regions, contrast, tolerance_rel):
    results = evaluated("image", OUTSIDE / name, f"regions-{regions}.json")
    (row,) = results["tables"]["cdp"]["rows"]
    assert row["measured_contrast"] == pytest.approx(contrast, rel=tolerance_rel)


def first_contrast(results):
    (found,) = (finding for finding in results["findings"] if finding["code"] == "contrast-measured")
    assert found["values"]["frame"] == 0
    return found["values"]["contrast"]


def test_a_grey_palette_without_loss_is_linear():
    results = evaluated("video", OUTSIDE / "grey-palette.avi", "regions-64x48.json", "--method", "fixed")
    assert first_contrast(results) == pytest.approx(LINEAR, rel=2e-3)


def test_frames_before_the_cut_are_not_shown():
    results = evaluated("video", OUTSIDE / "trimmed-edit-list.mp4", "regions-128x96.json", "--method", "fixed")
    # The codec leaves 201 and 61, or 200 and 60, of the greys.
    assert 0.95 * CODED < first_contrast(results) < 1.05 * CODED
    assert not {code for code in codes(results) if "broken" in code or "lost" in code}


@pytest.mark.parametrize("options", [(), ("--bit-depth", 12)])
def test_the_same_values_have_the_same_bits_in_each_container(options):
    matroska, tiff = (
        evaluated("video", OUTSIDE / name, "regions-64x48.json", "--method", "fixed", "--contrast", "50%", *options)
        for name in ("gray16-12bit-clipped.mkv", "gray16-12bit-clipped.tif")
    )
    of_values = [
        {code for code in codes(results) if "bit-depth" in code or "saturated" in code} for results in (matroska, tiff)
    ]
    assert of_values[0] == of_values[1]
    assert "frames-region-saturated" in of_values[0]


def test_what_is_not_read_is_not_called_damaged():
    with pytest.raises(InputError, match="JPEG of 12 bits, which labcdp does not read: convert it to 16-bit TIFF"):
        read_picture(OUTSIDE / "jpeg-12-bit.jpg")
    with pytest.raises(InputError, match="polygon") as error:
        load_regions(OUTSIDE / "curved-composite.roi")
    assert "damaged" not in str(error.value)


def test_a_colon_in_a_name_changes_nothing(tmp_path):
    path = tmp_path / "2026-11-28T10:15:00.mp4"
    shutil.copy(OUTSIDE / "trimmed-edit-list.mp4", path)
    given = [
        first_contrast(evaluated("video", one, "regions-128x96.json", "--method", "fixed"))
        for one in (path, OUTSIDE / "trimmed-edit-list.mp4")
    ]
    assert given[0] == given[1]


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.long)])
def test_any_changed_byte_of_the_tags_of_a_raw_file_ends_in_one_line(tmp_path, step):
    """No other error than labcdp's own, such as one of NumPy or of the memory."""
    path = tmp_path / "a.dng"
    for name in ("dng-float-black.dng", "dng-black-4x4.dng"):
        content = (OUTSIDE / name).read_bytes()
        with tifffile.TiffFile(OUTSIDE / name) as tiff:
            tags = [tag.offset for tag in tiff.pages.first.tags]
        for at in tags:
            for changed, value in product(range(at + at // 12 % step, at + 12, step), (0, 255)):
                path.write_bytes(content[:changed] + bytes([value]) + content[changed + 1 :])
                with suppress(InputError):
                    read_picture(path)
