"""What a contrast map is told in: the names of its kinds of edges, and its result in plain words."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any

from ..contrast import DetectionInterval, Epsilon
from ..evaluate.contrast_map_edges import FALSE_ALARM, SATURATED_SHARE, EdgeKind
from .digits import fixed, percent, share_percent, significant
from .facts import Fact
from .tables import Table

if TYPE_CHECKING:
    from ..evaluate.contrast_map import ContrastMap

#: Name of each kind of edge, as tables and files say it.
KIND_NAMES = {
    EdgeKind.LOST: "lost",
    EdgeKind.SEEN: "detected",
    EdgeKind.UNEVEN: "not uniform",
    EdgeKind.FAINT: "faint",
    EdgeKind.NOISE: "noise",
    EdgeKind.SATURATED: "saturated",
    EdgeKind.BLACK: "black",
    EdgeKind.SMALL: "too small",
}

#: Edges that the table of the weakest ones has.
WEAKEST = 10


@dataclass(frozen=True)
class MapSource:
    """Where a contrast map comes from.

    Parameters
    ----------
    file : str
        Name of the image.
    sha256 : str
        Its checksum.
    unit : str
        Of the luminance: cd/m^2 or relative.
    conversion : str
        How DN became luminance.
    simulated : bool
        Whether the camera was simulated.
    warnings : tuple of str
        What to mind of file and conversion.
    """

    file: str
    sha256: str
    unit: str
    conversion: str
    simulated: bool
    warnings: tuple[str, ...]

    @property
    def shown_unit(self) -> str:
        """Unit as it stands behind a number."""
        return "cd/m²" if self.unit == "cd/m^2" else "(relative)"


def result_text(found: ContrastMap) -> list[str]:
    """Tell the result in plain sentences, the most important first."""
    asked = found.settings
    least, level = percent(asked.minimum_contrast), f"{asked.detected:g}"
    seen, lost = found.count(EdgeKind.SEEN), found.count(EdgeKind.LOST)
    if seen + lost == 0:
        texts = [f"No edge of the image with a contrast of at least {least} could be judged."]
    else:
        texts = [
            f"{share_percent(found.detected_share)} of the {seen + lost} edges with a contrast of at least {least} are "
            f"detected with a CDP of at least {level}; {lost} are lost "
            f"({share_percent(1 - found.detected_border_share)} of the length of these edges)."
        ]
    others = {
        EdgeKind.FAINT: f"have a contrast below {least}",
        EdgeKind.NOISE: "are not told from noise and are no edges of objects",
        EdgeKind.UNEVEN: "show their contrast in too few pixels because a region is not uniform, not because of noise",
        EdgeKind.SATURATED: f"touch a region with more than {percent(SATURATED_SHARE)} of its pixels saturated",
        EdgeKind.BLACK: "touch a region without light above the black",
        EdgeKind.SMALL: "are too short, or touch a region with too few pixels",
    }
    parts = [f"{found.count(kind)} {text}" for kind, text in others.items() if found.count(kind)]
    if parts:
        texts.append(f"Of the {found.edges.kind.size} borders between regions, " + "; ".join(parts) + ".")
    if found.blind_share > 0:
        texts.append(
            f"At {share_percent(found.blind_share)} of the borders a contrast of {least} would not be told from noise, "
            "even by all pixels of both regions: an object there may be missing from the map."
        )
    return texts


def settings_facts(found: ContrastMap, source: MapSource) -> list[Fact]:
    """How the map was made."""
    asked, luminance = found.settings, found.luminance
    height, width = luminance.shape
    return [
        Fact("Image", f"{source.file}, {width * luminance.step} x {height * luminance.step} pixels"),
        Fact("Luminance", source.conversion),
        Fact("Regions", f"{found.regions.mean.size} superpixels of about {asked.size_px} x {asked.size_px} pixels"),
        Fact("Detected contrast", f"that of the edge {tolerance(asked.epsilon)}"),
        Fact("Least contrast of an object", percent(asked.minimum_contrast)),
        Fact(
            "Told from noise",
            f"by {found.threshold_sigmas:.2f} standard uncertainties: chance of one false edge in the whole image "
            f"{percent(FALSE_ALARM)}",
        ),
        Fact(
            "Noise",
            f"neighbouring regions differ by chance {significant(found.noise.inflation**0.5, 3)} times as much as with "
            "independent pixels",
        ),
        Fact("SHA-256 of the file", source.sha256),
    ]


def tolerance(epsilon: Epsilon) -> str:
    """Write a tolerance as it stands behind a contrast."""
    if not isinstance(epsilon, DetectionInterval):
        return f"± {percent(epsilon)} of it"
    below = "and all below" if epsilon.below is None else f"- {percent(epsilon.below)}"
    above = "and all above" if epsilon.above is None else f"+ {percent(epsilon.above)}"
    return f"{below}, {above} of it"


def weakest_table(found: ContrastMap, source: MapSource, n: int = WEAKEST) -> Table:
    """List the edges with the lowest CDP."""
    edges, step = found.edges, found.luminance.step
    rows = []
    for edge in found.weakest(n):
        x, y = edges.middle_px[edge] * step
        bright, dark = (found.regions.mean[side[edge]] for side in (edges.bright, edges.dark))
        rows.append(
            (
                f"{x:.0f}, {y:.0f}",
                significant(float(bright)),
                significant(float(dark)),
                contrast_text(float(edges.contrast[edge]), float(edges.contrast_standard_uncertainty[edge])),
                fixed(float(edges.cdp[edge]), 3),
                f"{fixed(float(edges.cdp_low[edge]), 3)} to {fixed(float(edges.cdp_high[edge]), 3)}",
                f"{edges.border_px[edge] * step}",
            )
        )
    unit = source.shown_unit
    columns = (
        "x, y in pixels",
        f"bright side, {unit}",
        f"dark side, {unit}",
        "contrast",
        "CDP",
        "95 % interval",
        "border in pixels",
    )
    return Table(columns, tuple(rows))


def contrast_text(contrast: float, standard_uncertainty: float) -> str:
    """Write a contrast in percent with its 95 % interval."""
    if not isfinite(contrast):
        return "not defined"
    half = 100 * 1.96 * standard_uncertainty
    n = 1 if isnan(half) or half < 9.95 else 0
    return f"({fixed(100 * contrast, n)} ± {fixed(half, n)}) %"


def map_values(found: ContrastMap, source: MapSource) -> dict[str, Any]:
    """Values JSON can hold: settings, counts and the weakest edges."""
    asked, edges, step = found.settings, found.edges, found.luminance.step
    epsilon = asked.epsilon
    return {
        "file": source.file,
        "sha256": source.sha256,
        "unit": source.unit,
        "conversion": source.conversion,
        "size_px": asked.size_px,
        "epsilon": [epsilon.below, epsilon.above] if isinstance(epsilon, DetectionInterval) else epsilon,
        "minimum_contrast": asked.minimum_contrast,
        "detected_cdp": asked.detected,
        "regions": int(found.regions.mean.size),
        "edges": {name: found.count(kind) for kind, name in KIND_NAMES.items()},
        "detected_share": found.detected_share,
        "detected_border_share": found.detected_border_share,
        "blind_share": found.blind_share,
        "false_alarm": FALSE_ALARM,
        "threshold_sigmas": found.threshold_sigmas,
        "noise_variance_inflation": found.noise.inflation,
        "weakest": [
            {
                "x_px": float(edges.middle_px[edge, 0] * step),
                "y_px": float(edges.middle_px[edge, 1] * step),
                "border_px": int(edges.border_px[edge] * step),
                "bright_mean": float(found.regions.mean[edges.bright[edge]]),
                "dark_mean": float(found.regions.mean[edges.dark[edge]]),
                "contrast": float(edges.contrast[edge]),
                "contrast_standard_uncertainty": float(edges.contrast_standard_uncertainty[edge]),
                "cdp": float(edges.cdp[edge]),
                "cdp_interval_95": [float(edges.cdp_low[edge]), float(edges.cdp_high[edge])],
            }
            for edge in found.weakest(WEAKEST)
        ],
        "warnings": [*source.warnings, *found.warnings],
    }
