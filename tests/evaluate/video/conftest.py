import cv2
import pytest

from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings

from .videos import MOVING, STILL, driving


@pytest.fixture(scope="session")
def images(tmp_path_factory):
    """Images, one of them broken, of a region that leaves them, and of one that stays."""
    folder = tmp_path_factory.mktemp("images") / "rain & <fog>"
    folder.mkdir()
    for number, image in enumerate(driving(24, 8, 8.0)):
        cv2.imwrite(str(folder / f"{number:02d}.png"), image)
    (folder / "05.png").write_bytes((folder / "05.png").read_bytes()[:900])
    return folder


@pytest.fixture(scope="session")
def followed(images):
    """Results of two regions of the images."""
    return evaluate_video(images, VideoSettings((0.07, 1.0, 10.0), (STILL, MOVING), epsilon=0.9, reference="first"))


@pytest.fixture(scope="session")
def near(images):
    """Results of their nearest neighbours."""
    return evaluate_video(images, VideoSettings((0.1, 0.5)))
