"""Sharpness of a picture: the response at each edge, its place in the field, and the MTF of the lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot

from ...core.errors import InputError
from ...core.frame import luminance_pixels, plane_positions
from ...core.luminance import LuminanceMap
from ...core.result import Finding, error, info, unique, warning
from ...core.roi import Roi
from ...files.picture import Picture
from ...metrics.slanted_edge import EdgeSfr, Sfr, lens_mtf, mean_sfr, sfr
from ..picture.converter import Converter

#: Excess over both sides of an edge from which a picture counts as sharpened.
_SHARPENED = 0.05


@dataclass(frozen=True, eq=False)
class FieldEdge:
    """An edge in the field of a camera.

    Parameters
    ----------
    roi : Roi
        Region about it.
    sfr : EdgeSfr
        Its response.
    x_px, y_px : float
        Middle of the edge, in pixels of the image.
    distance_px : float
        Its distance from the middle of the image, where the axis of the lens is taken to be.
    field : float
        The same over half the diagonal of the image.
    picture : str
        Name of the picture, where there are several.
    """

    roi: Roi
    sfr: EdgeSfr
    x_px: float
    y_px: float
    distance_px: float
    field: float
    picture: str = ""

    @property
    def name(self) -> str:
        """Name of the region, with that of the picture where there are several."""
        return f"{self.roi.name}, {self.picture}" if self.picture else self.roi.name


@dataclass(frozen=True, eq=False)
class MeanOfEdges:
    """Mean of some of the edges.

    Parameters
    ----------
    name : str
        Which ones.
    n_edges : int
        Their number.
    sfr : Sfr
        Their mean, with the uncertainty by their scatter.
    """

    name: str
    n_edges: int
    sfr: Sfr


@dataclass(frozen=True, eq=False)
class MeasuredSharpness:
    """Sharpness of a picture, or of several with the same edges.

    Parameters
    ----------
    edges : tuple of FieldEdge
        At least one, in the order of the pictures and of the regions.
    pixel_pitch_m : float or None
        Distance of the pixels on the sensor, where it is known.
    findings : tuple of Finding
        Findings about the edges.
    """

    edges: tuple[FieldEdge, ...]
    pixel_pitch_m: float | None
    findings: tuple[Finding, ...]

    @property
    def means(self) -> tuple[MeanOfEdges, ...]:
        """Mean of all edges, then of those that show the sharpness in either direction, if there are both.

        Of several pictures that of each edge over the pictures counts: repeats are no other places in the field.
        """
        groups: dict[str, list[FieldEdge]] = {"all": list(self.edges)}
        for direction in ("horizontal", "vertical"):
            of_direction = [edge for edge in self.edges if edge.sfr.direction == direction]
            if 0 < len(of_direction) < len(self.edges):
                groups[direction] = of_direction
        means = []
        for name, edges in groups.items():
            by_region: dict[str, list[EdgeSfr]] = {}
            for edge in edges:
                by_region.setdefault(edge.roi.name, []).append(edge.sfr)
            over_pictures = [mean_sfr(repeats, repeated=True) for repeats in by_region.values()]
            means.append(MeanOfEdges(name, len(over_pictures), mean_sfr(over_pictures)))
        return tuple(means)

    @property
    def over_pictures(self) -> tuple[MeanOfEdges, ...]:
        """Mean of the edges of each picture; nothing for a single one."""
        by_picture: dict[str, list[EdgeSfr]] = {}
        for edge in self.edges:
            by_picture.setdefault(edge.picture, []).append(edge.sfr)
        if len(by_picture) < 2:
            return ()
        return tuple(MeanOfEdges(name, len(edges), mean_sfr(edges)) for name, edges in by_picture.items())

    @property
    def mtf(self) -> tuple[tuple[float, float], ...]:
        """MTF of the lens, as `lens_mtf`; empty where the pixel pitch is not known."""
        return () if self.pixel_pitch_m is None else lens_mtf([edge.sfr for edge in self.edges], self.pixel_pitch_m)


def measure_sharpness(
    luminance: LuminanceMap,
    rois: Sequence[Roi],
    pixel_pitch_m: float | None = None,
    pixels: Mapping[tuple[int, int], float] | None = None,
    picture: str = "",
) -> MeasuredSharpness:
    """Measure the response at the edges of a picture.

    Parameters
    ----------
    luminance : LuminanceMap
        The picture.
    rois : sequence of Roi
        Regions about one edge each, in pixels of the image.
    pixel_pitch_m : float or None
        Distance of the pixels on the sensor, where it is known.
    pixels : mapping of (int, int) to float, or None
        Pixels that a value of the map is the mean of, as of `sfr`.
    picture : str
        Its name, where there are several.

    Raises
    ------
    InputError
        If there is no region, or none has an edge that can be measured; one that has none is a finding.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import LuminanceMap, Roi
    >>> from labcdp.evaluate.sharpness.measure import measure_sharpness
    >>> distance = (np.arange(60) + 0.5 - 30) - 0.1 * (np.arange(80)[:, None] + 0.5 - 40)
    >>> light = 100 + 50 * np.tanh(distance)
    >>> luminance = LuminanceMap(light, np.zeros_like(light), 0.0, np.zeros(light.shape, np.uint8))
    >>> measured = measure_sharpness(luminance, [Roi.rectangle("middle", 0, 0, 60, 80)])
    >>> [(edge.roi.name, round(edge.sfr.mtf50.value, 2), round(edge.field, 2)) for edge in measured.edges]
    [('middle', 0.22, 0.0)]
    """
    edges, failed = [], []
    for roi in rois:
        try:
            edges.append(_in_field(luminance, roi, sfr(luminance, roi, pixels=pixels), picture))
        except InputError as problem:
            name = f"{roi.name}, {picture}" if picture else roi.name
            failed.append(error("sfr-edge-failed", name, reason=str(problem)))
    if not edges:
        reason = f"region {failed[0].subject!r}: {failed[0].values['reason']}" if failed else "no region about an edge"
        raise InputError(f"no edge can be measured: {reason}")
    return MeasuredSharpness(tuple(edges), pixel_pitch_m, unique([*failed, *_findings(luminance, edges)]))


def joined(parts: Sequence[MeasuredSharpness]) -> MeasuredSharpness:
    """Return the edges of several pictures together.

    Raises
    ------
    InputError
        If there is none, or their pixel pitches differ.
    """
    if not parts:
        raise InputError("no edge can be measured in any picture: draw regions about one edge each")
    if len({part.pixel_pitch_m for part in parts}) > 1:
        raise InputError("the pictures state different pixel pitches: give those of one camera, or --pixel-pitch")
    edges = tuple(edge for part in parts for edge in part.edges)
    return MeasuredSharpness(edges, parts[0].pixel_pitch_m, unique(f for part in parts for f in part.findings))


def pixels_of_values(picture: Picture, converter: Converter) -> dict[tuple[int, int], float] | None:
    """Return the pixels of each 2 x 2 whose mean the light of a picture is, with their weights; None without a filter.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp import read_image
    >>> from labcdp.evaluate.sharpness.measure import pixels_of_values
    >>> written = cv2.imwrite("mosaic.png", np.full((40, 60), 100, np.uint8))
    >>> image = read_image("mosaic.png", bayer="RGGB")
    >>> pixels_of_values(image.picture, image.converter)
    {(0, 1): 1.0, (1, 0): 1.0}
    """
    frame, calibration = picture.frame, converter.calibration
    if frame is None or frame.colour_filter is None:
        return None
    if calibration is None:
        return dict.fromkeys(luminance_pixels(frame.colour_filter), 1.0)
    places, weights = plane_positions(frame.colour_filter), getattr(calibration, "weights", None)
    if weights is None:
        return None
    planes = [str(plane.state.plane) for plane in calibration.planes]
    return {places[plane]: float(weight) for plane, weight in zip(planes, weights, strict=True) if plane in places}


def _in_field(luminance: LuminanceMap, roi: Roi, response: EdgeSfr, picture: str) -> FieldEdge:
    height, width = (luminance.step * size for size in luminance.shape)
    x, y = response.line_px.mean(axis=0).tolist()
    distance = hypot(x - width / 2, y - height / 2)
    return FieldEdge(roi, response, x, y, distance, distance / (hypot(width, height) / 2), picture)


def _findings(luminance: LuminanceMap, edges: Sequence[FieldEdge]) -> list[Finding]:
    findings = []
    if luminance.step > 1:
        findings.append(info("sfr-of-cells", side=luminance.step))
    sharpened = [
        edge.name
        for edge in edges
        if min(edge.sfr.overshoot.interval.low, edge.sfr.undershoot.interval.low) > 0
        and min(edge.sfr.overshoot.value, edge.sfr.undershoot.value) > _SHARPENED
    ]
    if sharpened:
        findings.append(warning("sfr-sharpened", edges=sharpened))
    for name, level in (("mtf50", 0.5), ("mtf10", 0.1)):
        unknown = [edge.name for edge in edges if getattr(edge.sfr, name).value != getattr(edge.sfr, name).value]
        if unknown:
            findings.append(warning("sfr-level-unknown", name.upper(), edges=unknown, level=level))
    return findings
