"""Patches that were shown one after another give what they give in one image."""

from dataclasses import astuple

import numpy as np
import pytest

from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.session import Session


@pytest.fixture(scope="module")
def one_by_one(recorded, tmp_path_factory):
    """The example again, with frames in which everything but one patch is wrong."""
    configuration = recorded.configuration
    target = configuration.target.model_copy(update={"presentation": "one by one"})
    path = tmp_path_factory.mktemp("one by one") / "session"
    with Session.create(path, configuration.model_copy(update={"target": target})) as session:
        light = [recorded.load(record) for record in recorded.frames("light")]
        for patch in target.patches:
            region = patch.region()
            batch = []
            for frame in light:
                dn = np.full_like(frame.dn, 1234)
                window = region.window(frame.shape)
                dn[window] = np.where(region.mask(frame.shape), frame.dn[window], 1234)
                batch.append((frame.with_pixels(dn), "light", patch.name))
            session.add_frames(batch)
        session.add_frames([(recorded.load(record), "dark", None) for record in recorded.frames("dark")])
        for record in recorded.readings():
            session.add_reading(record.reading, record.patch)
        yield session


@pytest.fixture(scope="module")
def result(one_by_one):
    observed = observe_session(one_by_one)
    return evaluate_session(one_by_one, observed, calibrate_session(observed))


def test_patches_and_probabilities_are_those_of_one_image(result, evaluation):
    rows = [[astuple(row) for row in one.patches] for one in (result, evaluation)]
    assert rows[0] == rows[1]
    assert [row.cdp for row in result.contrasts] == [row.cdp for row in evaluation.contrasts]


def test_each_contrast_names_the_two_frames_it_comes_from(one_by_one, result):
    by_number = {record.number: record for record in one_by_one.frames("light")}
    for row in result.contrasts:
        assert by_number[row.frame_number].patch == row.bright
        assert by_number[row.dark_frame_number].patch == row.dark
        assert {by_number[n].exposure_s for n in (row.frame_number, row.dark_frame_number)} == {row.exposure_s}


def test_the_picture_shows_each_patch_from_its_own_frames(result, evaluation):
    shape = evaluation.map.luminance_cd_m2.shape
    for patch in result.observed.configuration.target.patches:
        region = patch.region()
        window = region.window(shape)
        inside = region.mask(shape)
        np.testing.assert_array_equal(
            result.map.luminance_cd_m2[window][inside], evaluation.map.luminance_cd_m2[window][inside]
        )


def test_a_patch_left_out_needs_no_frames(one_by_one):
    left_out = "P01"
    observed = observe_session(one_by_one, [left_out])
    assert left_out not in observed.patches
    assert len(observed.patches) == 15
