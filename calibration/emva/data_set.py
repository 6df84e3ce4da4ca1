"""Characterisation of a camera from a data set with an index."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any

from ...core.clock import exposure_text
from ...core.errors import CalibrationError, InputError
from ...core.frame import CameraIdentity
from ...core.quantity import Quantity
from ...core.result import Finding, info, warning
from ..frames.measure import FrameSums, MeasuredFrames
from ..frames.observations import CameraState, DarkObservation
from ..frames.observe import dark_observation
from ..frames.statistics import Level
from .assemble import Transfer, assemble, findings_of_data_set, photon_transfer, with_findings, with_frame_changes
from .images import ImageCheck, read_image, require_levels
from .index import DataSetIndex, IndexBlock, load_index
from .quantities import dsnu_parts, prnu_parts, spatial_variance_of
from .result import Characterisation, SeriesPoint
from .transfer import MIN_POINTS, linearity, responsivity

#: Note on the missing uncertainty of the photon numbers.
_WITHOUT_PHOTONS = "u without that of the photon numbers, which the data set does not state"

#: Fewest images of a stack, for the spatial quantities.
_STACK = 3


def characterise_data_set(
    path: str | PathLike[str], report: Callable[[int, int], None] = lambda _done, _total: None
) -> Characterisation:
    """Characterise a camera from a photon series after EMVA 1288.

    Two images at a level give mean and temporal noise; the level with the most images, at least 3, gives the spatial
    non-uniformity, with the dark stack of its exposure. Of several the one nearest to half of the brightest level.

    Parameters
    ----------
    path : path
        Index of the data set, or its folder.
    report : callable
        Called with the number of images read, and of all images.

    Raises
    ------
    InputError
        If the index or an image cannot be used, or images of a block are not alike.
    CalibrationError
        If there are too few points, or the noise does not grow with the signal.
    """
    index = load_index(path)
    shape = (index.height, index.width)
    state = CameraState(CameraIdentity("", "", ""), "", index.bits, shape, 0.0, 2**index.bits - 1, 0.0)
    total, done = sum(len(block.images) for block in index.blocks), 0
    levels: list[tuple[IndexBlock, Level]] = []
    darks: dict[float, DarkObservation] = {}
    stacks: dict[IndexBlock, MeasuredFrames] = {}
    of_stacks, of_choice = _stacks(index)
    check = ImageCheck(index.path)
    for block in index.blocks:
        sums = FrameSums(state, block.exposure_s)
        for number, image in enumerate(block.images):
            dn = read_image(image, shape, index.bits)
            check.take(dn, block, number)
            sums.add(dn)
            done += 1
            report(done, total)
        measured = sums.result()
        levels.append((block, measured.level))
        if block.kind == "dark" and (block.exposure_s not in darks or len(block.images) < _STACK):
            darks[block.exposure_s] = dark_observation(measured)
        if block in of_stacks:
            stacks[block] = measured
    require_levels(index, levels)
    points = _series(index, levels)
    own_darks = [darks[exposure_s] for exposure_s in sorted({point.exposure_s for point in points})]
    points = with_frame_changes(points, own_darks)
    transfer = photon_transfer(points)
    nonuniformity, findings = _nonuniformity([(block, stacks[block]) for block in of_stacks], transfer.k)
    origin = {"source": str(index.path), "bits": index.bits, "image_shape": shape}
    result = assemble(origin, points, own_darks, transfer, _sensitivity(points, transfer) | nonuniformity)
    return with_findings(result, [*findings_of_data_set(result), *of_choice, *findings])


def _stacks(index: DataSetIndex) -> tuple[list[IndexBlock], list[Finding]]:
    """Blocks for the spatial quantities: the dark one with the most images, and the bright one, if there are any."""
    most: dict[str, list[IndexBlock]] = {"bright": [], "dark": []}
    for kind, blocks in most.items():
        of_kind = [block for block in index.blocks if block.kind == kind and len(block.images) >= _STACK]
        blocks += [block for block in of_kind if len(block.images) == max(len(other.images) for other in of_kind)]
    # EMVA 1288 Release 4.0 Linear: at about half of saturation.
    lit = [block for block in index.blocks if block.kind == "bright"]
    known = any(block.photons > 0 for block in lit)
    stimuli = {block: block.photons if known else block.exposure_ns for block in lit}
    half = max(stimuli.values()) / 2
    bright = sorted(most["bright"], key=lambda block: abs(stimuli[block] - half))[:1]
    # The dark one of the same exposure, if that has as many.
    dark = sorted(most["dark"], key=lambda block: bool(bright) and block.exposure_ns != bright[0].exposure_ns)[:1]
    findings = []
    if dark and len(most["bright"]) > 1:
        chosen = {"photons": bright[0].photons if known else None, "exposure_s": bright[0].exposure_s}
        of = {"count": len(most["bright"]), "n_images": len(bright[0].images)}
        findings.append(info("bright-stacks-alike", **of, **chosen))
    return [*dark, *bright] if dark else [], findings


def _series(index: DataSetIndex, levels: Sequence[tuple[IndexBlock, Level]]) -> list[SeriesPoint]:
    """Join light and dark signal of each level, only of the pairs if there are enough."""
    bright: dict[tuple[float, float], tuple[IndexBlock, Level]] = {}
    dark: dict[float, Level] = {}
    pairs = [level for block, level in levels if block.kind == "bright" and level.n_frames < _STACK]
    for block, level in sorted(levels, key=lambda pair: -pair[1].n_frames):
        if block.kind == "dark":
            dark[block.exposure_ns] = level
        elif level.n_frames < _STACK or len(pairs) < MIN_POINTS:
            bright[block.photons, block.exposure_ns] = block, level
    points = []
    known = any(block.photons > 0 for block, _ in bright.values())
    for _, (block, light) in sorted(bright.items()):
        if block.exposure_ns not in dark:
            raise InputError(
                f"{index.path}, line {block.line}: there are no dark images at {block.exposure_ns:g} ns: record them, "
                "or correct the exposure"
            )
        photons = block.photons if known else None
        points.append(SeriesPoint("", block.exposure_s, photons, light, dark[block.exposure_ns]))
    if not points[-1].net_dn > 0:
        raise CalibrationError(
            f"{index.path}: the brightest images are {points[-1].net_dn:.3g} DN above the dark signal: were light and "
            "dark, or the photons, mixed up?"
        )
    return points


def _sensitivity(points: Sequence[SeriesPoint], transfer: Transfer) -> dict[str, Any]:
    fit, line = responsivity(transfer.fitted), linearity(points, transfer.saturation.net_dn)
    errors = {} if line is None else line.errors()
    if fit is None or fit.value <= 0:
        return errors
    note = f"up to 70 % of saturation; {_WITHOUT_PHOTONS}"
    r = Quantity(fit.value, fit.u, "DN/photon", note)
    return errors | {"responsivity": r, "quantum_efficiency": r.over(transfer.k, "1", f"R / K; {_WITHOUT_PHOTONS}")}


def _nonuniformity(
    stacks: Sequence[tuple[IndexBlock, MeasuredFrames]], k: Quantity
) -> tuple[dict[str, Any], list[Finding]]:
    """DSNU and PRNU of a dark and a bright stack, and what is missing."""
    if not stacks:
        return {}, [warning("no-dark-stack")]
    (dark_block, dark), *bright = stacks
    of_dark = spatial_variance_of(dark)
    dsnu: dict[str, Any] = dict(
        dsnu_parts(of_dark, k, dark, f"{dark.n_frames} images at {exposure_text(dark_block.exposure_s)}")
    )
    if not bright:
        return dsnu | {"spatial": (dark,)}, [warning("no-bright-stack")]
    light_block, light = bright[0]
    findings = []
    if dark_block.exposure_ns != light_block.exposure_ns:
        exposures = {"bright_s": light_block.exposure_s, "dark_s": dark_block.exposure_s}
        findings.append(warning("stacks-of-different-exposures", **exposures))
    net = light.mean_dn - dark.mean_dn
    if not net > 0:
        return dsnu, [*findings, warning("bright-stack-not-brighter")]
    note = f"{light.n_frames} images at {net:.4g} DN above the dark signal, non-uniform light included"
    prnu = prnu_parts(spatial_variance_of(light), of_dark, net, note)
    return dsnu | prnu | {"spatial": (dark, light)}, findings
