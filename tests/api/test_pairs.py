"""Tables and figures of the results of pictures, videos and sessions."""

import cv2
import numpy as np
import pytest

import labcdp
from labcdp.session import example_session

REGIONS = {"a": (5, 5, 30, 30), "b": (100, 5, 30, 30), "c": (100, 50, 30, 30)}
PAIRS = [("a", "b"), ("a", "c")]


@pytest.fixture(scope="module")
def light():
    scene = np.where(np.arange(160) < 80, 100.0, 50.0) * np.ones((100, 1))
    return np.clip(scene + np.random.default_rng(0).normal(0, 5, scene.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def results(light, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    cv2.imwrite(str(folder / "picture.png"), light)
    writer = cv2.VideoWriter(str(folder / "video.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5, (160, 100))
    for _ in range(3):
        writer.write(cv2.cvtColor(light, cv2.COLOR_GRAY2BGR))
    writer.release()
    regions = labcdp.read_image(folder / "picture.png", encoding="linear").regions(REGIONS, PAIRS)
    tracked = labcdp.open_video(folder / "video.avi").track(REGIONS, method="fixed", pairs=PAIRS)
    session = labcdp.Session.open(example_session())
    return {
        "picture": regions.cdp(),
        "picture, one contrast": regions.cdp("100%"),
        "picture, contrasts": regions.cdp(["50%", "100%"]),
        "video": tracked.cdp([0.5, 1]),
        "session": session.calibrate().evaluate().to_dataset(),
    }


@pytest.mark.parametrize(
    ("of", "rows", "drawn"),
    [
        ("picture", 2, 1),
        ("picture, one contrast", 2, 1),
        ("picture, contrasts", 4, 2),
        ("video", 12, 4),
        ("session", None, None),
    ],
)
def test_results_have_a_row_for_each_pair_and_are_drawn(results, of, rows, drawn):
    dataset = results[of]
    table, figure = dataset.labcdp.to_dataframe(), dataset.labcdp.plot()
    assert len(table) == (dataset["cdp"].size if rows is None else rows)
    assert len(figure.axes[0].containers) == (dataset.sizes["pair"] if drawn is None else drawn)
    np.testing.assert_array_equal(table["cdp"].to_numpy(), dataset["cdp"].values.ravel())
    assert table["region_bright"].isin(dataset["region"].values[:, 0]).all()
    if of == "picture":
        assert table["mean_dark"].tolist() == dataset["mean"].sel(side="dark").values.tolist()


def test_without_pairs_there_is_no_such_table(results):
    chain = labcdp.Chain.load("manta-g505").with_(scene__width=32, scene__height=24, scene__square_px=4)
    with pytest.raises(labcdp.InputError, match="no pairs"):
        chain.sweep(scene__luminance_cd_m2=[1.0, 10.0], exact=True).labcdp.to_dataframe()
