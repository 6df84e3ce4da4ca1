"""What a person gave counts before what a file says; what cannot count is named."""

from dataclasses import fields

import numpy as np
import pytest
import tifffile
from PIL import Image

from labcdp.cli.pictures.options import PictureLightOptions
from labcdp.core.dn import pixel_format
from labcdp.core.errors import InputError
from labcdp.files import PictureOptions, read_image, read_picture
from labcdp.session.frames import frame_to_tiff

from .conftest import write_dng

GREY = np.random.default_rng(4).integers(0, 256, (12, 16), dtype=np.uint8)


def codes(source):
    """Codes of the warnings about a picture or a video."""
    return [one.code for one in source.findings if one.severity == "warning"]


def given(options=None, **changes):
    """Options as the commands make them of what was typed."""
    nothing = dict.fromkeys(one.name for one in fields(PictureLightOptions))
    return (options or PictureOptions()).given(**PictureLightOptions(**nothing | changes).stated())


def test_a_typed_exposure_and_gain_count_before_those_of_the_file(tmp_path):
    """Files of all kinds say 8 ms and 6.02 dB."""
    block = Image.Exif()
    # Pillow leaves out a block of which only the directory of EXIF has values.
    block[271] = "Acme"
    block.get_ifd(0x8769).update({0x829A: 0.008, 0x8827: 200})
    for name in ("a.jpg", "a.png"):
        Image.fromarray(GREY).save(tmp_path / name, exif=block)
    tags = [(33434, "2I", 1, (1, 125), True), (34855, "H", 1, 200, True)]
    tifffile.imwrite(tmp_path / "a.tif", GREY, photometric="minisblack", extratags=tags)
    write_dng(tmp_path / "a.dng", np.tile(GREY.astype(np.uint16), (4, 4)), exposure=(1, 125), iso=200)
    (tmp_path / "a.tiff").write_bytes(frame_to_tiff(read_picture(tmp_path / "a.tif").frame, compress=False))
    for path in tmp_path.iterdir():
        # What a calibration knows does not overrule the file.
        known = read_picture(path, PictureOptions(exposure_s=0.005, gain_db=12.0))
        assert (known.frame.exposure_s, codes(known)) == (pytest.approx(0.008), [])
        picture = read_picture(path, given(exposure=0.005, gain_db=12.0))
        assert (picture.frame.exposure_s, picture.frame.gain_db) == (0.005, 12.0)
        assert codes(picture) == ["exposure-replaced", "gain-replaced"]


def test_other_images_are_refused_for_a_session(tmp_path):
    coloured = np.eye(4, dtype=np.uint8)[..., None] * np.uint8([1, 2, 3])
    for pixels in (coloured, np.zeros((4, 4), dtype=np.float32), np.full((4, 4), 4096, dtype=np.uint16)):
        tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb" if pixels.ndim == 3 else "minisblack")
        with pytest.raises(InputError):
            read_image(tmp_path / "a.tif", pixel_format("BayerGB12"), PictureOptions(exposure_s=0.01))
