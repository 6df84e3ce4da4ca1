"""Options of pictures and videos: how values become luminance, what files may not state, and pairs of regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...core.disk import real_path
from ...core.disk.files import open_regular, shown
from ...core.errors import InputError
from ...core.frame import ColourFilter
from ...core.result import InputFile
from ...core.roi import Roi
from ...evaluate.picture.converter import Converter, make_converter
from ...files.kinds import HEAD_BYTES
from ...regions import ImageSize, read_region_file, rois_of
from ..commands import As
from ..options import Contrasts, Length, Require, Seconds, Temperature, Tolerance, require_apart
from ..terminal import say
from ..values import parse_corners, parse_pair, parse_size

if TYPE_CHECKING:
    from ...regions.chart import Chart


@dataclass(frozen=True)
class LightOptions:
    """Options of pictures and videos: the conversion to luminance, and what files may not state.

    Parameters
    ----------
    calibration
        Calibration file, for values in cd/m². Without it and --camera-spec, luminance is relative.
    camera_spec
        Camera specification (TOML, see labcdp init camera), for estimated values in cd/m².
    encoding
        Encoding of the pixel values: linear, srgb, or for companded data the curve of the sensor, by its name (AR0231,
        AR0820, OX03C10) or a file in TOML; default: as stated by the camera specification or the file, else assumed by
        the values, with a warning.
    exposure
        Exposure time, for example 5ms; default: as stated by each file.
    gain_db
        Gain in dB; default: as stated by each file, else 0.
    temperature
        Temperature of the camera in degrees Celsius, for example 31.5; default: as stated by each file. Without it, the
        dark signal of a calibration is less certain.
    bit_depth
        Bit depth of the values in 16-bit files, for example 12, or in 32-bit files, 17 to 24; default: estimated.
    black_level
        DN of pixels without light; default: as stated by each file, else 0.
    bayer
        Colour filter of a sensor in grey files, by the first 2 x 2 pixels; default: as stated by each file, else none.
    focal_length
        Focal length of the lens, for example 6mm; with the pixel pitch, the vignetting is taken as cos⁴ and corrected;
        default: as stated by file or camera specification.
    pixel_pitch
        Distance of the pixels on the sensor, for example 3.45um; default: as stated by file or camera specification.
    no_vignetting
        Take the pictures as without vignetting: simulated or corrected ones.
    """

    calibration: Path | None = None
    camera_spec: Path | None = None
    encoding: str | None = None
    exposure: Seconds | None = None
    gain_db: float | None = None
    temperature: Temperature | None = None
    bit_depth: Annotated[int | None, As(least=1, most=24)] = None
    black_level: Annotated[float | None, As(least=0)] = None
    bayer: ColourFilter | None = None
    focal_length: Length | None = None
    pixel_pitch: Length | None = None
    no_vignetting: bool = False

    def converter(self) -> Converter:
        """Load calibration or camera specification; raises InputError."""
        return make_converter(self.calibration, self.camera_spec, self.encoding, **self.stated())

    def stated(self) -> dict[str, Any]:
        """Return what is given about the files, None for what is not."""
        return {
            "exposure_s": self.exposure,
            "gain_db": self.gain_db,
            "temperature_c": self.temperature,
            "bit_depth": self.bit_depth,
            "black_level_dn": self.black_level,
            "bayer": self.bayer,
            "focal_length_m": self.focal_length,
            "pixel_pitch_m": self.pixel_pitch,
            "no_vignetting": self.no_vignetting or None,
        }

    def inputs(self) -> list[InputFile]:
        """Return records of calibration and camera specification; raises InputError if one cannot be read."""
        is_file = self.encoding is not None and self.encoding.lower().endswith(".toml")
        curve = Path(self.encoding) if self.encoding is not None and is_file else None
        files = {"calibration": self.calibration, "camera specification": self.camera_spec, "curve": curve}
        return [InputFile.of(role, path) for role, path in files.items() if path is not None]


@dataclass(frozen=True)
class PictureLightOptions(LightOptions):
    """The same, and the layout of raw dumps.

    Parameters
    ----------
    pixel_format
        GenICam pixel format of raw dumps, for example Mono12Packed; needs --size.
    size
        Width and height of raw dumps, for example 2464x2056.
    """

    pixel_format: str | None = None
    size: Annotated[tuple[int, int] | None, As(parse=parse_size)] = None

    def stated(self) -> dict[str, Any]:
        """Return what is given about the files, None for what is not."""
        return {**super().stated(), "pixel_format": self.pixel_format, "size": self.size}


@dataclass(frozen=True)
class PairOptions:
    """Options of pictures and videos: regions, their pairs, and the target contrasts.

    Parameters
    ----------
    roi
        Region file (for a video: of its first frame): .json from labcdp rois, or .roi or .zip from ImageJ.
    contrast
        Target contrasts: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log] such as 10%:200%:20. May
        be repeated; default: the measured contrast of each pair (for a video: in its first frame).
    epsilon
        Relative tolerance of the contrast; default: 50%.
    cdp_limit
        CDP from which a contrast counts as detected; default: 0.9.
    pair : BRIGHT:DARK
        Names of two regions, the brighter one first; may be repeated. Default: all pairs of up to 6 regions of a
        picture, the only pair of a video.
    neighbours
        Compute the nearest-neighbour CDP: each pixel and its neighbours, for patterns 1 pixel wide.
    """

    roi: Path | None = None
    contrast: Contrasts = None
    epsilon: Tolerance | None = None
    cdp_limit: Annotated[float | None, As(least=0, most=1)] = None
    require: Require = None
    pair: tuple[str, ...] = ()
    neighbours: bool = False

    def targets(self) -> dict[str, Any]:
        """Return contrasts, tolerance, limit and requirement of settings, as far as given; raises InputError."""
        given = {"--contrast": self.contrast, "--epsilon": self.epsilon, "--cdp-limit": self.cdp_limit}
        require_apart({"--require": self.require}, given)
        targets: dict[str, Any] = {"contrasts": self.contrast, "epsilon": self.epsilon, "cdp_limit": self.cdp_limit}
        if self.require is not None:
            # Sessions, whose files have the same fields, are needed for it alone.
            from ...evaluate.requirement import Requirement

            required = Requirement.load(self.require)
            targets = {"contrasts": (required.contrast,), "epsilon": required.epsilon, "cdp_limit": required.cdp_limit}
            targets["requirement"] = required
        return {name: value for name, value in targets.items() if value is not None}


def read_regions(options: PairOptions) -> tuple[tuple[Roi, ...], ImageSize | None, list[InputFile]]:
    """Read the region file; nothing for nearest-neighbour CDP alone.

    Returns
    -------
    (tuple of Roi, (int, int) or None, list of InputFile)
        The regions, the size of the image they were drawn on, and the record of the file.

    Raises
    ------
    InputError
        If there is no region file where one is needed, or it cannot be read.
    """
    if options.roi is None:
        if not options.neighbours:
            raise InputError("no regions: add --roi with a region file (see labcdp rois), or --neighbours")
        if options.pair:
            raise InputError("--pair names regions: give their file with --roi")
        return (), None, []
    shapes, image_size, file = read_region_file(options.roi)
    return rois_of(shapes), image_size, [file]


@dataclass(frozen=True)
class ChartOptions(PairOptions):
    """The same, and a chart.

    Parameters
    ----------
    chart
        Chart file (TOML, see labcdp init chart): all its patches against all, and the dynamic range of the camera. Its
        patches are found by its marks, by --corners, or are the regions of --roi with their names (for a video: in its
        first frame).
    corners : "X,Y X,Y X,Y X,Y"
        Corners of the chart in pixels: upper left, upper right, lower right, lower left, as the chart is read.
    """

    chart: Path | None = None
    corners: Annotated[tuple[tuple[float, float], ...] | None, As(parse=parse_corners)] = None


def read_chart(options: ChartOptions) -> tuple[Chart, tuple[Roi, ...], ImageSize | None, list[InputFile]]:
    """Read the chart file, and where its patches are as far as that is given.

    Returns
    -------
    (Chart, tuple of Roi, (int, int) or None, list of InputFile)
        The chart, its patches in their order or none, the size of the image they were drawn on, and the records of the
        files.

    Raises
    ------
    InputError
        If a file cannot be read, or a patch has no region.
    """
    from ...evaluate.chart.chart_file import load_chart

    assert options.chart is not None
    require_apart({"--corners": options.corners}, {"--roi": options.roi})
    chart, chart_files = load_chart(options.chart)
    if options.roi is None:
        rois = chart.regions(options.corners) if options.corners is not None else ()
        return chart, rois, None, chart_files
    drawn, image_size, files = read_regions(options)
    named = {roi.name: roi for roi in drawn}
    missing = [name for name in chart.names if name not in named]
    if missing:
        raise InputError(f"--roi {options.roi} has no region {shown(missing[0])}: draw one for each patch of the chart")
    return chart, tuple(named[name] for name in chart.names), image_size, files + chart_files


def parse_pairs(options: PairOptions, names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return the pairs that are given, each once; raises InputError."""
    return tuple(dict.fromkeys(parse_pair(pair, names) for pair in options.pair))


def require_kind(files: Sequence[Path], other: Callable[[Path, bytes], InputError | None]) -> None:
    """Refuse files that are all of another command, whatever else is wrong: `other` returns the error of one."""
    errors = [other(path, _head(path)) if path.is_file() else None for path in files]
    if errors and errors[0] is not None and None not in errors:
        raise errors[0]


def _head(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read(HEAD_BYTES)
    except OSError:
        # Reported when it is read.
        return b""


def each_once(paths: Sequence[Path], what: str = "file") -> list[Path]:
    """Return the paths without those of the same file as another one, and say so."""
    files: dict[Path, Path] = {}
    for path in paths:
        first = files.setdefault(real_path(path), path)
        if first is not path:
            say(f"Note: {path} is the same {what} as {first} and is evaluated once")
    return list(files.values())
