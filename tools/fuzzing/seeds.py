"""Valid files of every kind that labcdp reads, small, each in a folder of its own."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import tifffile

from labcdp.core.disk.journal import LineJournal
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.luminance import LuminanceMap
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.output.file import StoredFile
from labcdp.output.folder import LIST_FILE, FileList

DATA = Path(str(files("labcdp"))) / "data"
RNG = np.random.default_rng(7)
SHAPE = (24, 32)
DN = RNG.integers(0, 4096, SHAPE, dtype=np.uint16)
GREY = RNG.integers(0, 256, SHAPE, dtype=np.uint8)
COLOURS = RNG.integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
LIGHT = RNG.uniform(1, 900, SHAPE).astype(np.float32)
START = datetime(2026, 3, 1, 12, tzinfo=UTC)
CAMERA = CameraIdentity("Vendor", "Model", "0815")

BENCH = """format = 1
name = "Two patches"
operator = "A. M."
[camera]
model = "Model"
pixel_pitch_m = 3.45e-6
spectral_sensitivity = "camera.csv"
[lens]
model = "LM6"
serial = "0117"
focal_length_m = 0.006
f_number = 2.6
[meter]
model = "LS-110"
serial = "733"
calibration_date = 2025-03-31
[source]
spectrum = "LED-B4"
[target]
name = "board"
[[target.patch]]
name = "left"
roi = [2, 3, 4, 5]
nominal_luminance_cd_m2 = 356
[[target.patch]]
name = "right"
corners = [[10, 3], [14, 3], [12, 8.5]]
[[contrast]]
bright = "left"
dark = "right"
contrast = 3.7
[plan]
exposures_s = [0.005, 0.02]
"""
SPECTRUM = "wavelength_nm,R,G,B\n380,0,0,0\n450,0.1,0.2,0.9\n550,0.2,0.8,0.2\n650,0.9,0.2,0.1\n780,0,0,0\n"
READINGS = """patch;luminance;unit;time
left;356,5;cd/m2;2026-03-01 12:00:00+00:00
right;12,25;cd/m2;2026-03-01 12:01:00+00:00
right;3,5 fL;;2026-03-01 12:02:00+00:00
"""
REGIONS = {
    "format": "labcdp regions",
    "version": 1,
    "image": {"width": 320, "height": 240},
    "regions": [
        {"name": "p", "kind": "polygon", "corners": [[1, 2], [50, 2], [40, 60.5]]},
        {"name": "r", "kind": "rectangle", "x": 60, "y": 10, "width": 30, "height": 20, "angle_deg": 10},
        {"name": "e", "kind": "ellipse", "x": 100, "y": 10, "width": 30, "height": 20},
        {"name": "g", "kind": "grid", "x": 10, "y": 100, "width": 90, "height": 60, "rows": 2, "columns": 3, "gap": 2},
    ],
}
IMAGE_CHAIN = """name = "image"
[scene]
type = "image"
path = "scene.tif"
regions_xywh = { a = [0, 0, 8, 8], b = [8, 0, 8, 8] }
[optics]
f_number = 2.0
transmittance = 0.9
"""
SHEET = """[emva1288]
width = 2464
height = 2056
bits = 12
quantum_efficiency = 0.64
wavelength_nm = 525
snr_max_db = 40.3
dynamic_range_db = 71.2
"""
CERTIFICATE = """number = "1"
laboratory = "PTB"
date = 2026-03-31
due_date = 2027-04-01
expanded_uncertainty_rel = 0.012
"""
SCHEDULE = "at 1 min vanish for 5 s\nat 90 s freeze for 3 s\n"


def make_seeds(folder: Path) -> None:
    """Write all files into a new folder."""
    for make in (_texts, _regions, _pictures, _session, _journals, _calibration, _results, _emva, _videos, _netcdf):
        make(folder)


def _write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def _texts(folder: Path) -> None:
    for name in ("manta-g505", "thesis-second-sensor"):
        _write(folder / "chain" / f"{name}.toml", (DATA / "chains" / f"{name}.toml").read_bytes())
    image = folder / "image-chain"
    _write(image / "chain.toml", IMAGE_CHAIN)
    tifffile.imwrite(image / "scene.tif", LIGHT)
    _write(folder / "camera" / "camera.toml", (DATA / "cameras" / "thesis-2018.toml").read_bytes())
    _write(folder / "bench" / "bench.toml", BENCH)
    _write(folder / "bench" / "camera.csv", SPECTRUM)
    _write(folder / "spectrum" / "camera.csv", SPECTRUM)
    _write(folder / "spectrum" / "lamp.csv", "wavelength_nm\tpower\n380\t0,0\n500\t1,5\n780\t0\n")
    _write(folder / "readings" / "readings.csv", READINGS)
    _write(folder / "readings" / "plain.csv", "patch,luminance_cd_m2\nleft,356.5\nright,12.25\n")
    _write(folder / "faults" / "faults.txt", SCHEDULE)
    _write(folder / "simulated-bench" / "bench.toml", (DATA / "simulated-bench.toml").read_bytes())
    _write(folder / "sheet" / "sheet.toml", SHEET)
    _write(folder / "certificate" / "certificate.toml", CERTIFICATE)
    files = tuple(StoredFile(name, 64 * "a", 12) for name in ("report.html", "figures/a.png"))
    _write(folder / "list" / LIST_FILE, FileList("image", True, files, "video.jsonl").encode())


def _regions(folder: Path) -> None:
    from labcdp.regions import load_regions, save_regions

    path = _write(folder / "regions" / "regions.json", json.dumps(REGIONS, indent=2))
    shapes = load_regions(path)
    (folder / "imagej").mkdir()
    save_regions(folder / "imagej" / "all.zip", shapes)
    save_regions(folder / "imagej" / "one.roi", shapes[:1])
    save_regions(folder / "imagej" / "turned.roi", shapes[1:2])


def _pictures(folder: Path) -> None:
    from labcdp.files.luminance_file import save_luminance

    png, tiff, other, own = (folder / name for name in ("png", "tiff", "picture", "luminance"))
    for one in (png, tiff, other, own):
        one.mkdir()
    for name, values in (("deep", DN), ("grey", GREY), ("colours", COLOURS)):
        cv2.imwrite(str(png / f"{name}.png"), values)
    cv2.imwrite(str(other / "colours.jpg"), COLOURS)
    cv2.imwrite(str(tiff / "lzw.tif"), DN, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    cv2.imwrite(str(tiff / "packbits.tif"), GREY, [cv2.IMWRITE_TIFF_COMPRESSION, 32773])
    tifffile.imwrite(tiff / "plain.tif", DN, rowsperstrip=5)
    tifffile.imwrite(tiff / "zip.tif", DN, compression="zlib", rowsperstrip=5)
    tifffile.imwrite(tiff / "tiles.tif", DN, compression="zlib", tile=(16, 16))
    tifffile.imwrite(tiff / "planes.tif", np.moveaxis(COLOURS, 2, 0), photometric="rgb", planarconfig="separate")
    tifffile.imwrite(tiff / "big.tif", LIGHT, bigtiff=True, byteorder=">")
    np.save(other / "array.npy", DN)
    _write(other / "dump.raw", DN.tobytes())
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "whiteLuminance": 100.0}
    channels = {name: LIGHT.copy() for name in "RGB"}
    with OpenEXR.File(header, channels) as file:
        file.write(str(other / "light.exr"))
    cfa = [
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, bytes((0, 1, 1, 2)), True),
        (50706, "B", 4, b"\1\4\0\0", True),
    ]
    facts = [(33434, "2I", 1, (1, 125), True), (34855, "H", 1, 200, True), (50708, "s", 0, "Acme", True)]
    matrix = (50721, "2i", 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True)
    tifffile.imwrite(
        other / "raw.dng",
        DN,
        photometric=32803,
        metadata=None,
        extratags=[*cfa, *facts, matrix, (50717, "I", 1, 4095, True)],
    )
    light = LuminanceMap(LIGHT, LIGHT * 0 + 0.01, 0.02, (GREY > 250).astype(np.uint8))
    for suffix in (".npz", ".tif", ".exr"):
        save_luminance(light, own / f"map{suffix}", {"camera": "Model"})


def frame(number: int) -> Frame:
    """Return a small frame."""
    when = START + timedelta(seconds=number)
    dn = RNG.integers(0, 4096, (9, 16), dtype=np.uint16)
    return Frame(dn, 0.005, 0.0, 12, 4095.0, 64.0, "Mono12", None, 35.0, when, number, number, CAMERA)


def _session(folder: Path) -> None:
    from labcdp.session import Session, SessionConfiguration

    path = folder / "session"
    configuration = SessionConfiguration.load(folder / "bench" / "bench.toml")
    with Session.create(path, configuration, compress=True) as session:
        frames = session.add_frames([(frame(1), "light", None), (frame(2), "dark", None), (frame(3), "light", "left")])
        meter = MeterIdentity("LS-110", "733", "2025-03-31")
        reading = Reading(356.0, "cd/m2", 1.0, 0.02, 1.0, 0.001, False, "preset", False, meter, START, "  356.")
        session.add_reading(reading, "left")
        session.supersede(frames[:1], "flicker")
        session.add_event("exposures", {"exposures_s": [0.005, 0.02]})


def _journals(folder: Path) -> None:
    from labcdp.evaluate.sweep.maps.axes import VARIABLES

    head = {"axes": {"a.b": [1, 2, 3]}, "seed": 0}
    sweep = LineJournal.open(folder / "sweep" / "sweep.jsonl", head, "sweep")
    for first in range(3):
        sweep.add({"first": first, "values": [[first + 0.1] * len(VARIABLES)]})
    sweep.close()
    video = LineJournal.open(folder / "journal" / "video.jsonl", head, "evaluation")
    for number in range(4):
        video.add({"frame": number, "time_s": number / 25, "cdp": [0.5, float("nan")], "note": "ä"})
    video.close()


def _calibration(folder: Path) -> None:
    from labcdp.calibration import save
    from labcdp.core.vignetting import FlatField
    from labcdp.evaluate.bench.calibrate import calibrate_session
    from labcdp.evaluate.bench.observe import observe_session
    from labcdp.session import Session, example_session

    calibration = calibrate_session(observe_session(Session.open(example_session())))
    height, width = calibration.state.image_shape
    relative = np.ones((height, width), np.float32)
    for name in ("calibration", "history"):
        (folder / name).mkdir()
    save(calibration, folder / "calibration" / "calibration.json")
    save(calibration, folder / "history" / "calibration.json")
    save(replace(calibration, vignetting=FlatField(relative, 0.001, 0.01, 8)), folder / "calibration" / "arrays.json")


def _results(folder: Path) -> None:
    import labcdp
    from labcdp.evaluate.camera.characterise import characterise_session
    from labcdp.evaluate.camera.result import result
    from labcdp.report.files import envelope_json
    from labcdp.report.sheets import result_workbook
    from labcdp.session import Session, example_session

    evaluated = labcdp.Session.open(example_session()).calibrate().evaluate()
    _write(folder / "results" / "results.json", json.dumps(evaluated.to_dict()))
    found = characterise_session(Session.open(example_session()))
    described = result(found)
    _write(folder / "characterisation" / "results.json", envelope_json(described))
    _write(folder / "info" / "results.xlsx", result_workbook(described, datetime.now(UTC)))


def _emva(folder: Path) -> None:
    lines = ["# known camera", "v 3.1", "n 12 32 24"]
    images = folder / "emva" / "images"
    images.mkdir(parents=True)
    for number in range(3):
        for letter, photons in (("b", f" {100 * (number + 1)}"), ("d", "")):
            lines.append(f"{letter} {1000 * (number + 1)}{photons}")
            for index in range(2):
                suffix = ".png" if index else ".tif"
                name = f"{letter}{number}{index}{suffix}"
                cv2.imwrite(str(images / name), DN, [cv2.IMWRITE_TIFF_COMPRESSION, 1] if suffix == ".tif" else [])
                lines.append(f'i "images\\{name}"')
    _write(folder / "emva" / "EMVA1288_Data.txt", "\n".join(lines) + "\n")
    for suffix, compression in ((".png", None), (".tif", "zlib")):
        path = folder / "emva-image" / f"a{suffix}"
        path.parent.mkdir(exist_ok=True)
        if compression:
            tifffile.imwrite(path, DN, compression=compression)
        else:
            cv2.imwrite(str(path), DN)


def _videos(folder: Path) -> None:
    """One of each kind that FFmpeg writes here."""
    import av

    (folder / "video").mkdir()
    kinds = (
        ("a.avi", "mjpeg", "yuvj420p"), ("b.avi", "ffv1", "gray"), ("c.mp4", "mpeg4", "yuv420p"),
        ("d.mkv", "libx264", "yuv420p10le"), ("e.mp4", "libx265", "yuv420p"), ("f.webm", "libvpx-vp9", "yuv420p"),
        ("g.mpg", "mpeg2video", "yuv420p"), ("h.mov", "png", "rgb48be"),
    )  # fmt: skip
    for name, codec, kind in kinds:
        with av.open(str(folder / "video" / name), "w") as container:
            stream = container.add_stream(codec, rate=25, options={"x265-params": "log-level=none"})
            stream.width, stream.height, stream.pix_fmt = 64, 48, kind
            for number in range(6):
                image = np.random.default_rng(number).integers(0, 256, (48, 64, 3), dtype=np.uint8)
                frame = av.VideoFrame.from_ndarray(image).reformat(format=kind)
                frame.pts = number
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))


def _netcdf(folder: Path) -> None:
    import xarray as xr

    from labcdp.report.files import dataset_bytes

    number = np.arange(20)
    data = {"time_s": ("frame", number / 25), "measured_contrast": ("frame", RNG.uniform(1, 3, 20))}
    dataset = xr.Dataset(data, {"frame": number}, {"title": "a video"})
    _write(folder / "reference" / "results.nc", dataset_bytes(dataset, "result"))
