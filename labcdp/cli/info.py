"""Command info: kind and content of a file or folder, and the commands that use it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..calibration import load_any
from ..calibration.emva.index import INDEX_NAME, load_index
from ..calibration.record import SavedFile, load_observations, load_verification
from ..chain import Chain
from ..core.clock import exposure_text
from ..core.disk.documents import read_json, read_toml
from ..core.disk.files import SESSION_JOURNAL, shell_word
from ..core.errors import InputError, LabcdpError, naming
from ..core.frame import Frame
from ..core.result import Finding, Result
from ..core.table import Column, Table
from ..drivers.simulated.devices import SimulatedBenchFile
from ..evaluate.chart.chart_file import load_chart
from ..evaluate.picture.camera_specification import CameraSpecification
from ..evaluate.sweep.maps.axes import check_map
from ..files.raw import PlaneClipping, planes_of
from ..files.read import picture_paths, read_picture
from ..files.transfer import encoding_name
from ..files.video.open import VIDEO_SUFFIXES, open_video
from ..output import LIST_FILE
from ..regions import load_regions, rois_of
from ..report.files import read_dataset
from ..report.text import finding_text
from ..session import Session, SessionConfiguration
from ..session.tables import MeterCertificate
from .info_results import (
    Description,
    describe_journal,
    describe_list,
    describe_page,
    describe_result,
)
from .info_tables import describe_spreadsheet, describe_table
from .terminal import print_result

#: Bits of DN up to which the end of the histogram is looked at.
_MOST_BITS_OF_HISTOGRAM = 16


def info(file: Path, *, source: str = "A") -> None:
    """Identify a file, and list its content and the commands that use it.

    For a camera's spectral sensitivity (CSV or .xlsx with wavelength_nm and R, G, B, or one column), compute f1' and
    the factors that correct luminances in other light.

    Parameters
    ----------
    file
        Anything that labcdp writes or reads: session, folder of results or a file in it, calibration, picture, video,
        region file, bench plan, chain, camera specification, meter readings, spectral sensitivity, EMVA 1288 data set.
    source
        For a spectral sensitivity: light of the calibration, a name, or a CSV file or .xlsx with its spectral power.
    """
    if not file.exists():
        raise InputError(f"{file} does not exist: give a file or folder")
    description = describe(file, source)
    properties = {"kind": description.kind, **description.properties}
    columns = (Column("property", "property", value="0"), Column("value", "value", value="1"))
    first = Table.of_items("properties", str(file), columns, properties.items())
    names = {"file": shell_word(file), "folder": shell_word(file if file.is_dir() else file.parent)}
    following = (f"Next: labcdp {command.format(**names)}" for command in description.commands)
    print_result(Result("info", str(file), (first, *description.tables)), *following)


def describe(path: Path, source: str) -> Description:
    """Try all kinds of file; a damaged file with the name of a kind raises the error of that kind.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, or is nothing labcdp knows.
    """
    if path.is_dir():
        return _folder(path)
    readers: dict[str, tuple[Callable[[Path], Description], ...]] = {
        ".csv": (partial(describe_table, source=source),),
        ".html": (describe_page,),
        ".jsonl": (_journal,),
        ".xlsx": (partial(describe_spreadsheet, source=source),),
        ".json": (_document,),
        ".toml": (_toml,),
        ".roi": (_regions,),
        ".zip": (_regions,),
        ".nc": (_netcdf,),
        ".txt": (_data_set,),
    }
    errors = []
    for read in readers.get(path.suffix.lower(), (_picture, _video)):
        try:
            return read(path)
        except LabcdpError as error:
            errors.append(error)
    raise errors[0]


def _folder(path: Path) -> Description:
    """Describe a session, a folder of results, a data set, or a folder of pictures or videos."""
    if (path / SESSION_JOURNAL).is_file():
        return _session(path)
    if (path / LIST_FILE).is_file():
        names = sorted(entry.name for entry in path.iterdir() if entry.name != LIST_FILE)
        return describe_list(path, "folder of results", names)
    if (path / INDEX_NAME).is_file():
        return _data_set(path)
    if any(entry.suffix.lower() in VIDEO_SUFFIXES for entry in path.iterdir()):
        return Description("folder of videos", ("video {file} --roi rois.json",))
    try:
        return _video(path)
    except LabcdpError:
        try:
            number = len(picture_paths([path]))
        except LabcdpError:
            raise InputError(f"{path} is not a session or a folder of results, pictures or videos") from None
    return Description("folder of pictures", ("image {file} --roi rois.json",), {"pictures": str(number)})


def _journal(path: Path) -> Description:
    if path.name != SESSION_JOURNAL:
        return describe_journal(path)
    return replace(_session(path.parent), kind="journal of a session")


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
    commands = ("calibrate {folder}", "evaluate {folder} --recalibrate", "characterise {folder}", "twin {folder}")
    return Description("session", commands, properties)


def _document(path: Path) -> Description:
    content = read_json(path, "a document of labcdp")
    if not isinstance(content, dict):
        raise InputError(f"{path} is not a labcdp document")
    match content.get("schema", content.get("format")):
        case "labcdp-result":
            return describe_result(path, content)
        case "labcdp-files" if path.name == LIST_FILE:
            return describe_list(path.parent, "list of the files of results")
        case "labcdp-calibration":
            return _calibration(path)
        case "labcdp-verification":
            verdict = load_verification(path).verdict
            return Description(
                "verification of a calibration", ("history {file}",), {"verdict": verdict, **_saved(path)}
            )
        case "labcdp-observations":
            sessions = load_observations(path)
            counts = {
                "sessions": str(len(sessions)),
                "observations of patches": str(sum(len(one.patches) for one in sessions)),
                "dark exposures": str(sum(len(one.darks) for one in sessions)),
            }
            return Description("observations kept beside a calibration", (), counts)
        case "labcdp regions":
            return _regions(path)
    raise InputError(f"{path} is not a labcdp document: its key schema or format names no known kind")


def _calibration(path: Path) -> Description:
    loaded = load_any(path)
    low, high = loaded.range_cd_m2
    commands = (
        "evaluate SESSION --calibration {file}",
        "verify {file} SESSION",
        "luminance {file} FRAME --output map.exr",
        "image PICTURE --calibration {file} --roi rois.json",
        "compare {file} OTHER",
    )
    properties = {
        "camera": str(loaded.state.camera),
        "lens": loaded.lens.model,
        "calibrated range": f"{low:.3g} to {high:.3g} cd/m²",
        "measured": f"{loaded.provenance.measured:%Y-%m-%d %H:%M}",
        **_saved(path),
    }
    return Description("calibration", commands, properties)


def _saved(path: Path) -> dict[str, str]:
    """Return the number on the certificate of a file, and its hash."""
    saved = SavedFile.of(path)
    return {"number": saved.number, "SHA-256 of the file": saved.sha256}


def _toml(path: Path) -> Description:
    """Describe a bench plan, a simulated bench, a chain, a chart or a camera specification."""
    content = read_toml(path, "a bench plan, chain or camera specification")
    if "plan" in content:
        plan = SessionConfiguration.load(path)
        properties = {"name": plan.name, "patches": ", ".join(patch.name for patch in plan.target.patches)}
        of_plan = ("acquire {file} my-session", "acquire {file} my-session --simulated")
        return Description("bench plan", of_plan, properties)
    if "scene" in content:
        properties = {"description": Chain.load(str(path)).description}
        commands = ("simulate {file}", "sweep {file} --over NAME=START:STOP:COUNT", "compare {file} manta-g505")
        return Description("imaging chain", commands, properties)
    if "patches" in content:
        chart, _ = load_chart(path)
        properties = {"name": chart.name, "patches": f"{len(chart.patches)}: {', '.join(chart.names)}"}
        properties |= {"values": chart.quantity if chart.is_stated else "not stated"}
        return Description("chart", ('image PICTURE --chart {file} --corners "X,Y X,Y X,Y X,Y"',), properties)
    if "emva1288" in content:
        return Description("EMVA 1288 data sheet", ("init chain my.toml --sensor {file}",))
    if "laboratory" in content:
        certificate = MeterCertificate.load(path)
        properties = {
            "number": certificate.number,
            "laboratory": certificate.laboratory,
            "date": f"{certificate.date}",
            "meter": " ".join(part for part in (certificate.model, certificate.serial) if part) or "not stated",
        }
        return Description("certificate of a meter", ("calibrate SESSION --certificate {file}",), properties)
    if content and content.keys() <= {"seed", "camera", "sensor", "meter"}:
        camera = SimulatedBenchFile.load(path).devices(path)
        properties = {"camera": f"{camera.vendor} {camera.model}"}
        return Description("simulated bench", ("acquire PLAN rehearsal --simulated-bench {file}",), properties)
    properties = {"name": CameraSpecification.load(path).name}
    return Description("camera specification", ("image PICTURE --camera-spec {file} --roi rois.json",), properties)


def _regions(path: Path) -> Description:
    names = [roi.name for roi in rois_of(load_regions(path))]
    commands = ("image PICTURE --roi {file}", "video VIDEO --roi {file}")
    return Description("region file", commands, {"regions": f"{len(names)}: {', '.join(names)}"})


def _netcdf(path: Path) -> Description:
    """Describe the map of a sweep, the results of a video, or the contrast map of an image."""
    dataset = read_dataset(path, "map")
    properties = {
        "title": str(dataset.attrs.get("title", "")),
        "axes": ", ".join(f"{name} ({size})" for name, size in dataset.sizes.items()),
        "variables": ", ".join(str(name) for name in dataset.data_vars),
    }
    if "frame" in dataset.sizes:
        return Description("results of a video", ("video VIDEO --roi rois.json --reference {file}",), properties)
    if "edge" in dataset.sizes:
        return Description("contrast map of an image", (), properties)
    with naming(f"{path} is not a map written by labcdp"):
        check_map(dataset)
    return Description("map of a sweep", ("compare {file} OTHER",), properties)


def _data_set(path: Path) -> Description:
    index = load_index(path)
    images = f"{index.width} x {index.height} pixels, {index.bits} bits, {len(index.blocks)} series"
    return Description("EMVA 1288 data set", ("characterise {file}",), {"release": index.release, "images": images})


def _picture(path: Path) -> Description:
    picture = read_picture(path)
    frame = picture.frame
    properties = {
        "size": "{1} x {0} pixels".format(*picture.shape),
        "values": "floats" if frame is None else f"{frame.bit_depth} bits, {frame.pixel_format}",
        "encoding": encoding_name(picture.encoding),
        "exposure": exposure_text(frame.exposure_s) if frame is not None and picture.exposure_known else "not stated",
        "camera": str(frame.camera) if frame is not None and picture.camera_stated else "not stated",
        **_notes(picture.findings),
    }
    has_histogram = frame is not None and not picture.coloured and frame.bit_depth <= _MOST_BITS_OF_HISTOGRAM
    tables = (_clipping(frame),) if frame is not None and has_histogram else ()
    commands = ("view {file}", "rois {file}", "image {file} --roi rois.json", "image-map {file}")
    return Description("picture", commands, properties, tables)


def _clipping(frame: Frame) -> Table:
    """Say for each colour of a Bayer filter, or all pixels, where the histogram ends."""
    columns = (
        Column("pixels", "pixels", meaning="Which of each 2 x 2, or all.", value="0"),
        Column("largest_dn", "largest", "DN", "Largest DN.", value="1.largest_dn"),
        Column("at_largest", "pixels there", "", "Number of pixels that have the largest DN.", value="1.at_largest"),
        Column("clipped_from_dn", "clipped from", "DN",
               "DN from which pixels pile up; empty if the histogram fades out.", value="1.pile.0"),
        Column("clipped_share", "share clipped", "%", "Share of the pixels from there on.", 2, value="1.share"),
    )  # fmt: skip
    names = ["all"]
    if frame.colour_filter is not None:
        names = [f"{column}, {row}" for row in ("upper", "lower") for column in ("left", "right")]
    black, white = frame.nominal_black_dn, frame.saturation_dn
    ends = (PlaneClipping.of(dn, black, white) for dn in planes_of(frame.dn, frame.colour_filter))
    return Table.of_items("clipping", "End of the histogram", columns, zip(names, ends, strict=True))


def _video(path: Path) -> Description:
    video = open_video(path)
    properties = {
        "size": "{1} x {0} pixels".format(*video.shape),
        "frames": "not stated" if video.frame_count is None else str(video.frame_count),
        "frame rate": "not stated" if video.frame_rate is None else f"{video.frame_rate:.6g} Hz",
        **_notes(video.findings),
    }
    return Description("video", ("rois {file} --frame 0", "video {file} --roi rois.json"), properties)


def _notes(findings: Sequence[Finding]) -> dict[str, str]:
    return {"notes": "; ".join(finding_text(finding) for finding in findings)} if findings else {}
