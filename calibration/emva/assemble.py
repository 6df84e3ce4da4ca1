"""From measured points to a characterisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

from .dark_current import fit_darkness
from .fits import Slope
from .flags import flag_depth, flag_linearity, flag_rounding, flag_series, flag_values
from .photon_transfer import departure_rel, points_to_fit, require_noise, system_gain
from .result import Characterisation, DarkPoint, Quantity, SeriesPoint, SpatialImages
from .saturation import Saturation, find_saturation
from .snr import dynamic_range, sensitivity_threshold_e, snr_max

#: The definitions used.
DEFINITION = (
    "after EMVA 1288 Release 3.1, linear model; parts of DSNU and PRNU and mean linearity error after Release 4.0"
)
#: Saturation of a dense series.
AT_PEAK = (
    "saturation capacity of EMVA 1288, at the peak of the temporal variance: the pixel's full well lies several times "
    "its noise higher"
)


@dataclass(frozen=True)
class Origin:
    """Where the points come from; as in `Characterisation`."""

    source: str
    camera: str
    simulated: bool
    bits: int
    image_shape: tuple[int, int]
    gain_db: float | None
    temperature_c: float | None
    multiple: int = 1


@dataclass(frozen=True)
class Stimulus:
    """What only a photon series, or only a session, tells; as in `Characterisation`."""

    responsivity: Quantity | None
    quantum_efficiency: Quantity | None
    linearity: tuple[Quantity | None, Quantity | None, Quantity | None]


@dataclass(frozen=True)
class Nonuniformity:
    """As in `Characterisation`; by pixel, column and row."""

    dsnu_e: Quantity | None = None
    dsnu_parts_e: tuple[Quantity | None, Quantity | None, Quantity | None] = (None, None, None)
    dsnu_e_s: Quantity | None = None
    prnu_rel: Quantity | None = None
    prnu_parts_rel: tuple[Quantity | None, Quantity | None, Quantity | None] = (None, None, None)
    images: SpatialImages | None = None


@dataclass(frozen=True)
class Transfer:
    """Saturation and system gain of a series.

    Parameters
    ----------
    saturation : Saturation
        End of the range.
    net_dn, net_uncertainty_dn : float
        Its signal above darkness, and how well it is known.
    fitted : tuple of SeriesPoint
        Points up to 70 % of it.
    slope : Slope
        The fit of K.
    definition : str
        What was taken for saturation.
    """

    saturation: Saturation
    net_dn: float
    net_uncertainty_dn: float
    fitted: tuple[SeriesPoint, ...]
    slope: Slope
    definition: str

    @property
    def k(self) -> Quantity:
        """Overall system gain."""
        note = f"photon transfer over {len(self.fitted)} points up to 70 % of saturation"
        return Quantity(self.slope.value, self.slope.standard_uncertainty, "DN/e-", note)


def photon_transfer(points: Sequence[SeriesPoint]) -> Transfer:
    """Find saturation and K of a series, by the standard's unweighted fit.

    Saturation is one of the points, so it is known to half the distance to its neighbours, a rectangular error.

    Parameters
    ----------
    points : sequence of SeriesPoint
        In rising order of signal.

    Raises
    ------
    CalibrationError
        If there are too few points, or K is not above 0.
    """
    require_noise(points)
    saturation = find_saturation(points)
    net = points[saturation.index].net_dn
    # The signal stops rising behind the peak: only the neighbour before tells the distance.
    step = net - points[max(saturation.index - 1, 0)].net_dn
    fitted = points_to_fit(points, net)
    return Transfer(saturation, net, abs(step) / 2 / sqrt(3), tuple(fitted), system_gain(fitted), AT_PEAK)


def assemble(
    origin: Origin,
    points: Sequence[SeriesPoint],
    darks: Sequence[DarkPoint],
    doubling_temperature_c: Quantity | None,
    transfer: Transfer,
    stimulus: Stimulus,
    nonuniformity: Nonuniformity,
    more_flags: Sequence[str] = (),
) -> Characterisation:
    """Join all parts; the arguments are what the other modules return."""
    k = transfer.k
    darkness = fit_darkness(darks)
    current, by_variance = darkness.current_e_s(k), darkness.current_by_variance_e_s(k)
    lower = transfer.saturation.limit != "full well"
    saturation_dn, photons, full_well = _saturation(points, transfer, stimulus.responsivity)
    threshold = sensitivity_threshold_e(darkness.noise_dn(), k)
    qe = stimulus.quantum_efficiency
    note = "a lower limit" if lower else ""
    flags = [
        *flag_depth(max(p.mean_dn for p in points), origin.multiple, origin.bits, transfer.saturation),
        *flag_series(points, transfer.saturation),
        *flag_values(current, by_variance, transfer.saturation.limit, departure_rel(transfer.fitted, k.value)),
        *flag_linearity(stimulus.linearity[:2]),
        *flag_rounding(darks),
        *more_flags,
    ]
    return Characterisation(
        source=origin.source,
        camera=origin.camera,
        simulated=origin.simulated,
        definition=DEFINITION,
        bits=origin.bits,
        image_shape=origin.image_shape,
        gain_db=origin.gain_db,
        temperature_c=origin.temperature_c,
        black_level_dn=darkness.black_level_dn(),
        k_dn_per_e=k,
        responsivity=stimulus.responsivity,
        quantum_efficiency=qe,
        dark_noise_dn=darkness.noise_dn(),
        dark_noise_e=darkness.noise_e(k),
        dark_current_e_s=current,
        dark_current_by_variance_e_s=by_variance,
        doubling_temperature_c=doubling_temperature_c,
        dsnu_e=nonuniformity.dsnu_e,
        dsnu_pixel_e=nonuniformity.dsnu_parts_e[0],
        dsnu_column_e=nonuniformity.dsnu_parts_e[1],
        dsnu_row_e=nonuniformity.dsnu_parts_e[2],
        dsnu_e_s=nonuniformity.dsnu_e_s,
        prnu_rel=nonuniformity.prnu_rel,
        prnu_pixel_rel=nonuniformity.prnu_parts_rel[0],
        prnu_column_rel=nonuniformity.prnu_parts_rel[1],
        prnu_row_rel=nonuniformity.prnu_parts_rel[2],
        saturation_limit=transfer.saturation.limit,
        saturation_dn=saturation_dn,
        saturation_photons=photons,
        full_well_e=full_well,
        linearity_error_min_rel=stimulus.linearity[0],
        linearity_error_max_rel=stimulus.linearity[1],
        linearity_error_rel=stimulus.linearity[2],
        snr_max=snr_max(full_well, note),
        sensitivity_threshold_e=threshold,
        sensitivity_threshold_photons=None if qe is None else _over(threshold, qe),
        dynamic_range=dynamic_range(full_well, threshold, note),
        series=tuple(points),
        darks=tuple(darks),
        spatial=nonuniformity.images,
        flags=tuple(flags),
    )


def _saturation(
    points: Sequence[SeriesPoint], transfer: Transfer, responsivity: Quantity | None
) -> tuple[Quantity, Quantity | None, Quantity]:
    """Saturation in DN above darkness, in photons, and in electrons.

    Electrons are R / K times the photons (mu_e.sat, EMVA 1288 Release 3.1, section 6.5), or DN over K without photons.
    """
    net, k = transfer.net_dn, transfer.k
    relative = transfer.net_uncertainty_dn / net
    limited = "" if transfer.saturation.limit == "full well" else ", a lower limit of the pixel's full well"
    note = transfer.definition + limited
    photons = points[transfer.saturation.index].photons
    value = net / k.value
    if photons is not None and responsivity is not None:
        value = responsivity.value * photons / k.value
    return (
        Quantity(net, relative * net, "DN", "above darkness"),
        None if photons is None else Quantity(photons, relative * photons, "photons", "known to half a step"),
        Quantity(value, hypot(relative, k.standard_uncertainty / k.value) * value, "e-", note),
    )


def _over(threshold_e: Quantity, qe: Quantity) -> Quantity:
    value = threshold_e.value / qe.value
    relative = hypot(threshold_e.standard_uncertainty / threshold_e.value, qe.standard_uncertainty / qe.value)
    return Quantity(value, value * relative, "photons", "with the quantum efficiency stated")
