from pathlib import Path

import numpy as np
import pytest

from labcdp.evaluate.video.annotated import AnnotatedVideo

GREY = np.tile(np.linspace(20, 220, 161).astype(np.uint8), (121, 1))
ROW = {"time_s": 0.4, "note": "", "cdp": np.array([0.5, 0.25]), "measured_contrast": 9.8}


def test_nothing_stays_after_an_error(tmp_path: Path) -> None:
    def interrupted() -> None:
        with AnnotatedVideo(tmp_path / "annotated.mp4") as video:
            video(0, GREY, (), ROW)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []
