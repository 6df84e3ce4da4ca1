"""Objects of the API, what they take, and how they show themselves."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import labcdp
from labcdp.session import example_session

CONTRASTS = [1.0, 2.0, 10.0]


@pytest.fixture(scope="module")
def chain():
    return labcdp.Chain.load("manta-g505").with_(scene__width=40, scene__height=30, scene__square_px=5)


def test_regions_may_be_a_file_shapes_regions_or_named_corners_and_pairs_chosen(picture, rois, three):
    image = labcdp.read_image(str(picture))
    named = {"sign": (22, 42, 26, 26), "ground": np.array([(22, 82), (48, 82), (48, 108), (22, 108)])}
    listed = [labcdp.Roi.rectangle(*one) for one in (("sign", 22, 42, 26, 26), ("ground", 22, 82, 26, 26))]
    expected = image.regions(rois).cdp(CONTRASTS)
    for regions in (str(rois), labcdp.regions.load_regions(rois), listed, iter(listed), named):
        assert image.regions(regions).cdp(np.array(CONTRASTS)).identical(expected)
    assert image.regions(three, ("sky", "ground")).cdp(1.0)["pair"].values.tolist() == ["sky / ground"]
    result = image.regions(three, [("sky", "ground"), ("sign", "sky")]).cdp(1.0)
    assert result["region"].sel(side="dark").values.tolist() == ["ground", "sky"]


def test_variables_have_units_and_meaning_and_can_be_saved(picture, video, rois, tmp_path):
    result = labcdp.read_image(picture).regions(rois).cdp(CONTRASTS)
    assert all({"long_name", "units"} <= set(result[name].attrs) for name in result)
    assert result["mean"].attrs["units"] == result.attrs["unit"] == "relative"
    of_video = labcdp.open_video(video).track(rois, "fixed", stop=2).cdp(1.0)
    assert all("long_name" in of_video[name].attrs for name in of_video)
    for name, one in (("picture.nc", result), ("video.nc", of_video)):
        one.labcdp.save(tmp_path / name)
        xr.testing.assert_equal(labcdp.read_dataset(tmp_path / name), one)
        with pytest.raises(labcdp.InputError, match="exists"):
            one.labcdp.save(tmp_path / name)


def test_accessor_finds_usable_range_and_isolines(chain):
    luminances = np.geomspace(0.1, 1e4, 60)
    result = chain.sweep(scene__luminance_cd_m2=luminances, scene__contrast=[0.02, 0.3, 1.0], exact=True)
    usable = result.labcdp.usable_range(0.9)
    assert usable["intervals"].values.tolist() == [0, 1, 1]
    assert np.isnan(usable["low"][0])
    for index in (1, 2):
        inside = luminances[result["cdp"].isel({"scene.contrast": index}).values >= 0.9]
        assert usable["low"][index] <= inside.min()
        assert usable["high"][index] >= inside.max()
    assert {line.level for line in result.labcdp.isolines(levels=[0.5, 0.9])} == {0.5, 0.9}
    assert result.labcdp.plot().axes


def test_objects_show_themselves_as_tables(picture, video, rois, chain):
    calibrated, run = labcdp.Session.open(example_session()).calibrate(), chain.run(seed=3)
    session, opened = calibrated.session, labcdp.open_video(str(video))
    frame, reading = session.load(session.frames()[0]), session.readings()[0].reading
    assert (opened.shape, opened.frame_count, opened.frame_rate) == ((120, 160), 5, 25)
    of_files = labcdp.read_image(picture), opened, opened.track(rois), session, calibrated, calibrated.evaluate()
    for one in (*of_files, run, run["optics"], frame, reading, calibrated.calibration.to_luminance(frame)):
        assert one._repr_html_().startswith("<table>")


SQUARES = {"a": (0, 0, 5, 5), "b": (9, 0, 5, 5)}


@pytest.fixture(scope="module")
def given(files, chain):
    """Objects that are asked for what they refuse."""
    image = labcdp.read_image(files / "night.png")
    return SimpleNamespace(
        regions=image.regions,
        cdp=image.regions(files / "rois.json").cdp,
        track=partial(labcdp.open_video(files / "drive.avi").track, files / "rois.json"),
        sweep=chain.sweep,
        evaluate=labcdp.Session.open(example_session()).calibrate().evaluate,
        neighbours=image.cdp_neighbours,
        map=chain.sweep(scene__contrast=[0.2, 0.3], exact=True).labcdp,
    )


REFUSED = [
    (lambda of: of.regions(3), "regions is 3: give a region file"),
    (lambda of: of.regions({"a": (1, 2, 3)}), r"region 'a' is \(1, 2, 3\): give \(x, y, width, height\)"),
    (lambda of: of.regions(SQUARES | {"b": (150, 0, 20, 5)}), "region 'b' spans x 150 to 170"),
    (lambda of: of.regions(SQUARES, [("a", "c")]), "there is no region 'c'"),
    (lambda of: of.regions({"a": (0, 0, 5, 5)}), "region 'a' is the only one"),
    (lambda of: of.neighbours(1.0, rectangle=(1, 2)), r"rectangle is \(1, 2\): give x0, y0, x1, y1"),
    (lambda of: of.map.usable_range("90"), "level is '90': give a fraction, or a percentage"),
    (lambda of: of.cdp("10"), "contrast is '10': give fractions, or percentages"),
    (lambda of: of.cdp([[1.0]]), r"contrasts have the shape \(1, 1\)"),
    (lambda of: of.track(method="magic"), "unknown tracking method 'magic': give one of"),
    (lambda of: of.track(start=1.5), "start is 1.5: give a number of frames, or a time"),
    (lambda of: of.evaluate(1.0, pairs=[("", "b")]), "there is no patch ''"),
    (lambda of: of.sweep(), "there is nothing to sweep over"),
    (lambda of: of.sweep(scene__contrast=0.3), "scene.contrast is 0.3: give a list"),
    (lambda of: of.sweep(scene__contrst=[0.3]), "did you mean contrast"),
]


@pytest.mark.parametrize(("ask", "message"), REFUSED)
def test_wrong_arguments_are_refused_before_any_work(given, ask, message):
    with pytest.raises(labcdp.LabcdpError, match=message):
        ask(given)
