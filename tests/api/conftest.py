import cv2
import pytest

from labcdp.regions import RectangleShape, save_regions

from ..evaluate.video.videos import driving, write

REGIONS = [RectangleShape("sign", 22, 42, 26, 26), RectangleShape("ground", 22, 82, 26, 26)]
SIZE = (160, 120)


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """Folder with a picture, a video, and files of two and of three regions."""
    folder = tmp_path_factory.mktemp("files")
    cv2.imwrite(str(folder / "night.png"), driving(1, 1, 3.0)[0])
    write(folder / "drive.avi", driving(5, 1, 3.0), "MJPG")
    save_regions(folder / "rois.json", REGIONS, SIZE)
    save_regions(folder / "three.json", [*REGIONS, RectangleShape("sky", 100, 5, 30, 20)], SIZE)
    return folder


def one_file(name):
    return pytest.fixture(lambda files: files / name)


picture, video, rois, three = map(one_file, ("night.png", "drive.avi", "rois.json", "three.json"))
