"""Contrast detection probability of all pairs of many small regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.disk.files import shown
from ..core.errors import InputError
from .contrast import Epsilon, detected_ratios, weber_contrast
from .detection import NoisyRegion, cdp_inflation
from .distribution import Distribution
from .moments import Moments, cnr_of_moments, csnr_of_moments, d_prime_of_moments
from .pixel_pairs import RELATIVE_TOLERANCE
from .result import target_contrasts
from .uncertainty import confidence_interval, scatter, variance_of_scatters

if TYPE_CHECKING:
    from xarray import Dataset

#: Contrasts to be detected: for all pairs, as for `cdp`; stated values of the regions, whose contrasts these are; or
#: None for the contrast that each pair has.
MatrixContrasts: TypeAlias = float | str | Sequence[float | str] | NDArray[Any] | Mapping[str, float] | None

_Array = NDArray[np.float64]
_Index = NDArray[np.intp]
#: Meaning of each variable, all of unit 1.
_MEANINGS = {
    "cdp": "CDP",
    "cdp_low": "lower end of the 95 % interval of the CDP",
    "cdp_high": "upper end of the 95 % interval of the CDP",
    "u_cdp": "standard uncertainty of the CDP by the pixels",
    "below": "share of the pairs of pixels with a lower contrast",
    "above": "share of the pairs of pixels with a higher contrast",
    "undefined": "share of the pairs of pixels without light; they count as below",
    "correlation_inflation": "factor on u of the CDP by correlated noise",
    "measured_contrast": "Weber contrast of the means",
    "u_measured_contrast": "standard uncertainty of the measured contrast by the pixels",
    "cnr": "difference of the means over the standard deviation of the darker region",
    "u_cnr": "standard uncertainty of the CNR by the pixels",
    "csnr": "mean over standard deviation of the contrasts of all pairs of pixels",
    "u_csnr": "standard uncertainty of the CSNR by the pixels",
    "d_prime": "difference of the means over the root mean square of the standard deviations",
    "u_d_prime": "standard uncertainty of d' by the pixels",
    "swapped": "whether the region of the dimension dark is the brighter one",
    "contrast": "Weber contrast to be detected, as a fraction (1.0 is 100 %)",
    "bright": "name of the region",
    "dark": "name of the region",
}


def cdp_matrix(
    regions: Mapping[str, ArrayLike] | Sequence[ArrayLike] | NDArray[Any],
    contrast: MatrixContrasts = None,
    epsilon: Epsilon | str = 0.5,
) -> Dataset:
    """Contrast detection probability of all pairs of regions, with their contrast and their contrast-to-noise ratios.

    Parameters
    ----------
    regions : mapping of str to array_like, or sequence of array_like
        Pixels of two regions or more, by name, in one linear unit, best cd/m^2; without names they are "1", "2", ...
        Arrays of two dimensions are taken as parts of an image, whose noise may be correlated from pixel to pixel, all
        others as independent pixels.
    contrast : float, str, array_like of them, mapping of str to float, or None
        Contrasts to be detected, fractions or percentages such as "50%"; None for the measured contrast of each pair.
        A mapping gives the stated value of each region, for example the luminance of a patch on the certificate of a
        chart in cd/m^2: the contrast of a pair is then that of its stated values.
    epsilon : float, str or DetectionInterval
        Relative tolerance of the contrasts, as for `cdp`.

    Returns
    -------
    xarray.Dataset
        Over the dimensions ``bright`` and ``dark``, names of regions: ``measured_contrast``, ``cnr``, ``csnr`` and
        ``d_prime``, each with its standard uncertainty ``u_...``, and ``swapped``. Over these and ``contrast``:
        ``cdp``, its 95 % interval ``cdp_low`` to ``cdp_high`` and ``u_cdp``, the shares ``below``, ``above`` and
        ``undefined``, and ``correlation_inflation``, as in `Cdp`. Without the dimension ``contrast`` for a number;
        for None and stated values ``contrast`` is a coordinate of each pair.

    Raises
    ------
    InputError
        If a contrast or the tolerance is out of range, there are fewer than two regions, one is empty or holds values
        that are not finite or not integers or floats, or stated values are missing or not above 0.

    Notes
    -----
    Each cell is exactly what `cdp` of both regions gives. As there, the region with the larger mean is the bright one,
    in whichever order they are given: the matrix is symmetric, and ``swapped`` is True where the region of the
    dimension ``dark`` is the brighter one. Only where two means are equal, the region of the dimension ``bright`` is
    the bright one in both cells. A region has no contrast to itself: the diagonal is nan, as are the CDP and the ratios
    of two regions without a value above 0, and the CDP at a measured or stated contrast that is not finite and above 0
    (a stated one is below 0 where the brighter region has the smaller value).

    Each region is sorted once, and the pairs of pixels of two regions are counted in one merge of their values: the
    time grows with the number of pairs times the pixels of a region. CNR, CSNR and d' follow from moments of the
    regions, as `cnr`, `csnr` and `d_prime` give them; their u and that of the contrast are those of independent pixels
    times the root of the larger `variance_inflation` of both regions. In regions of less than 200 pixels, correlated
    noise cannot be told from chance, as for `cdp`.

    Examples
    --------
    >>> import labcdp
    >>> patches = {"white": [200, 204, 199], "grey": [100, 101, 99], "black": [50, 52, 49]}
    >>> matrix = labcdp.cdp_matrix(patches, [1.0, 3.0])
    >>> matrix.cdp.sel(bright="white", contrast=3.0).values
    array([nan,  0.,  1.])
    >>> float(matrix.measured_contrast.sel(bright="white", dark="grey").round(2))
    1.01
    >>> labcdp.cdp_matrix(patches).cdp.sel(bright="grey").values
    array([ 1., nan,  1.])
    """
    patches = _patches(regions)
    if isinstance(contrast, Mapping):
        _require_values(contrast, patches)
    return _matrix(patches, contrast, epsilon)


def region_matrix(
    regions: Mapping[str, NoisyRegion], contrast: MatrixContrasts = None, epsilon: Epsilon | str = 0.5
) -> Dataset:
    """Return the matrix of regions of one image as `cdp_matrix`, whose noise may be correlated from pixel to pixel.

    Regions without a stated value have no CDP where stated values are given.
    """
    patches = [
        _Patch(name, region.distribution, np.array(region.distribution.weights), region)
        for name, region in regions.items()
    ]
    return _matrix(patches, contrast, epsilon)


def _matrix(patches: Sequence[_Patch], contrast: MatrixContrasts, epsilon: Epsilon | str) -> Dataset:
    from xarray import Dataset

    # As for `cdp`, the first of two regions with equal means is the bright one.
    means = np.array([patch.distribution.mean for patch in patches])
    swapped = means > means[:, None]
    first, second = np.indices(swapped.shape)
    bright, dark = np.where(swapped, second, first), np.where(swapped, first, second)
    positive = np.array([bool(patch.distribution.values[-1] > 0) for patch in patches])
    defined = (positive[bright] | positive[dark]) & (first != second)
    ratios = _ratios(patches, bright, dark, defined)
    pair_contrasts = None
    if contrast is None:
        pair_contrasts = ratios["measured_contrast"]
    elif isinstance(contrast, Mapping):
        pair_contrasts, contrast = _stated_contrasts(contrast, patches)[bright, dark], None
    contrasts, tolerance, shape = target_contrasts(1.0 if contrast is None else contrast, epsilon, "weber")
    if len(shape) > 1:
        raise InputError(f"contrast has the shape {shape}: give a number, a list, or stated values of the regions")
    targets = np.where(defined[..., None], contrasts, nan)
    if pair_contrasts is not None:
        usable = defined & (pair_contrasts > 0) & np.isfinite(pair_contrasts)
        targets = np.where(usable, pair_contrasts, nan)[..., None]
    by_pair, names = ("bright", "dark"), [patch.name for patch in patches]
    dataset = Dataset(
        {
            **{
                name: ((*by_pair, "contrast"), values)
                for name, values in _probabilities(patches, bright, dark, targets, tolerance).items()
            },
            **{name: (by_pair, values) for name, values in ratios.items()},
            "swapped": (by_pair, swapped),
        },
        {"bright": names, "dark": names, "contrast": contrasts},
        {
            "title": "contrast detection probability of all pairs of regions",
            "epsilon": tolerance if isinstance(tolerance, int | float) else str(tolerance),
        },
    )
    if not shape:
        dataset = dataset.isel(contrast=0)
    if pair_contrasts is not None:
        dataset = dataset.assign_coords(contrast=(by_pair, targets[..., 0]))
    for name, variable in dataset.variables.items():
        variable.attrs = {"long_name": _MEANINGS[str(name)]} | ({} if name in by_pair else {"units": "1"})
    return dataset


@dataclass(frozen=True, eq=False)
class _Patch:
    """A region: its sorted values, counts that compiled code takes, and its image if it is part of one."""

    name: str
    distribution: Distribution
    weights: _Array
    noisy: NoisyRegion | None


def _patches(regions: Mapping[str, ArrayLike] | Sequence[ArrayLike] | NDArray[Any]) -> list[_Patch]:
    if not isinstance(regions, Mapping | Sequence | np.ndarray) or isinstance(regions, str | bytes):
        raise InputError(f"regions is {type(regions).__name__}: give arrays of pixels by name, or a list of them")
    if not isinstance(regions, Mapping):
        regions = {str(number): pixels for number, pixels in enumerate(regions, start=1)}
    if len(regions) < 2:
        raise InputError(f"{len(regions)} regions are given: give two or more, by name or as a list")
    patches, start = [], 0
    for name, pixels in regions.items():
        if not isinstance(name, str | int):
            raise InputError(f"{shown(name)} is no name of a region: give text or a whole number")
        distribution = Distribution.from_array(pixels, f"region {name!r}")
        image, noisy = np.asarray(pixels, dtype=np.float64), None
        if image.ndim == 2 and min(image.shape) > 1:
            # In rows and columns of its own it has none in common with others.
            stop = start + max(image.shape)
            noisy = NoisyRegion(
                image, np.ones(image.shape, dtype=np.bool_), distribution, (slice(start, stop), slice(start, stop))
            )
            start = stop
        patches.append(_Patch(name, distribution, np.array(distribution.weights), noisy))
    return patches


def _ratios(patches: Sequence[_Patch], bright: _Index, dark: _Index, defined: NDArray[np.bool_]) -> dict[str, _Array]:
    """Measured contrast and ratios of all pairs with their u, nan where they are not defined."""
    distributions = [patch.distribution for patch in patches]
    moments, inverse = Moments.from_regions(distributions), Moments.from_regions(distributions, inverse=True)
    is_image = np.array([patch.noisy is not None for patch in patches])
    factors = np.array([1.0 if patch.noisy is None else patch.noisy.inflation for patch in patches])
    inflation = np.where(is_image[bright] & is_image[dark], np.maximum(factors[bright], factors[dark]), 1.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        contrast = weber_contrast(moments.mean[bright], moments.mean[dark])
        mean_rel = np.sqrt(moments.sample_variance / moments.n) / moments.mean
        quantities = {
            "measured_contrast": (contrast, (1 + contrast) * np.hypot(mean_rel[bright], mean_rel[dark])),
            "cnr": cnr_of_moments(moments[bright], moments[dark]),
            "csnr": csnr_of_moments(moments[bright], inverse[dark]),
            "d_prime": d_prime_of_moments(moments[bright], moments[dark]),
        }
    variables = {}
    for name, (value, u) in quantities.items():
        variables[name] = np.where(defined, value, nan)
        variables[f"u_{name}"] = np.where(defined & np.isfinite(value), u * np.sqrt(inflation), nan)
    return variables


def _require_values(values: Mapping[str, float], patches: Sequence[_Patch]) -> None:
    """Refuse stated values that are missing or no numbers above 0."""
    missing = [patch.name for patch in patches if patch.name not in values]
    if missing:
        raise InputError(f"no value is stated for region {missing[0]!r}: give one for each region")
    for patch in patches:
        value = values[patch.name]
        is_number = np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"
        if not (is_number and isfinite(value) and value > 0):
            raise InputError(f"the value stated for region {patch.name!r} is {shown(value)}: give a number above 0")


def _stated_contrasts(values: Mapping[str, float], patches: Sequence[_Patch]) -> _Array:
    """Contrasts of the stated values of a bright (first) and a dark region; nan where one has none."""
    stated = np.array([values.get(patch.name, nan) for patch in patches], dtype=np.float64)
    return weber_contrast(stated[:, None], stated)


def _probabilities(
    patches: Sequence[_Patch], bright: _Index, dark: _Index, targets: _Array, epsilon: Epsilon
) -> dict[str, _Array]:
    """Values of `Cdp` of all pairs at their target contrasts, shape (n, n, contrasts), nan where these are nan."""
    counted = np.full((*targets.shape, 6), nan)
    # Both orders of two regions are the same, but where their means are equal.
    mirrored = np.tri(len(patches), dtype=np.bool_) & (bright == bright.T)
    for i, j in np.argwhere(np.isfinite(targets).any(axis=2) & ~mirrored).tolist():
        counted[i, j] = _count(patches[bright[i, j]], patches[dark[i, j]], targets[i, j].tolist(), epsilon)
    counted[mirrored] = counted.transpose(1, 0, 2, 3)[mirrored]
    below, inside, above, dark_scatter, bright_scatter, inflation = np.moveaxis(counted, -1, 0)
    sizes = np.array([patch.distribution.total for patch in patches])
    n_bright, n_dark = sizes[bright][..., None], sizes[dark][..., None]
    variance = inflation * variance_of_scatters(inside, dark_scatter, bright_scatter, n_dark, n_bright)
    not_positive = np.array([patch.distribution.not_positive for patch in patches])
    undefined = (not_positive[bright] * not_positive[dark])[..., None]
    u, factor = np.sqrt(variance), np.sqrt(inflation)
    independent = np.minimum(n_bright, n_dark) / np.square(factor)
    interval = confidence_interval(inside, np.square(u), independent)
    return {
        "cdp": inside,
        "cdp_low": interval.low,
        "cdp_high": interval.high,
        "u_cdp": u,
        "below": below,
        "above": above,
        "undefined": np.where(np.isfinite(inside), undefined, nan),
        "correlation_inflation": factor,
    }


def _count(bright: _Patch, dark: _Patch, contrasts: Sequence[float], epsilon: Epsilon) -> list[tuple[float, ...]]:
    """Shares below, inside and above of each contrast, scatters of that inside by dark and bright pixel, inflation."""
    from .pairs_kernel import merge_counts

    upper, lower = bright.distribution, dark.distribution
    pairs = upper.total * lower.total
    per_dark, per_bright = np.empty(lower.values.size), np.empty(upper.values.size)
    counted: list[tuple[float, ...]] = []
    for contrast in contrasts:
        low, high = detected_ratios(contrast, epsilon)
        numbers = merge_counts(
            upper.values, upper.cumulative, lower.values, dark.weights,
            low * (1 - RELATIVE_TOLERANCE), high * (1 + RELATIVE_TOLERANCE), per_dark, per_bright,
        )  # fmt: skip
        below, inside, above = (number / pairs for number in numbers)
        inflation = 1.0
        if bright.noisy is not None and dark.noisy is not None:
            inflation = cdp_inflation(bright.noisy, dark.noisy, inside, per_dark, per_bright)
        scatters = scatter(per_dark, lower.weights, inside), scatter(per_bright, upper.weights, inside)
        counted.append((below, inside, above, *scatters, inflation))
    return counted
