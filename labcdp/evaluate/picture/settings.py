"""Settings of the evaluation of pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...core.result import InputFile
from ...core.roi import Rectangle, Roi
from ...files.picture import OF_VALUES
from ..verdict import CDP_LIMIT, require_limit
from .converter import RELATIVE, Converter

if TYPE_CHECKING:
    from ...regions.chart import Chart
    from ..requirement import Requirement

#: Most regions for all pairs; with more, pairs must be selected.
MOST_REGIONS_FOR_ALL_PAIRS = 6
#: What pictures are taken to be, in the configuration of results.
_OPTIONS = ("exposure_s", "gain_db", "temperature_c", "bit_depth", "pixel_format", "size", *OF_VALUES)


@dataclass(frozen=True)
class ImageSettings:
    """Settings of the evaluation of pictures; can be sent to another process.

    Parameters
    ----------
    contrasts : tuple of float or None
        Contrasts to be detected, fractions; None for the measured contrast of each pair.
    epsilon : float
        Their tolerance.
    rois : tuple of Roi
        Regions.
    pairs : tuple of (str, str) or None
        Bright and dark regions, by name; None for all pairs.
    neighbours : bool
        Whether the nearest-neighbour CDP is wanted.
    rectangle : (int, int, int, int) or None
        Corner pixels of the part that neighbours are compared in, both in; None for the whole picture.
    cdp_limit : float
        CDP from which a contrast counts as detected.
    requirement : Requirement or None
        Requirement by which pairs are judged, with contrast, tolerance and limit of its own.
    chart : Chart or None
        Chart whose patches the regions are; without regions they are found by its marks in each picture. All its
        patches are compared with all, and pairs are by default those next to each other in stated luminance.
    dark_surroundings : Path or None
        Picture of the chart from the same place with dark surroundings, for the veiling glare by the surroundings.
    colours : bool
        Whether the colours of the pairs are to be separated.
    converter : Converter
        Converter of values to luminance; relative by default.
    image_size : (int, int) or None
        Width and height of the image the regions were drawn on, which must be those of the pictures; None if unknown.
    inputs : tuple of InputFile
        Files other than the pictures, such as regions and calibration.

    Raises
    ------
    InputError
        If nothing is to be evaluated, a pair names an unknown region, or there are too few or too many regions for
        all pairs.

    Examples
    --------
    >>> from labcdp.core.roi import Roi
    >>> sky, road = Roi.rectangle("sky", 0, 0, 20, 9), Roi.rectangle("road", 0, 30, 20, 9)
    >>> ImageSettings((0.5, 1.0), rois=(sky, road)).chosen_pairs
    (('sky', 'road'),)
    """

    contrasts: tuple[float, ...] | None = None
    epsilon: float = 0.5
    rois: tuple[Roi, ...] = ()
    pairs: tuple[tuple[str, str], ...] | None = None
    neighbours: bool = False
    rectangle: Rectangle | None = None
    cdp_limit: float = CDP_LIMIT
    requirement: Requirement | None = None
    chart: Chart | None = None
    dark_surroundings: Path | None = None
    colours: bool = False
    converter: Converter = RELATIVE
    image_size: tuple[int, int] | None = None
    inputs: tuple[InputFile, ...] = ()

    def __post_init__(self) -> None:
        require_limit(self.cdp_limit)
        names = [roi.name for roi in self.rois] if self.chart is None else self.chart.names
        if not names and not self.neighbours:
            raise InputError("no evaluation was chosen: give regions, or ask for the nearest-neighbour CDP")
        for pair in self.pairs or ():
            for name in pair:
                if name not in names:
                    raise InputError(f"there is no region {name!r}: choose from {', '.join(names) or 'none'}")
            if pair[0] == pair[1]:
                raise InputError(f"region {pair[0]!r} is paired with itself: give two regions")
        if self.colours and not names:
            raise InputError("the colours of regions are asked for, but there are none: give regions")
        if self.colours and not isinstance(self.epsilon, int | float):
            raise InputError("the tolerance has two ends: give one number for the colours of regions")
        if self.pairs is None and len(names) == 1 and not self.neighbours:
            raise InputError(f"region {names[0]!r} is the only one: a contrast needs two regions")
        if self.pairs is None and self.chart is None and len(names) > MOST_REGIONS_FOR_ALL_PAIRS:
            raise InputError(
                f"{len(names)} regions make {len(names) * (len(names) - 1) // 2} pairs: choose pairs among "
                f"{', '.join(names)}"
            )

    @property
    def configuration(self) -> dict[str, Any]:
        """Return it but for the corners of the regions, as values JSON can hold."""
        options, paths = self.converter.options, {file.role: file.path for file in self.inputs}
        names = ("contrasts", "epsilon", "neighbours", "rectangle", "cdp_limit")
        required = {} if self.requirement is None else {"requirement": self.requirement.model_dump(mode="json")}
        return {
            **{name: getattr(self, name) for name in names},
            "pairs": self.chosen_pairs,
            **({} if self.chart is None else {"chart": self.chart.name}),
            **({"colours": True} if self.colours else {}),
            **required,
            "conversion": self.converter.description,
            "encoding": options.override("encoding"),
            "roi": paths.get("regions"),
            "calibration": paths.get("calibration"),
            "camera": paths.get("camera specification"),
            **{name: getattr(options, name) for name in _OPTIONS},
        }

    @property
    def chosen_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs, each pair once."""
        if self.pairs is None and self.chart is not None:
            return self.chart.neighbouring_pairs
        if self.pairs is None:
            return tuple(combinations((roi.name for roi in self.rois), 2))
        first: dict[frozenset[str], tuple[str, str]] = {}
        for pair in self.pairs:
            first.setdefault(frozenset(pair), pair)
        return tuple(first.values())

    def located(self, luminance: LuminanceMap) -> ImageSettings:
        """Return the settings with the patches of the chart where its marks are in a picture; raises InputError."""
        if self.chart is None or self.rois:
            return self
        rois = self.chart.found(luminance.luminance_cd_m2)
        scaled = (tuple((x * luminance.step, y * luminance.step) for x, y in roi.corners) for roi in rois)
        return replace(
            self, rois=tuple(replace(roi, corners=corners) for roi, corners in zip(rois, scaled, strict=True))
        )

    def target_contrasts(self, bright: str, dark: str) -> tuple[float, ...] | None:
        """Return the contrasts to be detected of a pair; None for the measured one."""
        if self.contrasts is not None or self.chart is None:
            return self.contrasts
        stated = self.chart.contrast(bright, dark)
        return None if stated is None else (stated,)
