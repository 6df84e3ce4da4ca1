"""Pictures that are compared: evaluated by the task of `labcdp image`."""

from __future__ import annotations

from pathlib import Path

from ...core.result import InputFile
from ...regions import load_regions, rois_of
from ..picture.image import ImageRequest
from ..picture.light.picture import PictureConversion
from ..picture.result import PictureTask


def picture_task(
    regions: Path,
    conversion: PictureConversion,
    inputs: tuple[InputFile, ...],
    contrasts: tuple[float, ...] | None = None,
    epsilon: float = 0.5,
) -> PictureTask:
    """Return the task for pictures of one region file; the parameters are those of `PictureTask` and `ImageRequest`."""
    request = ImageRequest(contrasts, epsilon, rois_of(load_regions(regions)))
    return PictureTask(request, conversion, {"conversion": conversion.description, "epsilon": epsilon}, inputs, regions)
