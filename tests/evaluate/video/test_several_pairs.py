"""Several pairs of regions, and neighbours, in one pass through a video."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import labcdp
from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.evaluate.video.evaluate import Part, evaluate_video, evaluated_parts
from labcdp.evaluate.video.settings import VideoSettings

from .videos import BRIGHT, fixed, scenes, write


def test_pairs_and_neighbours_in_one_pass_are_as_each_alone_also_when_resumed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", scenes())
    ground = Roi.rectangle("ground", 90, 50, 20, 20)
    asked = [fixed(), fixed(rois=(ground, BRIGHT), contrasts=None), VideoSettings((0.5, 1.0))]
    alone = [evaluate_video(path, one) for one in asked]
    parts = [Part(one, tmp_path / str(number)) for number, one in enumerate(asked)]
    for told_in_all in (8, 0):
        told: list[int] = []
        with evaluated_parts(path, parts, progress=lambda done, _total, told=told: told.append(done)) as rows:
            for one, result in zip(rows, alone, strict=True):
                xr.testing.assert_identical(one().dataset(), result)
        # The video is gone through once, and what is known is not done again.
        assert len(told) == told_in_all


def test_a_region_that_cannot_be_followed_costs_only_its_own_pairs(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    frames = []
    for number in range(4):
        image = np.full((240, 640), 60.0)
        image[20:60, 20 + number : 60 + number] = rng.normal(150, 4, (40, 40))
        image[30:50, 70 + number : 90 + number] = rng.normal(90, 4, (20, 20))
        frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    bright, middle = Roi.rectangle("bright", 30, 30, 20, 20), Roi.rectangle("middle", 73, 33, 14, 14)
    plain, across = Roi.rectangle("plain", 500, 100, 20, 20), Roi.rectangle("across", 45, 30, 20, 20)
    path = write(tmp_path / "a.mkv", frames)
    pairs = [(bright, plain), (bright, middle), (across, bright)]
    parts = [Part(VideoSettings((1.0,), pair), tmp_path / str(n)) for n, pair in enumerate(pairs)]
    for _ in range(2):
        with evaluated_parts(path, parts) as (none, good, apart):
            assert np.isfinite(good().dataset()["cdp"]).all()
            with pytest.raises(InputError, match="region 'plain' cannot be followed"):
                none()
            with pytest.raises(InputError, match="'across' and 'bright' have 100 pixels in common"):
                apart()
    regions = labcdp.open_video(path).track([bright, middle, plain], pairs=[("bright", "plain"), ("bright", "middle")])
    result = regions.cdp([1.0])
    assert result["pair"].values.tolist() == ["bright / middle"]
    assert "no result of bright / plain: region 'plain' cannot be followed" in result.attrs["warnings"]
