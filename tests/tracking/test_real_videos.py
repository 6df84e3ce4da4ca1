"""Regions in real videos are found where eyes found them, or said to be lost."""

from pathlib import Path

import cv2
import pytest

from labcdp.core.roi import Roi
from labcdp.tracking import make_tracker

from .real import VIDEOS, Score, digest, file_of, frames_of

#: Least share of the checked places that are found.
FOUND = {"box.mp4": 0.95, "cup.mp4": 0.7, "carphone_pristine.mp4": 0.9, "car-detection.mp4": 0.9}
#: Most places that are wrong; none in the others.
WRONG = {
    "bgslibrary-video02.avi": 3,
    "lane_detecting-rainy.mp4": 2,
    "An-emergency-v-traffic_light.mp4": 1,
    "lane_detecting-desert.mp4": 4,
    "vehicle_detect-traffic.mp4": 8,
}


def test_each_video_has_its_half_and_places_in_it():
    for name, video in VIDEOS.items():
        assert video["half"] in ("develop", "judge"), name
        for region, known in video["regions"].items():
            numbers = [int(number) for number in known["places"]]
            assert numbers == sorted(numbers), (name, region)
            assert numbers[0] >= video["start"], (name, region)
            assert len(known["box"]) == 4, (name, region)
            assert all(place is None or len(place) == 2 for place in known["places"].values()), (name, region)


def test_both_halves_have_videos_of_their_own():
    halves = {half: {v["sha256"] for v in VIDEOS.values() if v["half"] == half} for half in ("develop", "judge")}
    assert min(map(len, halves.values())) >= 10
    assert not halves["develop"] & halves["judge"]


def test_the_digest_of_a_folder_is_that_of_its_files_one_after_another(tmp_path: Path):
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "2.png").write_bytes(b"second")
    (folder / "1.png").write_bytes(b"first")
    (tmp_path / "both").write_bytes(b"firstsecond")
    assert digest(folder) == digest(tmp_path / "both")


def test_scores_count_places_and_returns_after_a_cover():
    box, score = [0, 0, 10, 10], Score()
    for position_px, place in [
        ((5, 5), [5, 5]),
        (None, None),
        ((5, 5), None),  # said to be in view under the cover
        (None, [5, 5]),  # back in view, not yet found
        ((6, 5), [5, 5]),  # found again in the second frame
        (None, None),
        *[((9, 9), [5, 5])] * 3,  # back, at a wrong place
        ((5, 5), [5, 5]),  # too late
    ]:
        score.add(position_px, place, box)
    assert (score.checked, score.right, score.wrong, score.lost, score.unseen) == (10, 3, 4, 1, 3)
    assert (score.returns, score.found_again) == (2, 1)


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

    right, wrong, lost = (sum(getattr(score, key) for score in scores.values()) for key in ("right", "wrong", "lost"))
    assert wrong <= WRONG.get(name, 0), scores
    assert right >= FOUND.get(name, 0.0) * (right + lost)
