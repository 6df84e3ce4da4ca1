"""A user's program: every public name, typed strictly by tools/lint and run by the tests."""

import sys
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import labcdp
from labcdp.evaluate.chart.chart_file import chart_template
from labcdp.session import example_session


def probabilities() -> float:
    bright, dark = np.array([120.0, 125.0, 130.0]), [100, 101, 102]
    one = labcdp.cdp(bright, dark, 0.2, epsilon=0.5)
    low, high = one.interval
    number: float = one.cdp + one.u + low + high
    several = labcdp.cdp(bright, dark, [0.1, 0.2], labcdp.DetectionInterval.at_least(0.5))
    array: NDArray[np.float64] = several.cdp + several.interval.low
    neighbours: labcdp.Cdp[NDArray[np.float64]] = labcdp.cdp_neighbours(
        np.arange(1, 101).reshape(10, 10), np.array([0.1, 0.2])
    )
    matrix: xr.Dataset = labcdp.cdp_matrix({"bright": bright, "dark": dark}, 0.2)
    rng = np.random.default_rng(0)
    red, green = (rng.normal(mean, 5, (100, 3)) for mean in ((60, 50, 50), (50, 60, 50)))
    separation: labcdp.metrics.ColourSeparation = labcdp.colour_separation(red, green)
    assert separation.distance.value > 2
    y, x = np.mgrid[:60, :60]
    lamp = labcdp.Roi.rectangle("lamp", 32, 16, 16, 16)
    stray: labcdp.metrics.Flare = labcdp.flare(np.full((64, 96), 2.0), [lamp])
    assert stray.light.mean.value > 1
    assert labcdp.sfr(10 + 90 * np.clip(x - 33 + 0.1 * y, 0, 1)).mtf50.value > 0.1
    assert float(matrix.cdp.sel(bright="bright", dark="dark")) == one.cdp
    return number + float(array.sum()) + float(neighbours.cdp.mean())


def chains(folder: Path) -> xr.Dataset:
    chain = labcdp.Chain.load("manta-g505").with_(scene__width=32, scene__height=24, scene__square_px=4)
    run = chain.run(seed=0)
    assert run["sensor"].values.shape == (24, 32)
    chain.save(folder / "mine.toml")
    assert labcdp.Chain.load(str(folder / "mine.toml")) == chain
    both: labcdp.Comparison = labcdp.compare(chain, folder / "mine.toml", scene__luminance_cd_m2=[1.0, 10.0])
    assert both.answer == "there is no difference"
    result: xr.Dataset = chain.sweep(scene__luminance_cd_m2=np.geomspace(1, 100, 5), exact=True)
    usable: xr.Dataset = result.labcdp.usable_range(level=0.9)
    result.labcdp.save(folder / "map.nc")
    assert labcdp.read_dataset(folder / "map.nc").equals(result)
    assert labcdp.chain.preset_names()
    return usable


def pictures(path: Path, regions: Path) -> xr.Dataset:
    image: labcdp.Image = labcdp.read_image(path, encoding="linear")
    luminance: labcdp.LuminanceMap = image.luminance
    assert luminance.shape == image.shape
    rois = [labcdp.Roi.rectangle("a", 22, 42, 26, 26), labcdp.Roi.rectangle("b", 22, 82, 26, 26)]
    assert image.regions(rois).cdp().sizes["pair"] == 1
    assert image.regions({"a": (22, 42, 26, 26), "b": (22, 82, 26, 26)}, ("a", "b")).cdp(1.0).sizes["pair"] == 1
    assert len(labcdp.regions.load_regions(regions)) == 2
    frame: labcdp.Frame | None = labcdp.files.read_picture(path).frame
    assert frame is not None
    found = image.regions(regions).cdp([1, 10], epsilon=0.5)
    file = path.with_name("requirement.toml")
    file.write_text('contrast = "100%"\nluminance_cd_m2 = [1.0, 10.0]\n')
    required: labcdp.Requirement = labcdp.Requirement.load(file)
    assert found.labcdp.judged(required).verdict in ("met", "not met", "undecided")
    return found


def videos(path: Path, regions: Path) -> xr.Dataset:
    video: labcdp.Video = labcdp.open_video(path)
    lamps: xr.Dataset = video.flicker(regions, "fixed", stop=2)
    lamp: labcdp.Flicker = labcdp.flicker(lamps["mean"].values[:, 0], off=0.01, threshold=0.2)
    assert lamp.fmi.value == float(lamps["fmi"][0])
    square = [(10.0, 10.0), (60.0, 10.0), (60.0, 60.0), (10.0, 60.0)]
    chart_file = path.with_name("chart.toml")
    chart_file.write_text(chart_template("thesis-2x2"))
    chart: xr.Dataset = video.chart(chart_file, corners=square, method="fixed", stop=2)
    assert chart["lowest_cdp"].dims == ("bright", "dark")
    return video.track(regions, method="fixed", stop=2).cdp([1, 10])


def sessions() -> xr.Dataset:
    session: labcdp.Session = labcdp.Session.open(example_session())
    calibrated = session.calibrate()
    assert isinstance(calibrated.calibration, labcdp.calibration.Calibration)
    evaluated = calibrated.evaluate()
    flicker: xr.Dataset = evaluated.flicker(tolerance=0.05)
    assert flicker["fmi"].dims == ("patch", "exposure_s")
    return evaluated.to_dataset()


def readings(readings: list[labcdp.Reading]) -> float:
    return sum(reading.value for reading in readings)


def devices() -> None:
    with labcdp.drivers.open_camera("192.0.2.1") as camera, labcdp.drivers.open_meter("/dev/ttyUSB0") as meter:
        frame: labcdp.Frame = camera.snap()
        reading: labcdp.Reading = meter.measure()
        print(frame.exposure_s, reading.value)


def main(picture: Path, video: Path, regions: Path, folder: Path) -> None:
    print(probabilities(), readings([]), labcdp.metrics.weber_contrast(2.0, 1.0), labcdp.__version__)
    for dataset in (chains(folder), pictures(picture, regions), videos(video, regions), sessions()):
        print(dataset)
    try:
        labcdp.read_image(folder / "nothing.png")
    except labcdp.InputError as error:
        caught: labcdp.LabcdpError = error
        print(caught)


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:5]))
