"""Pictures: luminance, and CDP of regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
from numpy.typing import DTypeLike, NDArray
from xarray import Dataset

from ..calibration import AnyCalibration, Calibration, ColourCalibration
from ..core.disk.files import shown
from ..core.errors import InputError
from ..core.frame import ColourFilter
from ..core.luminance import LuminanceMap
from ..core.quantity import Quantity
from ..core.result import Finding, html_table, unique
from ..core.roi import Rectangle, Roi
from ..evaluate.picture.converter import Converter, make_converter
from ..evaluate.picture.neighbours import evaluate_neighbours
from ..evaluate.verdict import CDP_LIMIT
from ..files.picture import Picture
from ..files.read import read_picture
from ..files.transfer import Encoding
from ..metrics import Epsilon
from ..report.text import finding_text
from .arguments import (
    Contrasts,
    Pairs,
    PathArgument,
    Regions,
    Tolerance,
    as_contrasts,
    as_list,
    as_pairs,
    as_patches,
    as_path,
    as_rois,
)
from .image_regions import ImageRegions
from .variables import at_contrasts, cdp_variables, described, noted

if TYPE_CHECKING:
    from ..evaluate.chart.measure import MeasuredChart
    from ..evaluate.colour.measure import Colours
    from ..regions.chart import Corners


class StatedOfFrames(TypedDict, total=False):
    """Statements of the user about pictures or frames, which take precedence over those of their file."""

    exposure_s: float | None
    gain_db: float | None
    temperature_c: float | None
    bit_depth: int | None
    black_level_dn: float | None
    bayer: ColourFilter | None
    focal_length_m: float | None
    pixel_pitch_m: float | None
    no_vignetting: bool | None


class StatedOfVideo(StatedOfFrames, total=False):
    """Statements of the user about a video."""

    frame_rate_hz: float | None


class Stated(StatedOfFrames, total=False):
    """Statements of the user about a picture."""

    pixel_format: str | None
    size: tuple[int, int] | None


def read_image(
    path: PathArgument,
    *,
    calibration: PathArgument | AnyCalibration | None = None,
    camera_spec: PathArgument | None = None,
    encoding: Encoding | None = None,
    **stated: Unpack[Stated],
) -> Image:
    """Read a picture for evaluation.

    Without calibration and camera specification the values are relative luminance; contrasts of regions at different
    places then include the lens's vignetting, which is corrected as cos^4 where focal length and pixel pitch are
    known, and else part of their uncertainty.

    Parameters
    ----------
    path : path
        PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, a raw dump, or luminance that labcdp saved.
    calibration : path or Calibration
        For luminance in cd/m^2.
    camera_spec : path
        Camera specification (TOML), for luminance in cd/m^2 by guessed parameters.
    encoding : {'linear', 'srgb'}, str or Companding
        How values are encoded; of companded data the curve, or the name of one that ships with labcdp, such as
        ``AR0231``, or of a file in TOML. None for what the file states, or its kind suggests.
    exposure_s, gain_db, temperature_c, bit_depth
        Statements of the user about the picture, which take precedence over those of the file.
    black_level_dn, bayer
        DN of pixels without light, and colour filter of a sensor in a grey file by its first 2 x 2 pixels.
    focal_length_m, pixel_pitch_m, no_vignetting
        What decides the vignetting, where the file and the camera specification do not say it; whether there is none,
        as in simulated and corrected pictures.
    pixel_format, size
        GenICam pixel format, and width and height, of raw dumps.

    Returns
    -------
    Image

    Raises
    ------
    InputError
        If the file cannot be read, or an argument cannot be used.
    CalibrationError
        If the calibration is not for this picture.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> import labcdp
    >>> scene = np.repeat([[60, 120]], 40, axis=0).repeat(20, axis=1).astype(np.uint8)
    >>> written = cv2.imwrite("two.png", scene)
    >>> image = labcdp.read_image("two.png", encoding="linear")
    >>> image.luminance.shape
    (40, 40)
    """
    file = as_path(path, "the picture")
    converter = converter_of(calibration, camera_spec, encoding, stated, Stated)
    picture = read_picture(file, converter.options)
    return Image(picture, converter, converter.luminance(picture))


def converter_of(
    calibration: PathArgument | AnyCalibration | None,
    camera_spec: PathArgument | None,
    encoding: Encoding | None,
    stated: Mapping[str, Any],
    kind: Any,
) -> Converter:
    """Return the conversion to luminance that the arguments of `read_image` ask for.

    Raises
    ------
    InputError
        If an argument cannot be used.
    TypeError
        If something is stated that `kind`, one of the classes above, does not have: as Python does.
    """
    for name in stated.keys() - kind.__annotations__.keys():
        raise TypeError(f"unexpected keyword argument {name!r}: give some of {', '.join(kind.__annotations__)}")
    if calibration is not None and not isinstance(calibration, Calibration | ColourCalibration):
        calibration = as_path(calibration, "calibration")
    spec = None if camera_spec is None else as_path(camera_spec, "camera_spec")
    return make_converter(calibration, spec, encoding, **stated)


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """A picture as luminance; made by `labcdp.read_image`.

    Parameters
    ----------
    picture : Picture
        The file that was read.
    converter : Converter
        Conversion of its values to luminance.
    luminance : LuminanceMap
        Luminance of each pixel with uncertainty and flags; ``numpy.asarray(image.luminance)`` gives the values alone.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> import labcdp
    >>> written = cv2.imwrite("two.png", np.kron([[60, 120]], np.ones((40, 40))).astype(np.uint8))
    >>> image = labcdp.read_image("two.png", encoding="linear")
    >>> sky, road = labcdp.Roi.rectangle("sky", 45, 5, 30, 30), labcdp.Roi.rectangle("road", 5, 5, 30, 30)
    >>> round(float(image.regions([sky, road]).cdp(1.0)["cdp"][0]), 2)
    1.0
    """

    picture: Picture
    converter: Converter
    luminance: LuminanceMap

    @property
    def path(self) -> Path:
        """The file."""
        return self.picture.path

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.picture.shape

    @property
    def unit(self) -> str:
        """Unit of the luminance: ``cd/m^2``, or ``relative``."""
        return self.converter.unit_of(self.picture)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Notes, warnings and errors about the luminance."""
        return unique(self.converter.source(self.picture).findings)

    def regions(self, regions: Regions, pairs: Pairs | None = None) -> ImageRegions:
        """Choose regions.

        Parameters
        ----------
        regions : path, list of Roi, or dict
            A region file (JSON of ``labcdp rois``, ImageJ's .roi or .zip); regions; or by name (x, y, width, height)
            or an array of corners, in pixels.
        pairs : list of (str, str) or None
            Bright and dark region by name; None for all pairs of up to six regions.

        Raises
        ------
        InputError
            If a region lies outside the picture, or a pair names an unknown region.
        """
        height, width = self.shape
        rois = as_rois(regions, (width, height))
        chosen = as_pairs(rois, pairs)
        return ImageRegions(self.path.name, self.luminance, self.unit, self.attributes, rois, chosen, self._colours)

    def _colours(self) -> Colours:
        from ..evaluate.picture.colours import picture_colours

        return picture_colours(self.picture, self.converter)

    def chart(
        self,
        chart: PathArgument,
        contrasts: Contrasts | None = None,
        epsilon: Tolerance = 0.5,
        *,
        corners: Corners | None = None,
        regions: Regions | None = None,
        dark_surroundings: Image | None = None,
    ) -> MeasuredChart:
        """Measure a chart: all patches against all, and the dynamic range of the camera.

        Parameters
        ----------
        chart : path
            Chart file (``labcdp init chart``).
        contrasts : float, str, array_like of them, or None
            Contrasts to be detected; None for those of the chart's values.
        epsilon : float or DetectionInterval
            Their relative tolerance.
        corners : sequence of four (x, y), or None
            Corners of the chart in pixels: upper left, upper right, lower right, lower left.
        regions : path, list of Roi, dict, or None
            Regions with the names of its patches, in place of corners; without both the chart is found by its marks.
        dark_surroundings : Image or None
            Picture of the chart from the same place with dark surroundings, for the veiling glare by bright ones.

        Returns
        -------
        MeasuredChart
            With ``matrix``, a Dataset as of `labcdp.cdp_matrix`, and ``ranges``, the dynamic ranges.

        Raises
        ------
        InputError
            If the chart cannot be read, or is not found.
        """
        from ..evaluate.chart.chart_file import load_chart
        from ..evaluate.chart.measure import measure_chart
        from ..evaluate.picture.settings import ImageSettings

        request = as_contrasts(contrasts, epsilon)
        loaded, _ = load_chart(as_path(chart, "the chart"))
        height, width = self.shape
        rois = as_patches(loaded, corners, regions, (width, height))
        located = ImageSettings(chart=loaded, rois=rois).located(self.luminance)
        return measure_chart(
            self.luminance, self.unit, loaded, located.rois, request.values, request.epsilon, CDP_LIMIT,
            None if dark_surroundings is None else dark_surroundings.luminance,
        )  # fmt: skip

    def cdp_neighbours(
        self, contrasts: Contrasts | None = None, epsilon: Tolerance = 0.5, *, rectangle: Rectangle | None = None
    ) -> Dataset:
        """Compute the CDP of each pixel against its right and lower neighbour, for patterns one pixel wide.

        Parameters
        ----------
        contrasts : float, str, array_like of them, or None
            Contrasts to be detected, fractions or percentages such as "50%"; None for the measured contrast of the
            neighbours: mean of the brighter over mean of the darker pixels of all pairs, minus 1.
        epsilon : float or DetectionInterval
            Their relative tolerance.
        rectangle : (int, int, int, int) or None
            Two corner pixels x0, y0, x1, y1, both included; None for the whole picture.

        Returns
        -------
        xarray.Dataset
            Over contrast; without this dimension for a number or None.

        Raises
        ------
        InputError
            If an argument cannot be used.
        """
        request = as_contrasts(contrasts, epsilon)
        corners = None if rectangle is None else as_list(rectangle, "rectangle", "x0, y0, x1, y1")
        if corners is not None and len(corners) != 4:
            raise InputError(f"rectangle is {shown(rectangle)}: give x0, y0, x1, y1")
        measured = evaluate_neighbours(
            self.luminance, request.values, request.epsilon, None if corners is None else tuple(corners)
        )
        data = cdp_variables(("contrast",), list(measured.cdp) or (None,))
        dataset = Dataset(data, attrs=self.attributes(request.epsilon, measured.findings))
        return described(at_contrasts(dataset, request, measured.contrast.value))

    def sfr(self, regions: Regions) -> Dataset:
        """Measure the sharpness (spatial frequency response) at slanted edges.

        Parameters
        ----------
        regions : path, list of Roi, or dict
            Regions about one edge each, as for `regions`.

        Returns
        -------
        xarray.Dataset
            Over edge and frequency in cycles/pixel the response; over edge MTF50, MTF10, overshoot and place in the
            field, with standard uncertainties; see `labcdp.sfr` for a single edge. Edges that cannot be measured are
            left out, with a warning in its attributes.

        Raises
        ------
        InputError
            If a region lies outside the picture, or none has an edge that can be measured.

        Examples
        --------
        >>> import cv2
        >>> import numpy as np
        >>> import labcdp
        >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
        >>> written = cv2.imwrite("edge.png", (100 + 50 * np.tanh(distance)).round().astype(np.uint8))
        >>> response = labcdp.read_image("edge.png", encoding="linear").sfr({"middle": (0, 0, 60, 80)})
        >>> response["mtf50"].values.round(2).tolist()
        [0.22]
        """
        from ..evaluate.sharpness.measure import measure_sharpness, pixels_of_values
        from ..evaluate.sharpness.tables import sharpness_dataset

        height, width = self.shape
        pixels = pixels_of_values(self.picture, self.converter)
        measured = measure_sharpness(self.luminance, as_rois(regions, (width, height)), pixels=pixels)
        attributes = self.attributes(None, measured.findings) | {"title": "sharpness of a picture"}
        return described(sharpness_dataset(measured.edges, attributes))

    def flare(
        self,
        source: Regions,
        *,
        background: Image | None = None,
        illuminance_lx: Quantity | float | None = None,
        direct: Image | None = None,
        attenuation: Quantity | float = 1.0,
        block_px: int = 16,
    ) -> Dataset:
        """Measure the stray light that a source makes beside itself.

        Parameters
        ----------
        source : path, list of Roi, or dict
            Regions of the source, as for `regions`; they are left out.
        background : Image or None
            The same without the source, which is subtracted.
        illuminance_lx : Quantity, float or None
            Illuminance by the source at the camera, for light over that; needs cd/m^2.
        direct : Image or None
            The source itself at the same place, not saturated; its relative light is that of the same exposure.
        attenuation : Quantity or float
            Factor by which the direct picture is darker, by a filter or a shorter exposure of relative light.
        block_px : int
            Side of the blocks of the map in pixels.

        Returns
        -------
        xarray.Dataset
            Over y and x the map, over radius the profile, mean and worst place; with standard uncertainties.

        Raises
        ------
        InputError
            As `labcdp.flare`, or if a region lies outside the picture.

        Examples
        --------
        >>> import cv2
        >>> import numpy as np
        >>> import labcdp
        >>> y, x = np.mgrid[:120, :160]
        >>> light = np.minimum(200 / (1 + np.hypot(x - 79.5, y - 59.5) / 8) ** 2, 250)
        >>> written = cv2.imwrite("lamp.png", light.round().astype(np.uint8))
        >>> stray = labcdp.read_image("lamp.png", encoding="linear", black_level_dn=0).flare({"lamp": (60, 40, 40, 40)})
        >>> bool(stray["stray_light_worst"] > 5 * stray["stray_light"][0, 0])
        True
        """
        from ..evaluate.flare.tables import flare_dataset
        from ..metrics.stray_light import flare

        height, width = self.shape
        unit = self.unit.replace("^2", "²")
        lux, dims = (
            Quantity(float(value), 0.0) if isinstance(value, int | float) else value
            for value in (illuminance_lx, attenuation)
        )
        measured = flare(
            self.luminance, as_rois(source, (width, height)), unit=unit, illuminance_lx=lux,
            background=None if background is None else background.luminance,
            direct=None if direct is None else direct.luminance, attenuation=dims, block_px=block_px,
        )  # fmt: skip
        return described(flare_dataset(measured, unit, self.attributes(None) | {"title": "flare of a picture"}))

    def to_dataset(self) -> Dataset:
        """Return luminance, its standard uncertainty and flags over y and x."""
        luminance = self.luminance.luminance_cd_m2
        u = np.abs(luminance) * self.luminance.random_rel
        what_u = "standard uncertainty of the luminance that differs from pixel to pixel"
        what_invalid = "flags why a pixel is not valid, 0 where it is (labcdp.core.luminance.Invalid)"
        data = {
            "luminance": (("y", "x"), luminance, {"long_name": "luminance", "units": self.unit}),
            "u_luminance": (("y", "x"), u, {"long_name": what_u, "units": self.unit}),
            "invalid": (("y", "x"), self.luminance.invalid, {"long_name": what_invalid}),
        }
        return described(Dataset(data, attrs=self.attributes(None)))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the luminance."""
        return np.array(self.luminance.luminance_cd_m2, dtype=dtype)

    def __repr__(self) -> str:
        height, width = self.shape
        return f"<labcdp.Image {self.path.name}: {width} x {height} pixels, {self.unit}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        height, width = self.shape
        rows = [("pixels", f"{width} x {height}"), ("unit", self.unit), ("conversion", self.converter.description)]
        return html_table(
            ("", ""), [*rows, *((finding.severity, finding_text(finding)) for finding in self.findings)], self.path.name
        )

    def attributes(
        self, epsilon: Epsilon | None, findings: Sequence[Finding] = (), pairs: Sequence[tuple[Roi, Roi]] = ()
    ) -> dict[str, Any]:
        """Return the attributes of a dataset of this picture."""
        frame_findings = self.converter.with_pairs(self.findings, self.picture, self.luminance, pairs)
        all_findings = unique([*frame_findings, *findings])
        return {
            "title": "contrast detection probability of a picture" if epsilon is not None else "luminance of a picture",
            "file": str(self.path),
            "sha256": self.picture.sha256,
            "unit": self.unit,
            "conversion": self.converter.description,
            **({} if epsilon is None else {"epsilon": epsilon if isinstance(epsilon, int | float) else str(epsilon)}),
            **noted(all_findings),
            "labcdp_version": version("labcdp"),
        }
