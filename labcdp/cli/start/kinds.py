"""Readers that identify a file or folder and return its kind, properties, tables and commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from ...calibration import load_any
from ...calibration.emva.index import load_index
from ...calibration.record import load_verification
from ...chain import Chain
from ...core.disk.documents import read_json, read_toml
from ...core.errors import InputError, LabcdpError
from ...core.frame import Frame
from ...core.photometry import source_names, spectral_weights
from ...core.result import Finding
from ...core.spectra import (
    COMMON_ILLUMINANTS,
    SpectralTable,
    f1_prime,
    least_f1_prime,
    mismatch_factor,
    read_spectral_file,
    weighted_sum,
)
from ...core.table import Column, Table
from ...drivers.simulated.devices import SimulatedBenchFile
from ...evaluate.picture.camera_specification import CameraSpecification
from ...evaluate.sweep.maps.axes import check_map
from ...files.raw import PlaneClipping, planes_of
from ...files.read import read_picture
from ...files.video.open import VIDEO_SUFFIXES, open_video
from ...output import LIST_FILE
from ...regions import load_regions, rois_of
from ...report.files import read_dataset
from ...report.text import finding_text
from ...session import Session, SessionConfiguration
from ...session.journal import JOURNAL

#: Kind, properties by name, further tables, and commands with {file} for the path.
Description: TypeAlias = "tuple[str, dict[str, str], list[Table], list[str]]"


def folder(path: Path) -> Description:
    """Describe a session, a folder of results, or a folder of pictures or videos."""
    if (path / JOURNAL).is_file():
        return _session(path)
    if (path / LIST_FILE).is_file():
        files = sorted(one.name for one in path.iterdir() if one.name != LIST_FILE)
        return "folder of results", {"files": ", ".join(files)}, [], ["info {file}/results.json"]
    if any(one.suffix.lower() in VIDEO_SUFFIXES for one in path.iterdir()):
        return "folder of videos", {}, [], ["video {file} --roi rois.json"]
    try:
        return video(path)
    except LabcdpError:
        raise InputError(f"{path} is no session, folder of results, image sequence or folder of videos") from None


def _session(path: Path) -> Description:
    with Session.open(path) as session:
        configuration = session.configuration
        properties = {
            "name": configuration.name,
            "operator": configuration.operator,
            "patches": ", ".join(patch.name for patch in configuration.target.patches),
            "light frames": str(len(session.frames("light"))),
            "dark frames": str(len(session.frames("dark"))),
            "meter readings": str(len(session.readings())),
        }
    return "session", properties, [], ["calibrate {file}", "evaluate {file} --recalibrate", "characterise {file}"]


def document(path: Path) -> Description:
    """Describe a JSON document that labcdp wrote."""
    content = read_json(path, "a document of labcdp")
    if not isinstance(content, dict):
        raise InputError(f"{path} is no document of labcdp")
    match content.get("schema", content.get("format")):
        case "labcdp-result":
            return _result(content)
        case "labcdp-calibration":
            return _calibration(path)
        case "labcdp-verification":
            return _verification(path)
        case "labcdp regions":
            return regions(path)
    raise InputError(f"{path} is no document of labcdp: its key schema or format names no known kind")


def _result(content: dict[str, object]) -> Description:
    tables, inputs = content.get("tables"), content.get("inputs")
    properties = {
        "command": str(content.get("kind")),
        "title": str(content.get("title")),
        "tables": ", ".join(tables) if isinstance(tables, dict) else "",
        "inputs": ", ".join(str(one.get("path")) for one in inputs if isinstance(one, dict))
        if isinstance(inputs, list)
        else "",
    }
    comparable = content.get("kind") in ("evaluate", "image", "characterise", "sweep", "calibrate")
    return "results", properties, [], ["compare {file} OTHER"] if comparable else []


def _calibration(path: Path) -> Description:
    loaded = load_any(path)
    low, high = loaded.range_cd_m2
    properties = {
        "camera": str(loaded.state.camera),
        "lens": loaded.lens.model,
        "calibrated range": f"{low:.3g} to {high:.3g} cd/m²",
        "measured": f"{loaded.provenance.measured:%Y-%m-%d %H:%M}",
    }
    commands = ["evaluate SESSION --calibration {file}", "luminance {file} FRAME --output map.exr"]
    commands += ["image PICTURE --calibration {file} --roi rois.json", "compare {file} OTHER"]
    return "calibration", properties, [], commands


def _verification(path: Path) -> Description:
    load_verification(path)
    return "verification of a calibration", {}, [], ["history {file}"]


def toml(path: Path) -> Description:
    """Describe a bench plan, a simulated bench, a chain or a camera specification."""
    content = read_toml(path, "a bench plan, chain or camera specification")
    if "plan" in content:
        plan = SessionConfiguration.load(path)
        names = ", ".join(patch.name for patch in plan.target.patches)
        properties = {"name": plan.name, "patches": names}
        return "bench plan", properties, [], ["acquire {file} my-session", "acquire {file} my-session --simulated"]
    if "scene" in content:
        chain = Chain.load(str(path))
        properties = {"description": chain.description}
        commands = ["simulate {file}", "sweep {file} --over NAME=START:STOP:COUNT", "compare {file} manta-g505"]
        return "imaging chain", properties, [], commands
    if "emva1288" in content:
        return "EMVA 1288 data sheet", {}, [], ["init chain my.toml --sensor {file}"]
    if content and content.keys() <= {"seed", "camera", "sensor", "meter"}:
        camera = SimulatedBenchFile.load(path).devices(path)
        commands = ["acquire PLAN rehearsal --simulated-bench {file}"]
        return "simulated bench", {"camera": f"{camera.vendor} {camera.model}"}, [], commands
    specification = CameraSpecification.load(path)
    commands = ["image PICTURE --camera-spec {file} --roi rois.json"]
    return "camera specification", {"name": specification.name}, [], commands


def regions(path: Path) -> Description:
    """Describe a region file."""
    names = [roi.name for roi in rois_of(load_regions(path))]
    properties = {"regions": f"{len(names)}: {', '.join(names)}"}
    return "region file", properties, [], ["image PICTURE --roi {file}", "video VIDEO --roi {file}"]


def map_file(path: Path) -> Description:
    """Describe a map of a sweep."""
    dataset = read_dataset(path, "map")
    try:
        check_map(dataset)
    except InputError as error:
        raise InputError(f"{path} is no map of labcdp: {error}") from error
    properties = {
        "axes": ", ".join(f"{name} ({size})" for name, size in dataset.sizes.items()),
        "variables": ", ".join(str(name) for name in dataset.data_vars),
    }
    return "map of a sweep", properties, [], ["compare {file} OTHER"]


def data_set(path: Path) -> Description:
    """Describe a data set after EMVA 1288."""
    index = load_index(path)
    properties = {
        "release": index.release,
        "images": f"{index.width} x {index.height} pixels, {index.bits} bits, {len(index.blocks)} series",
    }
    return "EMVA 1288 data set", properties, [], ["characterise {file}"]


def picture(path: Path) -> Description:
    """Describe a picture."""
    found = read_picture(path)
    height, width = found.shape
    frame = found.frame
    properties = {
        "size": f"{width} x {height} pixels",
        "values": "floats" if frame is None else f"{frame.bit_depth} bits, {frame.pixel_format}",
        "encoding": found.encoding,
        "exposure": f"{frame.exposure_s:.4g} s" if frame is not None and found.exposure_known else "not stated",
        "camera": str(frame.camera) if frame is not None and found.camera_stated else "not stated",
        **_notes(found.findings),
    }
    tables = [] if frame is None or found.coloured else [_clipping(frame)]
    return "picture", properties, tables, ["rois {file}", "image {file} --roi rois.json", "image-map {file}"]


def _clipping(frame: Frame) -> Table:
    names = ["all"]
    if frame.colour_filter is not None:
        names = [f"{column}, {row}" for row in ("upper", "lower") for column in ("left", "right")]
    columns = (
        Column("pixels", "pixels", meaning="Which of each 2 x 2, or all."),
        Column("largest_dn", "largest", "DN", "Largest DN."),
        Column("at_largest", "pixels there", "", "Number of pixels that have the largest DN."),
        Column(
            "clipped_from_dn", "clipped from", "DN", "DN from which pixels pile up; empty if the histogram fades out."
        ),
        Column("clipped_share", "share clipped", "%", "Share of the pixels from there on.", digits=2),
    )
    rows = []
    for name, dn in zip(names, planes_of(frame.dn, frame.colour_filter), strict=True):
        found = PlaneClipping.of(dn, frame.nominal_black_dn, frame.saturation_dn)
        pile = None if found.pile is None else found.pile[0]
        rows.append(
            {"pixels": name, "largest_dn": found.largest_dn, "at_largest": found.at_largest, "clipped_from_dn": pile,
             "clipped_share": found.share}
        )  # fmt: skip
    return Table.of_rows("clipping", "End of the histogram", columns, rows)


def video(path: Path) -> Description:
    """Describe a video or a sequence of images."""
    found = open_video(path)
    height, width = found.shape
    properties = {
        "size": f"{width} x {height} pixels",
        "frames": "not stated" if found.frame_count is None else str(found.frame_count),
        "frame rate": "not stated" if found.frame_rate is None else f"{found.frame_rate:.6g} Hz",
        **_notes(found.findings),
    }
    return "video", properties, [], ["rois {file} --frame 0", "video {file} --roi rois.json"]


def _notes(findings: Sequence[Finding]) -> dict[str, str]:
    return {"notes": "; ".join(finding_text(finding) for finding in findings)} if findings else {}


def spectra(path: Path, source: str) -> Description:
    """Describe a camera's spectral sensitivity: f1', and the mismatch factors of common lights (CIE 244)."""
    file = read_spectral_file(path)
    weights = least_f1_prime(file.columns) if len(file.columns) > 1 else {}
    whole = weighted_sum(file.columns, weights) if weights else file.only
    light = _light(source)
    properties = {
        "f1'": f"{f1_prime(whole):.2%} (DIN 5032-7: up to 3 % for meters of class A, 6 % for B)",
        **{f"weight of {name}": f"{weight:.3g}" for name, weight in weights.items()},
        **({f"f1' of {name}": f"{f1_prime(one):.1%}" for name, one in file.columns.items()} if weights else {}),
    }
    factor = "Multiply a luminance measured in this light by it."
    columns = (
        Column("light", "measured light"),
        Column("factor", "factor F", meaning=factor, decimals=4),
        Column("error_rel", "error without it", "%", "Deviation of a luminance that is not corrected.", decimals=2),
    )
    factors = {name: mismatch_factor(whole, name, light) for name in COMMON_ILLUMINANTS}
    rows = [{"light": name, "factor": value, "error_rel": 1 / value - 1} for name, value in factors.items()]
    table = Table.of_rows("mismatch", f"Spectral mismatch, calibrated in {source} light", columns, rows)
    return "spectral sensitivity", properties, [table], []


def _light(source: str) -> str | SpectralTable:
    if Path(source).is_file():
        return read_spectral_file(source).only
    try:
        spectral_weights(source)
    except InputError as error:
        names = ", ".join(source_names())
        raise InputError(f"--source: {error}, or a CSV file; lights by name: {names}") from error
    return source
