"""Regions in real videos are found where eyes found them, or said to be lost."""

import cv2
import pytest

from labcdp.core.roi import Roi
from labcdp.tracking import make_tracker

from .real import VIDEOS, Score, file_of, frames_of

#: Least share of the checked places that are found.
FOUND = {"box.mp4": 0.95, "cup.mp4": 0.7, "carphone_pristine.mp4": 0.9, "car-detection.mp4": 0.9}


@pytest.mark.long
@pytest.mark.parametrize("name", VIDEOS)
def test_places_are_right_or_lost(name):
    if (path := file_of(name)) is None:
        pytest.skip(f"{name} is not here: put it into the folder LABCDP_VIDEOS")
    regions = VIDEOS[name]["regions"]
    scores = {region: Score() for region in regions}
    trackers = {}
    for number, image in frames_of(name, path):
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        for region, known in regions.items():
            if region not in trackers:
                trackers[region] = make_tracker("follow", grey, [Roi.rectangle(region, *known["box"])])
                continue
            (found,) = trackers[region].update(grey)
            if str(number) in known["places"]:
                scores[region].add(None if found.lost else found.roi.centre, known["places"][str(number)], known["box"])

    assert {region: score.wrong for region, score in scores.items()} == dict.fromkeys(regions, 0)
    right, seen = (sum(getattr(score, key) for score in scores.values()) for key in ("right", "lost"))
    assert right / (right + seen) >= FOUND.get(name, 0.0)
