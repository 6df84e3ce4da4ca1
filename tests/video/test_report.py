import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr

from labcdp.errors import InputError
from labcdp.regions import RectangleShape, save_regions
from labcdp.report.video_figure import drawn_contrasts, video_figure
from labcdp.report.video_files import load_video, write_video
from labcdp.report.video_page import over_time
from labcdp.report.video_summary import runs, summarise
from labcdp.report.video_wording import measured, results, seconds

from .synthetic_results import synthetic_video


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("video") / "results"
    paths = write_video(synthetic_video(reference=10.0), folder)
    assert sorted(path.relative_to(folder).as_posix() for path in paths) == sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )
    return folder


def test_files(written: Path) -> None:
    names = {path.relative_to(written).as_posix() for path in written.rglob("*") if path.is_file()}
    assert names == {"results.nc", "results.json", "results.xlsx", "report.html", "figures/over-time.png"}


@pytest.mark.parametrize("data", [synthetic_video(reference=10.0), synthetic_video(30, regions=())])
def test_netcdf_comes_back_equal(tmp_path: Path, data: xr.Dataset) -> None:
    write_video(data, tmp_path)
    xr.testing.assert_identical(load_video(tmp_path / "results.nc"), data)
    # Also by those who do not have labcdp.
    with xr.open_dataset(tmp_path / "results.nc") as opened:
        xr.testing.assert_identical(opened.load(), data)


def test_load_refuses_what_is_no_result(tmp_path: Path) -> None:
    xr.Dataset({"cdp": ("x", [1.0])}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(InputError, match=r"other\.nc holds no results of a video: the results have no variable cdp"):
        load_video(tmp_path / "other.nc")
    (tmp_path / "damaged.nc").write_bytes(b"CDF")
    with pytest.raises(InputError, match=r"damaged\.nc is damaged or no NetCDF file .*: restore it"):
        load_video(tmp_path / "damaged.nc")
    with pytest.raises(InputError, match=r"none\.nc cannot be read .*: give the path of a result"):
        load_video(tmp_path / "none.nc")


def test_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "results.xlsx").mkdir()
    with pytest.raises(InputError, match=r"results\.xlsx cannot be written \(.*\): give a folder you can write to"):
        write_video(synthetic_video(30, regions=()), tmp_path)
    assert not list(tmp_path.glob(".*"))


def test_page_says_what_was_measured_in_plain_words(written: Path) -> None:
    page = (written / "report.html").read_text()
    assert "<h1>rain &amp; &lt;fog&gt;.mp4</h1>" in page
    text = page.replace("\u00a0", " ")
    assert (
        "between the regions “bright” and “dark”, followed from frame to frame by kernelised correlation filters "
        "(KCF): 120 frames, number 0 to 119 (0.00 s to 4.76 s)."
    ) in text
    # 0.95 falls to 0.85 over the frames: 0.9 at the end of the first half, of which 25 have no result.
    assert "The reference contrast 1000 % has a CDP of 0.9 or more in 29 % of the frames (35 of 120)." in text
    assert "26 frames could not be evaluated and count as not seen; of the others it is 37 %." in text
    assert "Region “bright” was found in every frame. Region “dark” was lost twice" in text
    assert "the camera is not stated in the file" in text
    assert "broken: the frame cannot be decoded" in text
    assert "data:image/png;base64," in text


def test_values_for_machines(written: Path) -> None:
    values = json.loads((written / "results.json").read_text())
    assert values["unit"] == "cd/m^2"
    assert values["reference"]["n_seen"] == 35
    assert [one["contrast"] for one in values["contrasts"]] == [0.07, 1.0, 10.0]
    assert values["lost"][0] == {
        "region": "dark",
        "first": 40,
        "last": 59,
        "n_frames": 20,
        "start_s": 1.6,
        "duration_s": pytest.approx(0.8),
        "reason": "it left the image",
    }
    # The last one ends with the video.
    assert values["lost"][1]["duration_s"] == pytest.approx(0.04)


def test_shares_by_hand() -> None:
    data = synthetic_video(10, contrasts=(1.0,), regions=())
    data["cdp"][:, 0] = [1, 0.9, 0.8999, np.nan, np.nan, 0.5, 0.95, 0.5, 1, 1]
    one = summarise(data).contrasts[0]
    assert (one.n_evaluated, one.n_seen, one.seen_share, one.lowest, one.lowest_frame) == (8, 5, 0.5, 0.5, 5)
    assert one.mean == pytest.approx((1 + 0.9 + 0.8999 + 0.5 + 0.95 + 0.5 + 1 + 1) / 8)


@pytest.mark.parametrize(
    ("mask", "expected"),
    [([], []), ([0, 0], []), ([1], [(0, 0)]), ([1, 1, 0, 1], [(0, 1), (3, 3)]), ([0, 1, 1], [(1, 2)])],
)
def test_runs(mask: list[int], expected: list[tuple[int, int]]) -> None:
    assert runs(np.array(mask, bool)) == expected


def test_nothing_could_be_evaluated() -> None:
    data = synthetic_video(30, regions=())
    data["cdp"][:] = np.nan
    summary = summarise(data)
    assert results(data, summary)[0] == "No frame has a CDP of the contrast 7 %."
    assert video_figure(data).startswith(b"\x89PNG")


def test_reasons_that_differ_in_numbers_are_one() -> None:
    data = synthetic_video(30, regions=())
    data["note"][20:25] = [f"{share}% of the structure is found again" for share in (12.5, 3, 4, 4, 9)]
    assert summarise(data).notes == (("12.5% of the structure is found again", 5),)


def test_reason_is_that_of_the_region() -> None:
    data = synthetic_video(60)
    data["lost"][40:60, 0] = True
    data["note"][40:60] = "region 'bright' is lost: it is covered; 'dark' is lost: it left the image"
    assert [(one.region, one.reason) for one in summarise(data).lost] == [
        ("bright", "it is covered"),
        ("dark", "it left the image"),
    ]


def test_video_without_times() -> None:
    data = synthetic_video(60).drop_vars("time_s")
    assert "60 frames, number 0 to 59." in measured(data, summarise(data))
    assert "was lost once, in 33 % of the frames, namely in frames 40 to 59." in " ".join(
        results(data, summarise(data))
    )


def test_reference_of_each_frame_has_no_single_value() -> None:
    data = synthetic_video(reference=10.0)
    data["reference_contrast"][:] = np.linspace(5, 6, 120)
    assert results(data, summarise(data))[0].startswith("The reference contrast of each frame has a CDP of 0.9 or more")


def test_one_frame() -> None:
    data = synthetic_video(1)
    assert "1 frame, number 0" in measured(data, summarise(data))
    assert video_figure(data).startswith(b"\x89PNG")


def test_drawn_contrasts() -> None:
    many = tuple(np.arange(1, 21) / 10)
    assert drawn_contrasts(synthetic_video(30, contrasts=many)) == [0, 6, 13, 19]
    # That of the reference is drawn already.
    assert drawn_contrasts(synthetic_video(30, reference=1.0)) == [0, 2]


def test_caption_tells_of_thinned_out_frames() -> None:
    assert "Each drawn point stands" not in over_time(synthetic_video(120)).caption
    assert "Each drawn point stands for 3 frames" in over_time(synthetic_video(1500, contrasts=(1.0,))).caption


@pytest.mark.parametrize(
    ("value", "text"), [(0.04, "0.04 s"), (119.99, "119.99 s"), (120.4, "2 min 00 s"), (7384.0, "2 h 03 min 04 s")]
)
def test_seconds(value: float, text: str) -> None:
    assert seconds(value) == text


def test_refuses_what_is_no_video() -> None:
    data = synthetic_video(30)
    with pytest.raises(InputError, match=r"no variable below over frame and contrast: give results of a video"):
        summarise(data.drop_vars("below"))
    with pytest.raises(InputError, match=r"the results have no frame: evaluate at least one"):
        summarise(data.isel(frame=slice(0)))


def test_documentation_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = Path(__file__).parents[2] / "docs" / "video.md"
    (code,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    frame = np.full((64, 96), 90, np.uint8)
    frame[20:40, 20:40], frame[20:40, 40:60] = 220, 20
    writer = cv2.VideoWriter("drive.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 25, (96, 64))
    for _ in range(3):
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    save_regions("rois.json", [RectangleShape("bright", 22, 22, 16, 16), RectangleShape("dark", 42, 22, 16, 16)])
    exec(code, {})
    assert capsys.readouterr().out == "1.0\n"
    assert (tmp_path / "drive-cdp" / "report.html").is_file()
