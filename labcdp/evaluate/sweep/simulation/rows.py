"""Records of a simulated image: each region and each pair of regions behind each stage."""

from __future__ import annotations

from dataclasses import dataclass

from ....chain import ChainRun
from ....core.quantity import Quantity
from ....metrics import Cdp
from ....metrics.contrast import TargetContrasts
from ....metrics.region import SATURATED_SHARE, Bound


@dataclass(frozen=True)
class StageLuminance:
    """Luminance of one region behind one stage.

    Parameters
    ----------
    luminance_cd_m2, luminance_standard_deviation_cd_m2 : float
        Mean and standard deviation of the luminance the stage's values stand for.
    luminance_snr : Quantity
        Mean over standard deviation of that luminance; unlike that of the values it does not gain from a black level,
        nor from glare that is subtracted.
    saturated_share : float
        Share of the region's pixels that are saturated.
    """

    luminance_cd_m2: float
    luminance_standard_deviation_cd_m2: float
    luminance_snr: Quantity
    saturated_share: float

    @property
    def bound(self) -> Bound:
        """Whether the luminance is a lower bound, as the region is saturated."""
        return ">" if self.saturated_share > SATURATED_SHARE else ""


@dataclass(frozen=True)
class RegionRow(StageLuminance):
    """One region behind one stage, with its values.

    Parameters
    ----------
    stage, quantity, unit : str
        Name of the stage, what its values are and their unit.
    region : str
        Name of the region.
    true_cd_m2 : float
        Mean luminance of the scene there.
    mean, standard_deviation : float
        Of the native values, in the unit of the stage; the deviation without what follows the vignetting.
    snr : Quantity
        Their mean over standard deviation; inf without noise.
    snr_10log10_db, snr_20log10_db : Quantity
        The same in decibels: 10 log10 as in the 2018 thesis (eq. 2.1), 20 log10 as in EMVA 1288.
    """

    stage: str
    quantity: str
    unit: str
    region: str
    true_cd_m2: float
    mean: float
    standard_deviation: float
    snr: Quantity
    snr_10log10_db: Quantity
    snr_20log10_db: Quantity


@dataclass(frozen=True, eq=False)
class PairRow:
    """One pair of regions behind one stage; contrasts are fractions.

    Parameters
    ----------
    stage, dark, bright : str
        Names of the stage and of the regions.
    true_contrast : float
        Weber contrast of the scene.
    measured_contrast : float
        Weber contrast of the mean luminances behind the stage; nan or inf where there is none.
    mean_contrast : float
        Mean Weber contrast of all pairs of pixels whose dark one is above 0; nan if there is none.
    cdp : Cdp or None
        Region to region; None if no pixel of the two is above 0 cd/m^2.
    neighbours : Cdp or None
        Nearest-neighbour over the whole frame, for a checkerboard with squares of one pixel.
    csnr, cnr, d_prime : Quantity
        Contrast signal-to-noise ratio, contrast-to-noise ratio and detectability of the two luminances.
    bound : {'>', '<', '?', ''}
        Whether the measured contrast is a bound, as a region is saturated.
    """

    stage: str
    dark: str
    bright: str
    true_contrast: float
    measured_contrast: float
    mean_contrast: float
    cdp: Cdp[float] | None
    neighbours: Cdp[float] | None
    csnr: Quantity
    cnr: Quantity
    d_prime: Quantity
    bound: Bound = ""


@dataclass(frozen=True, eq=False)
class StageRow:
    """One stage.

    Parameters
    ----------
    name : str
        Name of the stage.
    regions : tuple of RegionRow
        Each region of the scene.
    pairs : tuple of PairRow
        Each pair of regions, at each contrast to be detected.
    """

    name: str
    regions: tuple[RegionRow, ...]
    pairs: tuple[PairRow, ...]


@dataclass(frozen=True, eq=False)
class SimulationEvaluation:
    """A run of a chain, evaluated.

    Parameters
    ----------
    run : ChainRun
        The run.
    contrast : float, tuple of float or None
        Contrasts to be detected, None for each pair's own.
    epsilon : float
        Its tolerance.
    stages : tuple of StageRow
        In order.
    """

    run: ChainRun
    contrast: TargetContrasts
    epsilon: float
    stages: tuple[StageRow, ...]
