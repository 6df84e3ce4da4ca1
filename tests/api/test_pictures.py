import json

import numpy as np
import pytest
import xarray as xr

import labcdp

CONTRASTS = [1.0, 2.0, 10.0]


def test_numbers_are_those_of_the_command_line(picture, rois, command):
    options = [word for contrast in CONTRASTS for word in ("--contrast", f"{100 * contrast:g}%")]
    printed = command("image", picture, "--roi", rois, *options, "--epsilon", "40%", "--json")
    rows = json.loads(printed)["tables"]["cdp"]["rows"]
    assert [row["contrast"] for row in rows] == CONTRASTS
    result = labcdp.read_image(picture).regions(rois).cdp(CONTRASTS, epsilon=0.4)
    assert result.sizes == {"pair": 1, "contrast": 3, "side": 2}
    for row in rows:
        found = result.sel(pair=row["pair"], contrast=row["contrast"])
        for name in ("cdp", "u_cdp", "cdp_low", "cdp_high", "below", "above", "undefined"):
            assert float(found[name]) == row[name]
        for name in ("measured_contrast", "u_measured_contrast", "csnr", "u_csnr"):
            assert float(found[name]) == row[name]


def test_small_region_is_that_of_every_pair_of_pixels(picture):
    image = labcdp.read_image(picture, encoding="linear")
    result = image.regions({"a": (24, 44, 5, 4), "b": (24, 84, 3, 6)}).cdp([2.0, 3.0])
    values = np.asarray(image)
    found = values[44:48, 24:29].ravel()[:, None].astype(float) / values[84:90, 24:27].ravel().astype(float) - 1
    for contrast in (2.0, 3.0):
        expected = ((found >= 0.5 * contrast) & (found <= 1.5 * contrast)).mean()
        assert float(result["cdp"].sel(contrast=contrast, pair="a / b")) == pytest.approx(expected, abs=1e-12)


def test_regions_may_be_a_file_shapes_regions_or_named_corners(picture, rois):
    image = labcdp.read_image(str(picture))
    named = {"sign": (22, 42, 26, 26), "ground": np.array([(22, 82), (48, 82), (48, 108), (22, 108)])}
    listed = [labcdp.Roi.rectangle(*one) for one in (("sign", 22, 42, 26, 26), ("ground", 22, 82, 26, 26))]
    expected = image.regions(rois).cdp(CONTRASTS)
    for regions in (str(rois), labcdp.regions.load_regions(rois), listed, tuple(listed), iter(listed), named):
        assert image.regions(regions).cdp(np.array(CONTRASTS)).identical(expected)


def test_without_contrasts_each_pair_has_its_measured_one(picture, three):
    regions = labcdp.read_image(picture).regions(three)
    result = regions.cdp()
    assert dict(result.sizes) == {"pair": 3, "side": 2}
    np.testing.assert_array_equal(result["contrast"], result["measured_contrast"])
    for pair in result["pair"].values:
        contrast = float(result["contrast"].sel(pair=pair))
        np.testing.assert_array_equal(regions.cdp(contrast)["cdp"].sel(pair=pair), result["cdp"].sel(pair=pair))
        assert float(result["cdp"].sel(pair=pair)) > 0.5


def test_pairs_may_be_chosen(picture, three):
    image = labcdp.read_image(picture)
    assert image.regions(three, ("sky", "ground")).cdp(1.0)["pair"].values.tolist() == ["sky / ground"]
    result = image.regions(three, [("sky", "ground"), ("sign", "sky")]).cdp(1.0)
    assert result["pair"].values.tolist() == ["sky / ground", "sign / sky"]
    assert result["region"].sel(side="dark").values.tolist() == ["ground", "sky"]


@pytest.mark.parametrize("contrast", [("--contrast", "5%"), ()])
def test_neighbours_are_those_of_the_command_line(picture, command, contrast):
    printed = command("image", picture, "--neighbours", *contrast, "--json")
    (row,) = json.loads(printed)["tables"]["cdp"]["rows"]
    found = labcdp.read_image(picture).cdp_neighbours(0.05 if contrast else None)
    for name in ("contrast", "cdp", "u_cdp"):
        assert float(found[name]) == row[name]


def test_variables_have_units_and_meaning_and_can_be_saved(picture, rois, tmp_path):
    result = labcdp.read_image(picture).regions(rois).cdp(CONTRASTS)
    assert all({"long_name", "units"} <= set(result[name].attrs) for name in result)
    assert result["mean"].attrs["units"] == result.attrs["unit"] == "relative"
    result.labcdp.save(tmp_path / "results.nc")
    xr.testing.assert_equal(labcdp.read_dataset(tmp_path / "results.nc"), result)
    with pytest.raises(labcdp.InputError, match="exists: give another name"):
        result.labcdp.save(tmp_path / "results.nc")


def test_objects_show_themselves(picture, rois):
    image = labcdp.read_image(picture)
    assert repr(image) == "<labcdp.Image night.png: 160 x 120 pixels, relative>"
    assert "2 regions, 1 pairs" in repr(image.regions(rois))
    for one in (image, image.regions(rois)):
        assert one._repr_html_().startswith("<table>")


@pytest.mark.parametrize(
    ("regions", "pairs", "message"),
    [
        (3, None, "regions is 3: give a region file"),
        ([1, 2], None, "regions has 1: give a region file"),
        ({"a": (1, 2, 3)}, None, r"region 'a' is \(1, 2, 3\): give \(x, y, width, height\)"),
        ({"a": "x"}, None, "region 'a' is 'x': give"),
        ({"a": (0, 0, 5, 5), "b": (150, 0, 20, 5)}, None, "region 'b' spans x 150 to 170"),
        ({"a": (0, 0, 5, 5), "b": (9, 0, 5, 5)}, [("a", "c")], "there is no region 'c'"),
        ({"a": (0, 0, 5, 5), "b": (9, 0, 5, 5)}, ["ab"], "pairs has 'ab': give two names of regions"),
        ({"a": (0, 0, 5, 5)}, None, "region 'a' is alone"),
        ([], None, "there is no region"),
    ],
)
def test_wrong_regions_are_refused_before_any_work(picture, regions, pairs, message):
    with pytest.raises(labcdp.InputError, match=message):
        labcdp.read_image(picture).regions(regions, pairs)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("10%",), "contrast is '10%': give a number"),
        (([[1.0]],), r"contrasts have the shape \(1, 1\)"),
        (([],), r"contrasts have the shape \(0,\)"),
        (([1.0, 1.0],), "a contrast is given twice"),
        ((-1,), r"contrast is -1\.0"),
        ((1.0, "50%"), "epsilon is '50%'"),
        ((None, 0), "epsilon is 0"),
    ],
)
def test_wrong_contrasts_are_refused(picture, rois, arguments, message):
    with pytest.raises(labcdp.InputError, match=message):
        labcdp.read_image(picture).regions(rois).cdp(*arguments)
