"""What reads each kind of file, and whether an altered file may give another result."""

import hashlib
import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from .damage import BYTES, JSON, TEXTS, Damage

#: Enough for the seeds, and small enough that nothing larger may take memory.
MAX_PIXELS = 2_000_000


@dataclass(frozen=True)
class Target:
    """A reader.

    Parameters
    ----------
    read : function of (Path, Path)
        Gets the folder of the seeds and the damaged file; returns what was read, as numbers, texts and arrays.
    files : str
        Pattern of the files in the folder that are damaged.
    ways : tuple of functions
        How they are damaged.
    strict : bool
        Whether the file carries checks, so that what is accepted must be what was written.
    repair : function of bytes, or None
        Makes checks fit again, so that what lies behind them is reached.
    cost : float
        Seconds that reading takes, about.
    most_seconds : float
        Seconds that it may take.
    """

    read: Callable[[Path, Path], Any]
    files: str
    ways: tuple[Damage, ...] = BYTES
    strict: bool = False
    repair: Callable[[bytes], bytes] | None = None
    cost: float = 0.002
    most_seconds: float = 10.0


class WrongNumberError(Exception):
    """A reader took a value for another one."""


def _chain(_: Path, file: Path) -> Any:
    from labcdp.chain import Chain
    from labcdp.core.disk.text import toml_text

    chain = Chain.load(file)
    given = tomllib.loads(file.read_text())
    for sensor in given["sensor"] if isinstance(given.get("sensor"), list) else [given.get("sensor", {})]:
        # The size stands in the scene, and the name of a single sensor is that of its table.
        for key in ("width", "height", "name"):
            sensor.pop(key, None)
    _require_kept(given, chain.document)
    return toml_text(chain.document), chain.scene.shape


def _camera(_: Path, file: Path) -> Any:
    from labcdp.evaluate.picture.camera_specification import CameraSpecification

    specification = CameraSpecification.load(file).model_dump(mode="json")
    _require_kept(tomllib.loads(file.read_text("utf-8-sig")), specification)
    return specification


def _simulated_bench(_: Path, file: Path) -> Any:
    from labcdp.drivers.simulated.devices import SimulatedBenchFile

    return repr(SimulatedBenchFile.load(file).devices(file))


def _certificate(_: Path, file: Path) -> Any:
    from labcdp.session import MeterCertificate

    certificate = MeterCertificate.load(file).model_dump(mode="json")
    _require_kept(tomllib.loads(file.read_text("utf-8-sig")), certificate)
    return certificate


def _results(_: Path, file: Path) -> Any:
    from labcdp.cli.info import describe
    from labcdp.evaluate.compare.compare import compare_subjects
    from labcdp.evaluate.compare.result import compare_result
    from labcdp.report.files import envelope_json

    return repr(describe(file, "A")), envelope_json(compare_result(compare_subjects([str(file), str(file)])))


def _info(_: Path, file: Path) -> Any:
    from labcdp.cli.info import describe

    return repr(describe(file, "A"))


def _sensor(_: Path, file: Path) -> Any:
    from labcdp.chain import Chain
    from labcdp.core.disk.text import toml_text
    from labcdp.evaluate.camera.sensor import with_emva1288

    return toml_text(with_emva1288(Chain.load("manta-g505"), file)[0].document)


def _bench(_: Path, file: Path) -> Any:
    from labcdp.session import SessionConfiguration

    configuration = SessionConfiguration.load(file.with_name("bench.toml"))
    text = configuration.to_toml()
    given = tomllib.loads(file.with_name("bench.toml").read_text("utf-8-sig"))
    for table, key in (("camera", "spectral_sensitivity"), ("source", "spectrum_file")):
        given.get(table, {}).pop(key, None)
    _require_kept(given, tomllib.loads(text))
    return text


def _require_kept(given: Any, read: Any) -> None:
    """Refuse a reader that takes a key for another value than the document has."""
    if isinstance(given, dict):
        for key, value in given.items():
            if key not in read and value in ("", [], {}):
                continue
            if key not in read:
                raise WrongNumberError(f"{key} was left out")
            _require_kept(value, read[key])
    elif isinstance(given, list) and isinstance(read, list | tuple) and len(given) == len(read):
        for one, other in zip(given, read, strict=True):
            _require_kept(one, other)
    elif isinstance(given, int | float) and isinstance(read, int | float) and float(given) == float(read):
        return
    elif given != read and str(given) != str(read):
        raise WrongNumberError(f"{given!r} was read as {read!r}")


def _spectrum(_: Path, file: Path) -> Any:
    from labcdp.core.spectra import read_spectral_file

    return {name: (one.wavelength_nm, one.values) for name, one in read_spectral_file(file).columns.items()}


def _readings(_: Path, file: Path) -> Any:
    from labcdp.core.reading import MeterIdentity
    from labcdp.drivers.file_meter import FileMeter
    from labcdp.drivers.manual import MeterAccuracy

    with FileMeter(file, MeterIdentity("Other", "1"), MeterAccuracy(0.02, 0.001, 1)) as meter:
        return {patch: [reading.to_dict() for reading in found] for patch, found in meter.readings.items()}


def _faults(_: Path, file: Path) -> Any:
    from labcdp.core.disk import read_text
    from labcdp.drivers.simulated.commands import parse_schedule

    return repr(parse_schedule(read_text(file, "a schedule of faults", 2**20), "faults.txt"))


def _list(folder: Path, _: Path) -> Any:
    from labcdp.output.folder import read_list

    return repr(read_list(folder))


def _regions(_: Path, file: Path) -> Any:
    from labcdp.regions import load_regions
    from labcdp.regions.region_file import regions_json

    shapes = load_regions(file, (320, 240))
    text = regions_json(shapes, None)
    if file.suffix == ".json":
        given = json.loads(file.read_bytes())
        del given["version"], given["format"]
        given.pop("image", None)
        defaults = {"angle_deg": 0.0, "gap": 0.0}
        _require_kept(given, {"regions": [defaults | one for one in json.loads(text)["regions"]]})
    return text


def _picture(_: Path, file: Path) -> Any:
    from labcdp.files.picture import PictureOptions
    from labcdp.files.read import read_picture

    options = PictureOptions(max_pixels=MAX_PIXELS)
    if file.suffix == ".raw":
        options = PictureOptions(max_pixels=MAX_PIXELS, size=(32, 24), pixel_format="Mono12")
    picture = read_picture(file, options)
    if picture.frame is None:
        return picture.light
    return picture.frame.dn


def _luminance(_: Path, file: Path) -> Any:
    from labcdp.files.luminance_file import load_luminance

    luminance, _about = load_luminance(file)
    return [luminance.luminance_cd_m2, luminance.random_rel, luminance.common_rel, luminance.invalid]


def _scene(folder: Path, file: Path) -> Any:
    from labcdp.chain import Chain

    return Chain.load(folder / "chain.toml").scene.luminance_map()


def _session(folder: Path, _: Path) -> Any:
    from labcdp.session import FrameRecord, Session

    session = Session.open(folder)
    session.problems()
    repr((session.exposures_s, session.readings()))
    # A journal that ends earlier is that of a session that was interrupted there.
    read = [session.configuration.to_toml()]
    for record in session.records:
        read.append(repr(record))
        if isinstance(record, FrameRecord):
            read.append(session.load(record).dn.tolist())
    return read


def _rechecked(data: bytes, *, chained: bool = True) -> bytes:
    """Give the lines of a journal checks that fit."""
    check, lines = "", []
    for line in data.split(b"\n")[:-1]:
        body = line.rpartition(b', "check"')[0] + b"}" if b', "check"' in line else line
        check = hashlib.sha256(check.encode() * chained + body).hexdigest()
        lines.append(body[:-1] + f', "check": "{check}"}}\n'.encode())
    return b"".join(lines)


def _journal(folder: Path, file: Path) -> Any:
    from labcdp.core.disk.journal import LineJournal

    head = {"axes": {"a.b": [1, 2, 3]}, "seed": 0}
    journal = LineJournal.open(file, head, "sweep")
    rows = [json.dumps(row) for row in journal.rows()]
    journal.close()
    return rows


def _sweep(folder: Path, file: Path) -> Any:
    from labcdp.core.disk.journal import LineJournal
    from labcdp.evaluate.sweep.run import _recorded

    journal = LineJournal.open(file, {"axes": {"a.b": [1, 2, 3]}, "seed": 0}, "sweep")
    try:
        return [(first, values.tolist()) for first, values in _recorded(journal, 3)]
    finally:
        journal.close()


def _calibration(_: Path, path: Path) -> Any:
    from labcdp.calibration import load_any

    return repr(load_any(path))


def _history(folder: Path, _: Path) -> Any:
    from labcdp.cli.compare import _read

    return repr(_read([folder]))


def _emva(folder: Path, _: Path) -> Any:
    from labcdp.calibration.emva.index import load_index

    return repr(load_index(folder))


def _emva_image(_: Path, file: Path) -> Any:
    from labcdp.calibration.emva.images import read_image

    return read_image(file, (24, 32), 12)


def _video(_: Path, file: Path) -> Any:
    from labcdp.files.picture import PictureOptions
    from labcdp.files.video.open import open_video

    frames = []
    for entry in open_video(file, PictureOptions(max_pixels=MAX_PIXELS)).entries():
        if len(frames) > 5000:
            raise AssertionError("a small file has more than 5000 frames")
        try:
            frames.append((entry.number, entry.load().frame.dn if not entry.fault else entry.fault))
        except ValueError as error:
            frames.append((entry.number, str(error)))
    return frames


def _reference(_: Path, file: Path) -> Any:
    from labcdp.evaluate.video.settings import VideoReference

    reference = VideoReference(file, "number")
    return [reference.contrast(number, number / 25) for number in range(20)]


TARGETS: dict[str, Target] = {
    "chain": Target(_chain, "*.toml", TEXTS, cost=0.02),
    "image-chain": Target(_scene, "scene.tif"),
    "camera": Target(_camera, "*.toml", TEXTS, cost=0.02),
    "bench": Target(_bench, "*.*", TEXTS, cost=0.01),
    "simulated-bench": Target(_simulated_bench, "*.toml", TEXTS, cost=0.01),
    "certificate": Target(_certificate, "*.toml", TEXTS),
    "results": Target(_results, "*.json", JSON, cost=0.02),
    "info": Target(_info, "*.*"),
    "characterisation": Target(_results, "*.json", JSON, cost=0.02),
    "sensor": Target(_sensor, "*.json", JSON, cost=0.02),
    "sheet": Target(_sensor, "*.toml", TEXTS, cost=0.02),
    "spectrum": Target(_spectrum, "*.csv", TEXTS),
    "readings": Target(_readings, "*.csv", TEXTS),
    "faults": Target(_faults, "*.txt", TEXTS),
    "list": Target(_list, "labcdp-files.json", JSON),
    "regions": Target(_regions, "*.json", JSON, cost=0.01),
    "imagej": Target(_regions, "*.*", cost=0.01),
    "png": Target(_picture, "*.png", strict=True),
    "tiff": Target(_picture, "*.tif", cost=0.01),
    "picture": Target(_picture, "*.*", cost=0.01),
    "luminance": Target(_luminance, "*.*", cost=0.01),
    "session": Target(_session, "**/*.*", JSON, strict=True, cost=0.02),
    "session-rechecked": Target(_session, "journal.jsonl", JSON, repair=partial(_rechecked, chained=False), cost=0.02),
    "journal": Target(_journal, "video.jsonl", JSON, strict=True),
    "sweep": Target(_sweep, "sweep.jsonl", JSON, strict=True),
    "sweep-rechecked": Target(_sweep, "sweep.jsonl", JSON, repair=_rechecked),
    "calibration": Target(_calibration, "*.*", JSON, strict=True, cost=0.03),
    "history": Target(_history, "*.*", JSON, strict=True, cost=0.04),
    "emva": Target(_emva, "*.txt", TEXTS, cost=0.01),
    "emva-image": Target(_emva_image, "*.*"),
    "video": Target(_video, "*.*", cost=0.1),
    # It begins a process, and on a busy computer this takes time.
    "reference": Target(_reference, "*.nc", cost=2.0, most_seconds=90.0),
}
#: Seeds of targets that damage the same files in another way.
SEEDS = {"sensor": "characterisation", "session-rechecked": "session", "sweep-rechecked": "sweep"}
