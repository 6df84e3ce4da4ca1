"""What the numbers of a video file are: grey, or Y', Cb and Cr, or red, green and blue; and what they mean."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from math import nan
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.companding import Companding
from ...core.dn import look_up
from ...core.errors import InputError
from ...core.luminance import WHOLE, Window
from ...core.result import Finding, info, warning
from ..doubts import encodings, histogram_of
from ..frame import Scale
from ..statements import NOTHING_STATED, FileStatements, stated_by_gamma, stated_by_profile
from ..stored_image import (
    grey_finding,
    grey_if_colourless,
    luminance_dn,
    orientation_of_matrix,
    upright,
)
from ..transfer import (
    BT709_LUMINANCE,
    ENCODING_OF_CODE,
    PRIMARIES_OF_CODE,
    UNSPECIFIED,
    Encoding,
    Weights,
    encoding_name,
    light_tables,
    luminance_weights,
)
from .quantiser import faint_dn, is_lossless

#: Weights of R' and B' in Y' by matrix coefficients (ITU-T H.273, table 4).
_BT601, _BT709 = (0.299, 0.114), (0.2126, 0.0722)
_MATRICES = {1: _BT709, 4: (0.3, 0.11), 5: _BT601, 6: _BT601, 7: (0.212, 0.087), 9: (0.2627, 0.0593)}
#: Matrix coefficients of colours that are no Y', Cb and Cr of R', G' and B' (the same table): YCgCo and its reversible
#: forms, Y'D'zD'x, constant luminance, ICtCp and IPT-C2.
_OTHER_MATRICES = frozenset({8, 10, 11, 13, 14, 15, 16, 17})
#: Code of the matrix that follows from the primaries (ITU-T H.273, 8.3).
_OF_PRIMARIES = 12
#: FFmpeg's codes of the range.
_LIMITED, _FULL = 1, 2
#: Rows from which Y' without a stated matrix is that of HDTV.
_HD_ROWS = 720
#: Cb and Cr of grey differ by no more from the middle, in steps of 8 bits.
_COLOURED = 1
#: Later frames in colours from which the others are too.
_LEAST_COLOURED = 2
#: Bits more that red, green and blue have than the Y', Cb and Cr that they follow from.
_FINER_BITS = 4
_SUBSAMPLING = {(1, 1): "444", (2, 1): "422", (2, 2): "420", (4, 1): "411", (4, 4): "410", (1, 2): "440"}


@dataclass(frozen=True)
class Pixels:
    """What the numbers of a file are.

    Parameters
    ----------
    format_name : str
        FFmpeg's pixel format of the first frame.
    kind : {'luma', 'ycbcr', 'rgb'}
        What counts: grey or Y' alone, or the luminance of the colours.
    bits : int
        Of each number.
    limited : bool
        Whether Y' goes from 16 to 235 of 8 bits.
    weights : (float, float)
        Of red and blue in Y'.
    stored : str
        How grey or colours are encoded.
    orientation : int
        EXIF's number of how the frames lie in the file.
    faint_dn : float
        Contrast, standard deviation in DN of 8 bits, below which the codec may not show where a thing is: see
        `labcdp.tracking.make_tracker`; 0 if it changed no number.
    of_light : (float, float, float)
        Weights of linear red, green and blue in luminance.
    other_encoding : str or None
        How grey or colours may be encoded as well, where the file does not state it; None if it does.
    scale : Scale or None
        Of red, green and blue of 16 bits; None if it is that of `bits`.
    """

    format_name: str
    kind: Literal["luma", "ycbcr", "rgb"]
    bits: int
    limited: bool
    weights: tuple[float, float]
    stored: Encoding
    orientation: int
    faint_dn: float
    of_light: Weights = BT709_LUMINANCE
    other_encoding: Encoding | None = None
    scale: Scale | None = None

    @property
    def encoding(self) -> Encoding:
        """Encoding of the DN of frames: luminance of colours is linear."""
        return self.stored if self.kind == "luma" else "linear"

    @property
    def levels(self) -> tuple[float, float, float]:
        """Stored Y' of black, full-range Y' of 8 bits for each step of it, and the contrast of what is faint.

        Steps of nan for more bits without a loss: of these the noise decides. A codec's errors are those of 8 bits for
        all.
        """
        unit = 2 ** (self.bits - 8)
        black, steps = (16.0 * unit, 219.0 * unit) if self.limited else (0.0, 2.0**self.bits - 1)
        return black, 255 / steps if self.bits == 8 or self.faint_dn else nan, self.faint_dn

    def planes(self, frame: Any) -> tuple[NDArray[Any], ...]:
        """Numbers of a decoded frame as they are stored.

        Raises
        ------
        InputError
            If it is of another kind than the first one.
        """
        if frame.format.name != self.format_name:
            raise InputError(f"its pixels are of the kind {frame.format.name}, not {self.format_name} as before")
        planes = tuple(planes_of(frame))
        if self.kind == "luma" and _kind(frame.format) == "rgb" and grey_if_colourless(np.dstack(planes)).ndim == 3:
            raise InputError("it is coloured, unlike the frames examined before: evaluate it in a separate video")
        return planes

    def followed(self, planes: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Grey or Y' as it is stored, or Y' of red, green and blue: what trackers look at."""
        import cv2

        rgb = self.kind == "rgb"
        return upright(cv2.cvtColor(np.dstack(planes), cv2.COLOR_RGB2GRAY) if rgb else planes[0], self.orientation)

    def luma(self, stored: NDArray[Any]) -> NDArray[Any]:
        """Full-range Y' of what is stored of it."""
        if self.limited:
            stored = look_up(self._full_range, stored)
        return upright(np.ascontiguousarray(stored), self.orientation)

    def luminance(
        self, planes: Sequence[NDArray[Any]], window: Window = WHOLE
    ) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
        """Luminance of colours, and which pixels have one at its end; of Y', Cb and Cr also of a window as stored."""
        if self.kind == "rgb":
            rgb, scale = np.dstack(planes), self.scale or Scale(self.bits, 2.0**self.bits - 1)
            luminance = luminance_dn(rgb, scale.bits, self.stored, self.of_light)
            clipped = np.any(rgb >= scale.saturation_dn, axis=2)
        else:
            luminance, clipped = self._of_ycbcr(planes, window)
        return upright(luminance, self.orientation), upright(clipped, self.orientation)

    def colours(
        self, planes: Sequence[NDArray[Any]], window: Window = WHOLE
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Linear red, green and blue of colours from 0 to 1, shape (height, width, 3), and which pixels are saturated.

        Of Y', Cb and Cr a window as stored, else of the upright frame.
        """
        in_part = self.kind == "ycbcr" and self.orientation == 1
        # Light of a single colour is luminance with all of the weight on it.
        single = (replace(self, of_light=(float(r), float(g), float(b))) for r, g, b in np.eye(3))
        lights, clipped = zip(*(plane.luminance(planes, window if in_part else WHOLE) for plane in single), strict=True)
        values = np.stack(lights, axis=-1) * np.float32(1 / 65535)
        inside = WHOLE if in_part else window
        return values[inside], np.any(clipped, axis=0)[inside]

    def _of_ycbcr(self, planes: Sequence[NDArray[Any]], window: Window) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
        from .colour_kernel import luminance_of_ycbcr

        # Groups of pixels with one Cb and Cr are converted together.
        height, width = planes[0].shape
        down, across = -(-height // planes[1].shape[0]), -(-width // planes[1].shape[1])
        rows, columns = range(height)[window[0]], range(width)[window[1]]
        top, left = rows.start // down, columns.start // across
        of_colour = np.s_[top : -(-rows.stop // down), left : -(-columns.stop // across)]
        luma = planes[0][top * down : rows.stop, left * across : columns.stop]
        # Copies are of one kind, whether the decoder's memory is read-only or not: there is one kernel to compile.
        luma, blue, red = (plane.copy() for plane in (luma, planes[1][of_colour], planes[2][of_colour]))
        light = light_tables(self._colour_bits, self.stored, self.of_light)
        luminance, clipped = luminance_of_ycbcr(luma, blue, red, (down, across), self._parts, light, self._clips_from)
        inner = np.s_[rows.start - top * down :, columns.start - left * across :]
        return luminance[inner], clipped[inner]

    @cached_property
    def _full_range(self) -> NDArray[Any]:
        """Full-range Y' of each stored value, as integers."""
        dtype = np.uint8 if self.bits == 8 else np.uint16
        return np.asarray(np.rint(self._grey.clip(0, 2**self.bits - 1)), dtype)

    @cached_property
    def _grey(self) -> NDArray[np.float64]:
        """Full-range Y' of each stored value (ITU-R BT.601 and BT.709: 16 to 235 of 8 bits)."""
        values = np.arange(2**self.bits, dtype=float)
        return (values / 2 ** (self.bits - 8) - 16) * (2**self.bits - 1) / 219 if self.limited else values

    @property
    def _colour_bits(self) -> int:
        """Bits of red, green and blue that follow from Y', Cb and Cr: rounded to `bits`, dark ones were off by 14 %."""
        return self.bits if isinstance(self.stored, Companding) else min(self.bits + _FINER_BITS, 16)

    @property
    def _colour_step(self) -> float:
        """Steps of red, green and blue for each of Y'."""
        return float((2**self._colour_bits - 1) / (2**self.bits - 1))

    @property
    def _clips_from(self) -> int:
        """Value of a colour from which it would be the highest one of `bits`."""
        return int((2**self.bits - 1.5) * self._colour_step + 0.5)

    @cached_property
    def _parts(self) -> NDArray[np.float32]:
        """Y' by value, and what Cr adds to red and green, Cb to green and blue (ITU-T H.273, 8.3)."""
        k_r, k_b = self.weights
        k_g = 1 - k_r - k_b
        chroma = np.arange(2**self.bits, dtype=float) - 2 ** (self.bits - 1)
        if self.limited:
            chroma *= (2**self.bits - 1) / (224 * 2 ** (self.bits - 8))
        red, blue = 2 * (1 - k_r) * chroma, 2 * (1 - k_b) * chroma
        parts = np.array([self._grey, red, -k_r / k_g * red, -k_b / k_g * blue, blue])
        return (parts * self._colour_step).astype(np.float32)


def _matrix(frame: Any, coloured: bool) -> tuple[float, float] | None:
    """Weights of R' and B' in Y' that a file states."""
    code, primaries = int(frame.colorspace), PRIMARIES_OF_CODE.get(int(frame.color_primaries))
    if coloured and code in _OTHER_MATRICES:
        raise InputError(
            f"states matrix coefficients {code} of ITU-T H.273, which labcdp does not read: convert it to those of "
            "BT.709 (ffmpeg -i IN -vf scale=out_color_matrix=bt709 -c:v ffv1 OUT.mkv)"
        )
    of_light = luminance_weights(primaries) if primaries and code == _OF_PRIMARIES else None
    if of_light:
        return of_light[0], of_light[2]
    return _MATRICES.get(code)


def learn_pixels(
    frames: Sequence[Any], later: Iterable[Any], context: Any, encoding: Encoding | None, of_sensor: bool = False
) -> tuple[Pixels, list[Finding]]:
    """Learn what the numbers of a file are from its first frames, and what there is to say about it.

    Whether they are colours, later frames tell too, of which none is taken where the first ones tell it.

    Range, transfer and matrix are as stated. Where they are not, the range is full for grey, Motion JPEG and colours,
    else limited; the transfer that of sRGB as for pictures, but for grey values that no codec changed, whatever pixel
    format they are in, what their histogram looks like, or linear if they are known to be `of_sensor`; the matrix that
    of BT.601 for JPEG and less than 720 rows, else that of BT.709.

    Raises
    ------
    InputError
        If they are interlaced, or of a kind or a matrix that is not read.
    """
    first = frames[0]
    if any(frame.interlaced_frame for frame in frames):
        raise InputError("is interlaced, each frame holds two moments: deinterlace it (ffmpeg -i IN -vf bwdif OUT)")
    codec, lossless = context.codec, is_lossless(frames, context.codec, context.profile)
    planes, kind, jpeg = planes_of(first), _kind(first.format), codec.name == "mjpeg"
    grey = len(planes) == 1
    bits = bits_of(first.format)
    coloured = any(_is_coloured(planes_of(frame), kind, bits) for frame in frames)
    if not (coloured or grey):
        alike = (frame for frame in later if frame.format.name == first.format.name)
        in_colours = (frame for frame in alike if _is_coloured(planes_of(frame), kind, bits))
        # A damaged frame may show false colours.
        coloured = len([*islice(in_colours, _LEAST_COLOURED)]) == _LEAST_COLOURED
    limited, range_stated = kind != "rgb" and not (grey or jpeg), first.color_range in (_LIMITED, _FULL)
    if range_stated and kind != "rgb":
        limited = first.color_range == _LIMITED
    # FFmpeg calls all values of TIFF gamma 2.2, which it does not read from the file.
    code = UNSPECIFIED if codec.name == "tiff" else int(first.color_trc)
    of_frame = _stated_by_frame(first, coloured) if code == UNSPECIFIED else NOTHING_STATED
    usual: Encoding = "srgb"
    other: Encoding | None = "linear" if lossless and coloured and kind == "rgb" else None
    if lossless and not coloured and of_sensor:
        usual = "linear"
    elif lossless and not coloured:
        usual, other = encodings(histogram_of(planes[0]), 2.0**bits - 1, bits, coloured)
    stored, findings = _encoding(code, of_frame, usual, encoding)
    is_usual = code == UNSPECIFIED and of_frame.encoding is None and encoding is None
    primaries = int(first.color_primaries)
    of_light = luminance_weights(PRIMARIES_OF_CODE[primaries]) if primaries in PRIMARIES_OF_CODE else None
    if coloured and of_light is None and primaries != UNSPECIFIED:
        findings.append(warning("primaries-code-unknown", code=primaries))
    of_light = of_light or of_frame.weights
    matrix = _matrix(first, coloured and kind != "rgb")
    weights = matrix or (_BT601 if jpeg or first.height < _HD_ROWS else _BT709)
    orientation = _orientation(first)
    if orientation is None:
        findings.append(warning("turn-ignored"))
    elif orientation > 1:
        findings.append(info("turned", orientation=orientation))
    if limited:
        findings.append(info("video-limited-range", how=_how(range_stated)))
    if coloured and kind != "rgb":
        findings.append(info("video-matrix", red=weights[0], blue=weights[1], how=_how(matrix is not None)))
    if coloured:
        findings.append(grey_finding(stored, of_light))
    if kind == "rgb" and first.color_range == _LIMITED:
        findings.append(warning("video-rgb-range"))
    seen = kind if coloured else "luma"
    faint = 0.0 if lossless else faint_dn(frames, codec, bits)
    learnt = Pixels(
        first.format.name, seen, bits, limited, weights, stored, orientation or 1, faint, of_light,
        other if is_usual else None,
    )  # fmt: skip
    return learnt, findings


#: What container and stream may both state, the name of FFmpeg's field, and what codes mean that differ without effect.
_STATED: dict[str, tuple[str, dict[int, Any]]] = {
    "range": ("color_range", {}), "transfer": ("color_trc", ENCODING_OF_CODE),
    "primaries": ("color_primaries", PRIMARIES_OF_CODE), "matrix": ("colorspace", _MATRICES),
}  # fmt: skip


def stated_by(subject: Any) -> dict[str, int]:
    """Return what a codec's context before the first frame, or a frame, states of its colours."""
    values = {what: int(getattr(subject, name)) for what, (name, _) in _STATED.items()}
    # Of the range, FFmpeg says nothing by 0, of the others by H.273's 2; 0 is the matrix of red, green and blue.
    return {what: code for what, code in values.items() if code != (0 if what == "range" else UNSPECIFIED)}


def statement_findings(by_container: dict[str, int], by_stream: dict[str, int], coloured: bool) -> list[Finding]:
    """Say where a stream contradicts its container: FFmpeg and browsers follow the stream.

    ISO/IEC 14496-12, 12.1.5, gives precedence to the container's box colr, which few programs do.
    """
    names = []
    for what in _STATED if coloured else ("range", "transfer"):
        codes = [stated[what] for stated in (by_container, by_stream) if what in stated]
        if len({_STATED[what][1].get(code, code) for code in codes}) > 1:
            names.append(f"{what} {codes[0]} and {codes[1]}")
    return [warning("video-statements-differ", names=", ".join(names))] if names else []


#: EXIF orientations by the display rotation in degrees, counter-clockwise.
_OF_ROTATION = {0: 1, 90: 8, -90: 6, 180: 3, -180: 3}


def _orientation(frame: Any) -> int | None:
    """EXIF's number of how a frame lies in the file; None if that is no multiple of 90 degrees."""
    try:
        matrix = frame.side_data.get("DISPLAYMATRIX")
    # PyAV reads nothing of what comes with a frame if it does not know all of it, such as EXIF: mirroring is lost.
    except ValueError:
        return _OF_ROTATION.get(frame.rotation)
    return 1 if matrix is None else orientation_of_matrix(bytes(matrix))


def _stated_by_frame(frame: Any, coloured: bool) -> FileStatements:
    """Return what frames of Motion JPEG or PNG state themselves: a profile or an exponent."""
    try:
        profile = frame.side_data.get("ICC_PROFILE")
    # PyAV reads nothing of what comes with a frame if it does not know all of it, such as EXIF.
    except ValueError:
        profile = None
    if profile is not None:
        stated = stated_by_profile(bytes(profile), coloured, 8)
        unused = warning("icc-profile-not-used", reason="labcdp cannot decode its curve in videos")
        return stated if stated.light_table is None else replace(stated, findings=(*stated.findings, unused))
    value, _, unit = getattr(frame, "metadata", {}).get("gamma", "").partition("/")
    if not (value.isdecimal() and unit.isdecimal()):
        return NOTHING_STATED
    return stated_by_gamma(int(unit) / int(value) if int(value) else None, "the gAMA of its frames")


def _encoding(
    code: int, of_frame: FileStatements, usual: Encoding, given: Encoding | None
) -> tuple[Encoding, list[Finding]]:
    """Return the encoding as given, as stated, or as is usual, and findings that say so."""
    stated = ENCODING_OF_CODE.get(code) or of_frame.encoding
    encoding = given or stated or usual
    how = "as given" if given else _how(stated is not None)
    findings = [info("video-encoding", encoding=encoding_name(encoding), how=how), *of_frame.findings]
    if given and stated not in (None, given):
        findings.append(warning("encoding-replaced", given=encoding_name(given), by="the file"))
    if not given and stated is None and code != UNSPECIFIED:
        findings.append(warning("video-transfer-unknown", code=code, encoding=encoding_name(encoding)))
    if encoding in ("pq", "hlg"):
        findings.append(info(f"encoding-{encoding}"))
    return encoding, findings


def _how(stated: bool) -> str:
    return "as the file states" if stated else "which is usual; the file does not state it"


def _is_coloured(planes: Sequence[NDArray[Any]], kind: str, bits: int) -> bool:
    if len(planes) == 1:
        return False
    if kind == "rgb":
        return grey_if_colourless(np.dstack(planes)).ndim == 3
    away = _COLOURED << (bits - 8)
    middle = 2 ** (bits - 1)
    return any(int(plane.max()) > middle + away or int(plane.min()) < middle - away for plane in planes[1:])


def _kind(form: Any) -> Literal["ycbcr", "rgb"]:
    return "rgb" if form.is_rgb or form.has_palette else "ycbcr"


def bits_of(form: Any) -> int:
    """Bits of each number of a pixel format."""
    return int(max(component.bits for component in form.components))


def planes_of(frame: Any) -> list[NDArray[Any]]:
    """Grey; Y', Cb and Cr; or red, green and blue of a decoded frame, as they are stored.

    Raises
    ------
    InputError
        If the pixels are of another kind.
    """
    form = frame.format
    bits, n_values = bits_of(form), sum(not component.is_alpha for component in form.components)
    across = -(-frame.width // max(form.chroma_width(frame.width), 1))
    down = -(-frame.height // max(form.chroma_height(frame.height), 1))
    if not 8 <= bits <= 16 or form.is_bayer or form.is_bit_stream or form.name.startswith("xyz"):
        raise InputError(f"has pixels of the kind {form.name}, which are not read: convert it to FFV1")
    depth = "" if bits == 8 else f"{bits}le"
    order: tuple[int, ...] = (0, 1, 2)
    if _kind(form) == "rgb":
        name, order = f"gbrp{depth}", (2, 0, 1)
    elif n_values == 1:
        name, order = f"gray{depth}", (0,)
    else:
        name, order = f"yuv{_SUBSAMPLING.get((across, down), '')}p{depth}", order
    # Values stay as they are, they only come in another order.
    if form.name.replace("yuvj", "yuv").replace("yuva", "yuv") != name:
        frame = frame.reformat(format=name)
    return [_plane(frame.planes[at], np.dtype("<u2" if depth else "u1")) for at in order]


def _plane(plane: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    rows = np.frombuffer(memoryview(plane).toreadonly(), dtype)
    return rows.reshape(-1, plane.line_size // dtype.itemsize)[: plane.height, : plane.width]
