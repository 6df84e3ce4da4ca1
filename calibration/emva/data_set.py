"""Characterisation of a camera from a data set with an index."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot
from os import PathLike

import numpy as np

from ...errors import CalibrationError, InputError
from .alike import ImageCheck, require_levels
from .assemble import Nonuniformity, Origin, Stimulus, Transfer, assemble, photon_transfer
from .dark_current import fit_darkness
from .flags import flag_exposures, flag_long_exposures, flag_noise, flag_photons, flag_photons_unknown
from .images import read_image
from .index import DataSetIndex, IndexBlock, load_index
from .linearity import linearity
from .nonuniformity import dsnu_e, prnu_rel, spatial_variance, widened_by_rounding
from .photon_transfer import MIN_POINTS, responsivity
from .result import Characterisation, DarkPoint, Quantity, SeriesPoint, SpatialImages
from .statistics import FrameStatistics, FrameSums

#: More images than a pair make a stack, for the spatial quantities.
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
        If the index or an image cannot be used, or images of a block are not alike; see `load_index`, `read_image`,
        `ImageCheck` and `require_levels`.
    CalibrationError
        If there are too few points, or the noise does not grow with the signal.
    """
    index = load_index(path)
    total, done = sum(len(block.images) for block in index.blocks), 0
    statistics: list[tuple[IndexBlock, FrameStatistics]] = []
    stacks: dict[str, list[tuple[IndexBlock, FrameSums]]] = {"bright": [], "dark": []}
    check = ImageCheck(index.path)
    for block in index.blocks:
        sums = FrameSums(2**index.bits - 1)
        for number, image in enumerate(block.images):
            dn = read_image(image, (index.height, index.width), index.bits)
            check.take(dn, block, number)
            sums.add(dn)
            done += 1
            report(done, total)
        statistics.append((block, sums.result()))
        if len(block.images) >= _STACK:
            stacks[block.kind] = _larger(stacks[block.kind], block, sums)
    require_levels(index, statistics)
    points = _series(index, statistics)
    transfer = photon_transfer(points)
    origin = Origin(
        source=str(index.path),
        camera="",
        simulated=False,
        bits=index.bits,
        image_shape=(index.height, index.width),
        gain_db=None,
        temperature_c=None,
        multiple=min(s.multiple for block, s in statistics if block.kind == "bright"),
    )
    darks = _darks(points, statistics)
    stimulus = _stimulus(points, transfer)
    nonuniformity, flags = _nonuniformity(stacks, transfer.k)
    flags = [
        *flag_exposures(points),
        *flag_long_exposures(points, fit_darkness(darks).current_e_s(transfer.k)),
        *flag_photons_unknown(points),
        *flag_photons(stimulus.quantum_efficiency),
        *flag_noise(points, transfer.saturation),
        *flags,
    ]
    return assemble(origin, points, darks, None, transfer, stimulus, nonuniformity, flags)


def _larger(
    known: list[tuple[IndexBlock, FrameSums]], block: IndexBlock, sums: FrameSums
) -> list[tuple[IndexBlock, FrameSums]]:
    """Keep the stacks with the most images: sums of a large sensor fill the memory."""
    most = max((other.n_frames for _, other in known), default=0)
    if sums.n_frames < most:
        return known
    return [*(known if sums.n_frames == most else []), (block, sums)]


def _darks(points: Sequence[SeriesPoint], statistics: Sequence[tuple[IndexBlock, FrameStatistics]]) -> list[DarkPoint]:
    """Darkness at the exposures of the series, of the images its points take."""
    spatial = {
        (block.exposure_s, found.n_frames): found.spatial_variance_dn2
        for block, found in statistics
        if block.kind == "dark"
    }
    darks = {
        point.exposure_s: DarkPoint(
            point.exposure_s,
            point.dark_mean_dn,
            point.dark_variance_dn2,
            point.dark_n_pixels,
            point.dark_n_frames,
            spatial_variance_dn2=spatial[point.exposure_s, point.dark_n_frames],
        )
        for point in points
    }
    return list(darks.values())


def _series(index: DataSetIndex, statistics: Sequence[tuple[IndexBlock, FrameStatistics]]) -> list[SeriesPoint]:
    """Join light and darkness of each level, of the pairs alone if there are enough of them."""
    bright: dict[tuple[float, float], tuple[IndexBlock, FrameStatistics]] = {}
    dark: dict[float, FrameStatistics] = {}
    pairs = [s for block, s in statistics if block.kind == "bright" and s.n_frames < _STACK]
    for block, measured in sorted(statistics, key=lambda pair: -pair[1].n_frames):
        if block.kind == "bright" and measured.n_frames >= _STACK and len(pairs) >= MIN_POINTS:
            continue
        if block.kind == "bright":
            bright[block.photons, block.exposure_ns] = block, measured
        else:
            dark[block.exposure_ns] = measured
    points = []
    known = any(block.photons > 0 for block, _ in bright.values())
    for _, (block, light) in sorted(bright.items()):
        darkness = dark.get(block.exposure_ns)
        if darkness is None:
            raise InputError(
                f"{index.path}, line {block.line}: there are no dark images at {block.exposure_ns:g} ns: record them, "
                "or correct the exposure"
            )
        points.append(
            SeriesPoint(
                label="",
                exposure_s=block.exposure_s,
                photons=block.photons if known else None,
                mean_dn=light.mean_dn,
                variance_dn2=light.temporal_variance_dn2,
                dark_mean_dn=darkness.mean_dn,
                dark_variance_dn2=darkness.temporal_variance_dn2,
                n_pixels=light.n_pixels,
                n_frames=light.n_frames,
                dark_n_pixels=darkness.n_pixels,
                dark_n_frames=darkness.n_frames,
                saturated_share=light.largest_share,
                dark_black_share=darkness.black_share,
            )
        )
    if not points[-1].net_dn > 0:
        raise CalibrationError(
            f"{index.path}: the brightest images are {points[-1].net_dn:.3g} DN above darkness: were light and dark, "
            "or the photons, mixed up?"
        )
    return points


def _stimulus(points: Sequence[SeriesPoint], transfer: Transfer) -> Stimulus:
    k, fit = transfer.k, responsivity(transfer.fitted)
    line = linearity(points, transfer.net_dn)
    errors = (None, None, None) if line is None else (line.lowest(), line.highest(), line.mean_absolute())
    if fit is None or fit.value <= 0:
        return Stimulus(None, None, errors)
    r = Quantity(
        fit.value,
        fit.standard_uncertainty,
        "DN/photon",
        "up to 70 % of saturation; without the uncertainty of the photon numbers, which the data set does not tell",
    )
    relative = hypot(r.standard_uncertainty / r.value, k.standard_uncertainty / k.value)
    qe = Quantity(r.value / k.value, relative * r.value / k.value, "1", "R / K; " + r.note.partition("; ")[2])
    return Stimulus(r, qe, errors)


def _nonuniformity(
    stacks: dict[str, list[tuple[IndexBlock, FrameSums]]], k: Quantity
) -> tuple[Nonuniformity, list[str]]:
    """DSNU and PRNU of the stacks, and what is missing."""
    if not stacks["dark"]:
        return Nonuniformity(), [
            "there is no stack of dark images, so DSNU and PRNU are not known: record at least 3 images, better 50, at "
            "one exposure, with light and without"
        ]
    bright_block, bright = stacks["bright"][0] if stacks["bright"] else (None, None)
    dark_block, dark = stacks["dark"][0]
    if bright_block is not None:
        same = [pair for pair in stacks["dark"] if pair[0].exposure_ns == bright_block.exposure_ns]
        dark_block, dark = same[0] if same else (dark_block, dark)
    dark_statistics, dark_image = dark.result(), dark.mean_image()
    dark_variance = spatial_variance(dark_image, dark.noise_of_mean())
    note = f"{dark.n_frames} images at {dark_block.exposure_s:g} s"
    parts = (dark_variance.pixel, dark_variance.column, dark_variance.row)
    total, *own = widened_by_rounding(
        (dsnu_e(dark_variance.total, k, note), *(dsnu_e(part, k) for part in parts)),
        k,
        dark_statistics.temporal_variance_dn2,
        dark_statistics.spatial_variance_dn2,
    )
    dsnu_parts = (own[0], own[1], own[2])
    if bright_block is None or bright is None:
        images = SpatialImages(
            dark_image.astype(np.float32), None, dark.n_frames, 0, dark_statistics.temporal_variance_dn2, float("nan")
        )
        flag = "there is no stack of bright images, so PRNU is not known: record at least 3, better 50, at half of "
        return Nonuniformity(total, dsnu_parts, images=images), [flag + "saturation"]
    statistics, image = bright.result(), bright.mean_image()
    variance = spatial_variance(image, bright.noise_of_mean())
    net = statistics.mean_dn - dark_statistics.mean_dn
    flags = []
    if dark_block.exposure_ns != bright_block.exposure_ns:
        flags.append(
            f"the stack of bright images has an exposure of {bright_block.exposure_s:g} s, the dark one "
            f"{dark_block.exposure_s:g} s: PRNU may hold some of the dark current's pattern; record both alike"
        )
    light_note = f"{bright.n_frames} images at {net:.4g} DN above darkness; holds the light's unevenness, too"
    if not net > 0:
        return Nonuniformity(total, dsnu_parts), [*flags, "the stack of bright images is no brighter than the dark one"]
    pairs = zip((variance.pixel, variance.column, variance.row), parts, strict=True)
    prnu_parts = tuple(prnu_rel(light, darkness, net) for light, darkness in pairs)
    assert len(prnu_parts) == 3
    return Nonuniformity(
        total,
        dsnu_parts,
        None,
        prnu_rel(variance.total, dark_variance.total, net, light_note),
        prnu_parts,
        SpatialImages(
            dark_image.astype(np.float32),
            image.astype(np.float32),
            dark.n_frames,
            bright.n_frames,
            dark_statistics.temporal_variance_dn2,
            statistics.temporal_variance_dn2,
        ),
    ), flags
