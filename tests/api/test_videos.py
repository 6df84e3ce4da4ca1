import numpy as np
import pytest

import labcdp


def test_numbers_are_those_of_the_command_line(video, rois, command, tmp_path):
    command("video", video, "--roi", rois, "--contrast", "100%", "--contrast", "200%", "--stop", "4", "-o", "out")
    expected = labcdp.read_dataset(tmp_path / "out" / "results.nc")
    result = labcdp.open_video(video).track(rois, stop=4).cdp([1, 2])
    assert dict(result.sizes) == {"frame": 4, "pair": 1, "contrast": 2, "side": 2, "corner": 4}
    one = result.isel(pair=0)
    for name in ("cdp", "cdp_low", "cdp_high", "below", "above", "measured_contrast", "csnr"):
        np.testing.assert_array_equal(one[name], expected[name])
    for name in ("cdp", "measured_contrast", "mean", "snr"):
        np.testing.assert_array_equal(one[f"u_{name}"], expected[f"{name}_standard_uncertainty"])
    for name in ("mean", "quality", "lost", "centre_x", "saturated", "corner_x"):
        np.testing.assert_array_equal(one[name], expected[name])
    assert one["region"].values.tolist() == expected["region"].values.tolist()
    np.testing.assert_array_equal(one["time_s"], expected["time_s"])


def test_picture_and_first_frame_have_the_same_cdp(video, rois, tmp_path):
    import cv2

    capture = cv2.VideoCapture(str(video))
    _, image = capture.read()
    cv2.imwrite(str(tmp_path / "first.png"), image[:, :, 0])
    still = labcdp.read_image(tmp_path / "first.png", encoding="linear").regions(rois).cdp([1.0, 2.0])
    moving = labcdp.open_video(video, encoding="linear").track(rois, "fixed", stop=1).cdp([1.0, 2.0])
    for name in ("cdp", "below", "above", "measured_contrast"):
        np.testing.assert_allclose(moving[name].isel(frame=0), still[name], rtol=1e-6)


def test_without_contrasts_the_first_frame_decides(video, rois):
    regions = labcdp.open_video(video).track(rois, "fixed")
    result = regions.cdp()
    assert dict(result["cdp"].sizes) == {"frame": 5, "pair": 1}
    assert float(result["contrast"][0]) == pytest.approx(float(result["measured_contrast"][0, 0]), rel=1e-12)
    np.testing.assert_array_equal(regions.cdp(float(result["contrast"][0]))["cdp"], result["cdp"])


def test_neighbours_are_those_of_the_pictures(video):
    result = labcdp.open_video(video).cdp_neighbours([0.05, 0.1], stop=2)
    assert dict(result["cdp"].sizes) == {"frame": 2, "contrast": 2}


def test_video_says_what_it_is(video, rois, tmp_path):
    opened = labcdp.open_video(str(video))
    assert (opened.shape, opened.frame_count, opened.frame_rate) == ((120, 160), 5, 25)
    assert repr(opened) == "<labcdp.Video drive.avi: 5 frames of 160 x 120 pixels>"
    assert "1 pairs, follow" in repr(opened.track(rois))
    assert opened._repr_html_().startswith("<table>")
    result = opened.track(rois, "fixed", stop=2).cdp(1.0)
    assert all("long_name" in result[name].attrs for name in result)
    result.labcdp.save(tmp_path / "video.nc")
    assert labcdp.read_dataset(tmp_path / "video.nc")["cdp"].equals(result["cdp"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "unknown tracking method 'magic': give one of"),
        ({"start": 1.5}, "start is 1.5: give a number of frames, or a time"),
        ({"every": "often"}, "every is 'often'"),
        ({"pairs": [("sign", "sky")]}, "there is no region 'sky'"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(video, rois, options, message):
    with pytest.raises(labcdp.InputError, match=message):
        labcdp.open_video(video).track(rois, **options)
