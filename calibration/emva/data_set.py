"""Characterisation of a camera from a data set with an index."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any

from ...core.clock import exposure_text
from ...core.errors import CalibrationError, InputError
from ...core.frame import CameraIdentity
from ...core.result import Finding, warning
from ..frames.measure import MeasuredFrames
from ..frames.nonuniformity import spatial_variance
from ..frames.observations import CameraState, DarkObservation
from ..frames.observe import dark_observation
from ..frames.statistics import FrameStatistics, FrameSums
from .assemble import Transfer, assemble, photon_transfer, with_frame_changes
from .findings import exposure_findings, long_exposure_findings, noise_findings, photon_findings
from .images import ImageCheck, read_image, require_levels
from .index import DataSetIndex, IndexBlock, load_index
from .quantities import PARTS, dsnu_parts, fit_dark_current, prnu_rel
from .result import Characterisation, Origin, Quantity, Sensitivity, SpatialImages, SpatialNonuniformity
from .series import Level, SeriesPoint
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
    non-uniformity, with the dark stack of its exposure.

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
    stacks: dict[str, list[tuple[IndexBlock, FrameStatistics]]] = {"bright": [], "dark": []}
    check = ImageCheck(index.path)
    for block in index.blocks:
        sums = FrameSums(state.saturation_dn)
        for number, image in enumerate(block.images):
            dn = read_image(image, shape, index.bits)
            check.take(dn, block, number)
            sums.add(dn)
            done += 1
            report(done, total)
        measured = sums.result()
        levels.append((block, Level.of(measured)))
        if block.kind == "dark" and (block.exposure_s not in darks or len(block.images) < _STACK):
            darks[block.exposure_s] = dark_observation(MeasuredFrames(measured, block.exposure_s, None, state))
        if len(block.images) >= _STACK:
            stacks[block.kind] = _larger(stacks[block.kind], block, measured)
    require_levels(index, levels)
    points = _series(index, levels)
    own_darks = [darks[exposure_s] for exposure_s in sorted({point.exposure_s for point in points})]
    points = with_frame_changes(points, own_darks)
    transfer = photon_transfer(points)
    sensitivity = _sensitivity(points, transfer)
    nonuniformity, of_stacks = _nonuniformity(stacks, transfer.k)
    origin = Origin(source=str(index.path), bits=index.bits, image_shape=shape)
    findings = [
        *exposure_findings(points),
        *long_exposure_findings(points, fit_dark_current(own_darks).current_e_s(transfer.k)),
        *photon_findings(points, sensitivity.quantum_efficiency),
        *noise_findings(points, transfer.saturation),
        *of_stacks,
    ]
    return assemble((origin, sensitivity, nonuniformity), points, own_darks, transfer, more=findings)


def _larger(
    known: list[tuple[IndexBlock, FrameStatistics]], block: IndexBlock, measured: FrameStatistics
) -> list[tuple[IndexBlock, FrameStatistics]]:
    """Keep only the stacks with the most images, to limit memory."""
    most = max((other.n_frames for _, other in known), default=0)
    if measured.n_frames < most:
        return known
    return [*(known if measured.n_frames == most else []), (block, measured)]


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


def _sensitivity(points: Sequence[SeriesPoint], transfer: Transfer) -> Sensitivity:
    k, fit, line = transfer.k, responsivity(transfer.fitted), linearity(points, transfer.net_dn)
    names = ("linearity_error_min_rel", "linearity_error_max_rel", "linearity_error_rel")
    errors: dict[str, Any] = {} if line is None else dict(zip(names, line.errors(), strict=True))
    if fit is None or fit.value <= 0:
        return Sensitivity(**errors)
    note = f"up to 70 % of saturation; {_WITHOUT_PHOTONS}"
    r = Quantity(fit.value, fit.standard_uncertainty, "DN/photon", note)
    qe = r.over(k, "1", f"R / K; {_WITHOUT_PHOTONS}")
    return Sensitivity(responsivity=r, quantum_efficiency=qe, **errors)


def _nonuniformity(
    stacks: dict[str, list[tuple[IndexBlock, FrameStatistics]]], k: Quantity
) -> tuple[SpatialNonuniformity, list[Finding]]:
    """DSNU and PRNU of the stacks, and what is missing."""
    if not stacks["dark"]:
        return SpatialNonuniformity(), [warning("no-dark-stack")]
    light_block, light = stacks["bright"][0] if stacks["bright"] else (None, None)
    dark_block, dark = min(
        stacks["dark"], key=lambda pair: light_block is not None and pair[0].exposure_ns != light_block.exposure_ns
    )
    of_dark = spatial_variance(dark.image_dn, dark.temporal.scaled(1 / dark.n_frames))
    note = f"{dark.n_frames} images at {exposure_text(dark_block.exposure_s)}"
    dsnu = dsnu_parts(of_dark, k, dark.temporal_variance_dn2, dark.spatial_variance_dn2, note)
    if light_block is None or light is None:
        return SpatialNonuniformity(**dsnu, spatial=SpatialImages.of(dark)), [warning("no-bright-stack")]
    findings = []
    if dark_block.exposure_ns != light_block.exposure_ns:
        exposures = {"bright_s": light_block.exposure_s, "dark_s": dark_block.exposure_s}
        findings.append(warning("stacks-of-different-exposures", **exposures))
    net = light.mean_dn - dark.mean_dn
    if not net > 0:
        return SpatialNonuniformity(**dsnu), [*findings, warning("bright-stack-not-brighter")]
    of_light = spatial_variance(light.image_dn, light.temporal.scaled(1 / light.n_frames))
    note = f"{light.n_frames} images at {net:.4g} DN above the dark signal, non-uniform light included"
    prnu: dict[str, Any] = {"prnu_rel": prnu_rel(of_light.total, of_dark.total, net, note)}
    for name in PARTS:
        prnu[f"prnu_{name}_rel"] = prnu_rel(getattr(of_light, name), getattr(of_dark, name), net)
    return SpatialNonuniformity(**dsnu, **prnu, spatial=SpatialImages.of(dark, light)), findings
