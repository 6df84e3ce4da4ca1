import os

import cv2
import pytest


@pytest.fixture(autouse=True)
def _quiet() -> None:
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
