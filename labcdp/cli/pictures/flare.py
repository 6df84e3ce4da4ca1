"""Command `labcdp flare`: stray light of a camera beside a source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from ...core.errors import InputError
from ...core.quantity import Z_95, Quantity
from ...core.result import InputFile
from ...evaluate.flare.result import FlareSettings, evaluate_flare
from ...regions import read_region_file, rois_of
from ..commands import As
from ..options import NonNegative, Percent, Results, Seconds, require_together
from ..values import parse_illuminance
from .options import PictureLightOptions


@dataclass(frozen=True)
class ReferenceOptions:
    """Options of what stray light is compared with.

    Parameters
    ----------
    illuminance
        Illuminance by the source at the camera, for example 1200lx; needs --calibration or --camera-spec.
    illuminance_uncertainty
        Its expanded uncertainty U (95 %).
    direct
        Picture of the source itself from the same place, so dark that it is not saturated; may be repeated.
    direct_exposure
        Exposure time of the direct pictures; default: as stated by each file.
    filter_density
        Optical density of the filter in front of the lens for the direct pictures, for example 3.
    filter_uncertainty
        Its expanded uncertainty U (95 %).
    """

    illuminance: Annotated[float | None, As(parse=parse_illuminance)] = None
    illuminance_uncertainty: Percent = 0.0
    direct: tuple[Path, ...] = ()
    direct_exposure: Seconds | None = None
    filter_density: Annotated[float | None, As(least=0, most=12)] = None
    filter_uncertainty: NonNegative = 0.0

    def quantities(self) -> tuple[Quantity | None, Quantity | None]:
        """Return illuminance and attenuation of the filter."""
        illuminance, attenuation = None, None
        if self.illuminance is not None:
            u = self.illuminance * self.illuminance_uncertainty / Z_95
            illuminance = Quantity(self.illuminance, u, "lx")
        if self.filter_density is not None:
            factor = 10**self.filter_density
            # ln 10: the relative change of the factor by that of the density.
            attenuation = Quantity(factor, 2.302585092994046 * factor * self.filter_uncertainty / Z_95)
        return illuminance, attenuation


def flare(
    light: PictureLightOptions,
    reference: ReferenceOptions,
    results: Results,
    files: tuple[Path, ...],
    *,
    source: Path | None = None,
    background: tuple[Path, ...] = (),
    block_size: Annotated[int | None, As(least=1)] = None,
) -> None:
    """Measure the flare of a camera: the stray light beside a source, in cd/m², over illuminance and over the source.

    Pictures of several exposures of the still scene are merged where the source saturates. Writes a page with the map,
    the radial profile and the worst places, a spreadsheet, NetCDF and JSON.

    Example: labcdp flare lamp-*.tif --source lamp.json --calibration camera.json --illuminance 1200lx

    Parameters
    ----------
    files : FILE...
        Pictures with the source, folders of them, or a session, of which the frames with light count.
    source
        Region file with the source and what is bright about it, which are left out.
    background
        Picture without the source, which is subtracted; may be repeated.
    block_size
        Side of the blocks of the map in pixels; default: a 64th of the longer side of the picture, at least 8.
    """
    if source is None:
        raise InputError("the source is not known: add --source with a region about it (see labcdp rois)")
    require_together({"--filter-density": reference.filter_density}, {"--direct": reference.direct or None})
    require_together({"--direct-exposure": reference.direct_exposure}, {"--direct": reference.direct or None})
    shapes, image_size, regions = read_region_file(source)
    illuminance, attenuation = reference.quantities()
    converters = light.converter(), replace(light, exposure=reference.direct_exposure).converter()
    inputs = InputFile("source", regions.path, regions.sha256), *light.inputs()
    settings = FlareSettings(
        rois_of(shapes), files, background, reference.direct, *converters, illuminance, attenuation, block_size,
        image_size, inputs,
    )  # fmt: skip
    with results.folder(files[0] if len(files) == 1 else "pictures") as folder:
        result, made = evaluate_flare(settings)
        folder.add(made)
    results.show(result, folder)
