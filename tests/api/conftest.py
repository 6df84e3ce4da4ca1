import cv2
import numpy as np
import pytest

from labcdp.regions import RectangleShape, save_regions

from ..evaluate.video.videos import write

REGIONS = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
SIZE = (160, 120)


def frame(rng, number=0):
    """A noisy image with a bright and a dark square that move to the right."""
    image = 90 + rng.normal(0, 2, SIZE[::-1])
    image[40:70, 20 + number : 50 + number] = 200 + rng.normal(0, 4, (30, 30))
    image[80:110, 20 + number : 50 + number] = 60 + rng.normal(0, 4, (30, 30))
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """Folder with a picture, a video, and files of two and of three regions."""
    folder = tmp_path_factory.mktemp("files")
    cv2.imwrite(str(folder / "night.png"), frame(np.random.default_rng(4)))
    rng = np.random.default_rng(5)
    write(folder / "drive.avi", [frame(rng, number) for number in range(5)], "MJPG")
    save_regions(folder / "rois.json", REGIONS, SIZE)
    save_regions(folder / "three.json", [*REGIONS, RectangleShape("sky", 100, 5, 30, 20)], SIZE)
    return folder


def one_file(name):
    return pytest.fixture(lambda files: files / name)


picture, video, rois, three = map(one_file, ("night.png", "drive.avi", "rois.json", "three.json"))
