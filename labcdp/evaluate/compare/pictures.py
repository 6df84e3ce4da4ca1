"""Pictures that are compared: read and evaluated as `labcdp image` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.result import InputFile, Result
from ...files.picture.read import read_picture
from ...regions import load_regions, rois_of
from ..picture.image import ImageRequest, evaluate_image
from ..picture.light.picture import PictureConversion
from ..picture.result import image_result
from ..picture.tables import ReportedPicture


@dataclass(frozen=True)
class PictureQuestion:
    """What pictures are asked.

    Parameters
    ----------
    regions : Path
        File with their regions.
    conversion : PictureConversion
        How values become luminance.
    inputs : tuple of InputFile
        Regions, and calibration or camera specification.
    contrasts : tuple of float or None
        Contrasts to be detected, fractions; None for the measured contrast of each pair.
    epsilon : float
        Their relative tolerance.
    """

    regions: Path
    conversion: PictureConversion
    inputs: tuple[InputFile, ...]
    contrasts: tuple[float, ...] | None = None
    epsilon: float = 0.5

    def evaluate(self, path: Path) -> Result:
        """Evaluate a picture; raises InputError as `read_picture` and `evaluate_image`, or if regions lie outside."""
        picture = read_picture(path, self.conversion.options)
        height, width = picture.shape
        rois = rois_of(load_regions(self.regions, (width, height)))
        request = ImageRequest(self.contrasts, self.epsilon, rois)
        luminance, unit = self.conversion.luminance(picture), self.conversion.unit_of(picture)
        evaluation = evaluate_image(picture, luminance, unit, request, self.conversion.findings(picture))
        settings = {
            "conversion": self.conversion.description,
            "exposure_s": evaluation.exposure_s,
            "epsilon": self.epsilon,
        }
        return image_result([ReportedPicture(1, str(path), "", evaluation)], request, settings, self.inputs)
