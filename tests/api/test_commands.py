"""Numbers of the API are those of the command line."""

import json

import numpy as np
import pytest

import labcdp as api
from labcdp.session import example_session

from ..cli.conftest import results_of


@pytest.fixture
def tables(labcdp):
    """Run a command in the test's folder; returns the tables it printed."""
    return lambda *arguments: results_of(labcdp(*arguments, "--json"))["tables"]


def test_regions_of_a_picture(picture, rois, tables):
    contrasts = [1.0, 2.0, 10.0]
    options = [word for contrast in contrasts for word in ("--contrast", f"{100 * contrast:g}%")]
    rows = tables("image", picture, "--roi", rois, *options, "--epsilon", "40%")["cdp"]["rows"]
    assert [row["contrast"] for row in rows] == contrasts
    result = api.read_image(picture).regions(rois).cdp(contrasts, epsilon=0.4)
    assert result.sizes == {"pair": 1, "contrast": 3, "side": 2}
    for row in rows:
        found = result.sel(pair=row["pair"], contrast=row["contrast"])
        for name in ("cdp", "u_cdp", "cdp_low", "cdp_high", "below", "above", "csnr", "u_csnr", "measured_contrast"):
            assert float(found[name]) == row[name]
    (row,) = tables("image", picture, "--neighbours", "-o", "neighbours")["cdp"]["rows"]
    found = api.read_image(picture).cdp_neighbours()
    for name in ("contrast", "cdp", "u_cdp"):
        assert float(found[name]) == row[name], name


def test_regions_of_a_video(video, rois, tables, tmp_path):
    tables("video", video, "--roi", rois, "--contrast", "100%", "--contrast", "200%", "--stop", "4", "-o", "out")
    expected = api.read_dataset(tmp_path / "out" / "results.nc")
    result = api.open_video(video).track(rois, stop=4).cdp([1, 2])
    assert dict(result.sizes) == {"frame": 4, "pair": 1, "contrast": 2, "side": 2, "corner": 4}
    one = result.isel(pair=0)
    for name in ("cdp", "cdp_low", "cdp_high", "below", "above", "measured_contrast", "csnr", "mean", "quality", "lost",
                 "centre_x", "saturated", "corner_x", "time_s", "region", "u_cdp", "u_mean", "u_snr"):  # fmt: skip
        np.testing.assert_array_equal(one[name], expected[name])


def test_sweep(tables, tmp_path):
    arguments = ("--exact", "--over", "scene.luminance_cd_m2=0.1:10000:9:log", "--set", "scene.contrast=0.3")
    arguments += ("--contrast", "20%,50%")
    tables("sweep", "manta-g505", *arguments, "-o", "out")
    expected = api.read_dataset(tmp_path / "out" / "map.nc")
    chain = api.Chain.load("manta-g505").with_(scene__contrast=0.3)
    result = chain.sweep(scene__luminance_cd_m2=np.geomspace(0.1, 1e4, 9), contrast=[0.2, 0.5], exact=True)
    for name in result:
        np.testing.assert_array_equal(result[name], expected[name])
    assert result.attrs["chain"] == expected.attrs["chain"]


def same(one, other):
    """Whether two results agree; sums by BLAS may differ in the last digits with the place of arrays in memory."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    return one == (pytest.approx(other, rel=1e-9, abs=1e-15) if isinstance(one, float) else other)


def test_session_and_its_saved_calibration(tables, tmp_path):
    calibrated = api.Session.open(example_session()).calibrate()
    path = calibrated.save(tmp_path / "calibration.json")
    with pytest.raises(api.InputError, match="exists"):
        calibrated.save(path)
    quantities = tables("calibrate", example_session(), "-o", "out")["calibration"]["rows"]
    found = {row["quantity"]: row["value"] for row in quantities}
    found_range = [found[f"{end} calibrated luminance"] for end in ("lowest", "highest")]
    assert same(found_range, list(calibrated.calibration.range_cd_m2))
    expected = tables("evaluate", example_session(), "--calibration", path)
    result = calibrated.evaluate()
    assert same(json.loads(json.dumps(result.to_dict()["tables"])), expected)
    dataset = result.to_dataset()
    names = {name: name for name in ("cdp", "below", "above", "epsilon", "cdp_low", "cdp_high")}
    names |= {"measured_contrast": "camera_contrast", "meter_contrast": "measured_contrast"}
    for row in expected["contrasts"]["rows"]:
        found = dataset.sel(pair=row["pair"], contrast=row["target_contrast"])
        assert all(same(float(found[name]), row[key]) for name, key in names.items())
    for row in expected["luminance"]["rows"]:
        assert same(float(dataset["camera_luminance"].sel(patch=row["patch"])), row["calibrated_cd_m2"])
    assert api.Session.open(str(example_session())).evaluate(path).to_dataset().equals(dataset)
    # It serves single frames of its camera, too.
    frame = min((example_session() / "frames").iterdir())
    by_object, by_file = (api.read_image(frame, calibration=one) for one in (calibrated.calibration, str(path)))
    assert by_file.unit == "cd/m^2"
    np.testing.assert_array_equal(np.asarray(by_object), np.asarray(by_file))


def test_pictures_videos_and_sessions_are_judged_as_by_the_commands(picture, video, rois, labcdp, tmp_path):
    text = 'contrast = "80%"\nluminance_cd_m2 = [0.1, 1000.0]\ntemperature_c = 60.0\n'
    (tmp_path / "requirement.toml").write_text(text)
    required = api.Requirement.load(tmp_path / "requirement.toml")
    asked, with_file = (required.contrast, required.epsilon), ("--require", "requirement.toml", "--json", "--force")
    found = {
        "image": (api.read_image(picture).regions(rois).cdp(*asked), (picture, "--roi", rois)),
        "video": (api.open_video(video).track(rois).cdp(*asked), (video, "--roi", rois)),
        "evaluate": (
            api.Session.open(example_session()).calibrate().evaluate(*asked).to_dataset(),
            (example_session(), "--recalibrate"),
        ),
    }
    for command, (dataset, arguments) in found.items():
        judgement = dataset.labcdp.judged(tmp_path / "requirement.toml")
        done = labcdp(command, *arguments, *with_file)
        values = results_of(done, {"met": 0, "not met": 3, "undecided": 4}[judgement.verdict])
        rows = values["tables"]["requirement"]["rows"]
        assert [one.verdict for one in judgement.pairs] == [row["verdict"] for row in rows]
        for one, row in zip(judgement.pairs, rows, strict=True):
            assert (one.pair, one.limit) == (row["pair"], row["limit"])
            assert one.margin == pytest.approx(row["margin"])
        assert any(one.worst is not None for one in judgement.pairs)
        codes = {one["code"] for one in values["findings"]}
        assert {one.code for one in judgement.findings} <= codes


def test_chains_are_judged_as_by_compare(labcdp, tmp_path):
    (tmp_path / "r.toml").write_text('contrast = "80%"\nluminance_cd_m2 = [1.0, 2.0]\n')
    sizes = ("scene.width=32", "scene.height=24", "scene.square_px=4")
    options = [word for size in sizes for word in ("--set", size)]
    done = labcdp("compare", "imx250", "manta-g505", "--require", "r.toml", *options, "--json")
    found = api.compare("imx250", "manta-g505", requirement=tmp_path / "r.toml", **{
        name: int(value) for name, value in (size.split("=") for size in sizes)
    })  # fmt: skip
    rows = json.loads(done.stdout)["tables"]["requirement"]["rows"]
    assert [(one.name, one.verdict, one.cdp) for one in found.judged] == [
        (row["name"], row["verdict"], row["cdp"]) for row in rows
    ]


@pytest.mark.parametrize("asked", [(1.0, 0.5), (1.5, 0.4), (None, 0.5)])
def test_a_dataset_of_another_question_is_not_judged(picture, rois, asked):
    dataset = api.read_image(picture).regions(rois).cdp(*asked)
    with pytest.raises(api.InputError, match="evaluate"):
        dataset.labcdp.judged(api.Requirement(contrast=1.5, luminance_cd_m2=(1.0, 2.0)))
