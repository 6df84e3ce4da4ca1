import numpy as np
import pytest

import labcdp

LUMINANCES = np.geomspace(0.1, 1e4, 9)


@pytest.fixture(scope="module")
def chain():
    return labcdp.Chain.load("manta-g505").with_(scene__width=40, scene__height=30, scene__square_px=5)


def test_sweep_is_that_of_the_command_line(command, tmp_path):
    arguments = ("--exact", "--over", "scene.luminance_cd_m2=0.1:10000:9:log", "--set", "scene.contrast=0.3")
    command("sweep", "manta-g505", *arguments, "-o", "out", "--json")
    expected = labcdp.read_dataset(tmp_path / "out" / "map.nc")
    result = (
        labcdp.Chain.load("manta-g505").with_(scene__contrast=0.3).sweep(scene__luminance_cd_m2=LUMINANCES, exact=True)
    )
    for name in result:
        np.testing.assert_array_equal(result[name], expected[name])
    assert result.attrs["chain"] == expected.attrs["chain"]


def test_simulated_sweep_takes_lists_and_is_repeatable(chain):
    first = chain.sweep(scene__contrast=[0.2, 0.5], exposure__gain_db=(0, 6), seed=3)
    assert dict(first.sizes) == {"scene.contrast": 2, "exposure.gain_db": 2}
    assert first.equals(chain.sweep(**{"scene.contrast": [0.2, 0.5], "exposure.gain_db": (0, 6)}, seed=3))
    assert not first.equals(chain.sweep(scene__contrast=[0.2, 0.5], exposure__gain_db=(0, 6), seed=4))


def test_accessor_finds_usable_range_and_isolines(chain):
    result = chain.sweep(
        scene__luminance_cd_m2=np.geomspace(0.1, 1e4, 60), scene__contrast=[0.02, 0.3, 1.0], exact=True
    )
    usable = result.labcdp.usable_range(0.9)
    assert usable["intervals"].values.tolist() == [0, 1, 1]
    assert np.isnan(usable["low"][0])
    for index in (1, 2):
        inside = (
            result["cdp"].isel({"scene.contrast": index}).where(result["cdp"].isel({"scene.contrast": index}) >= 0.9)
        )
        luminances = result["scene.luminance_cd_m2"].values[np.isfinite(inside.values)]
        assert usable["low"][index] <= luminances.min()
        assert usable["high"][index] >= luminances.max()
    assert usable["low"].attrs["units"] == "cd/m^2"
    assert {line.level for line in result.labcdp.isolines(levels=[0.5, 0.9])} == {0.5, 0.9}
    figure = result.labcdp.plot()
    assert figure.axes


def test_usable_range_of_one_axis_is_a_number(chain):
    usable = chain.sweep(scene__luminance_cd_m2=np.geomspace(0.1, 1e4, 60), exact=True).labcdp.usable_range()
    assert usable["low"].shape == ()
    assert float(usable["low"]) < float(usable["high"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "there is nothing to sweep over"),
        ({"scene__contrast": 0.3}, "scene.contrast is 0.3: give a list"),
        ({"scene__contrast": [0.3, None]}, "give a list of numbers or texts"),
        ({"scene__contrast": [0.3, "a"]}, "scene.contrast mixes numbers and text"),
        ({"scene__contrst": [0.3]}, "did you mean contrast"),
        ({"scene__contrast": [0.3], "epsilon": "50%"}, "epsilon is '50%'"),
        ({"scene__contrast": [0.3], "contrast": "50%"}, "contrast is '50%'"),
        ({"scene__contrast": [0.3], "folder": 3}, "folder is 3"),
        ({"scene__contrast": [0.3], "stage": "lens"}, "stage is 'lens'"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(chain, options, message):
    with pytest.raises(labcdp.InputError, match=message):
        chain.sweep(**options)


def test_chain_shows_itself(chain):
    assert repr(chain) == "<labcdp.Chain 'manta-g505': 40 x 30 pixels, scene > optics > sensor>"
    assert "[sensor]" in chain._repr_html_()
    run = chain.run(seed=3)
    assert repr(run) == "<ChainRun of 'manta-g505', seed 3: scene > optics > sensor>"
    assert repr(run["optics"]) == "<Signal illuminance in lx, shape (30, 40)>"
