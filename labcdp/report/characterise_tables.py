"""A characterisation as text: summary table, notes and plain words."""

from __future__ import annotations

from math import isfinite, log, log10
from typing import TYPE_CHECKING, NamedTuple

from .digits import decimals, fixed, printable, significant, with_half_width
from .facts import Fact
from .tables import Table

if TYPE_CHECKING:
    from ..calibration.emva.result import Characterisation, Quantity


class Row(NamedTuple):
    """One quantity as it is shown.

    Parameters
    ----------
    name : str
        In words, with its symbol.
    value, uncertainty : float
        In `unit`; the uncertainty is a standard uncertainty.
    unit, note : str
        As shown.
    """

    name: str
    value: float
    uncertainty: float
    unit: str
    note: str


#: Quantities in the order they are shown, with what they are called.
_NAMES = {
    "k_dn_per_e": "Overall system gain K",
    "responsivity": "Responsivity R",
    "quantum_efficiency": "Quantum efficiency η",
    "black_level_dn": "Mean of darkness",
    "dark_noise_dn": "Temporal dark noise",
    "dark_noise_e": "Read noise, without rounding",
    "dark_current_e_s": "Dark current by the mean µ_I",
    "dark_current_by_variance_e_s": "Dark current by the variance µ_I",
    "doubling_temperature_c": "Doubling temperature T_d",
    "dsnu_e": "DSNU",
    "dsnu_pixel_e": "DSNU of pixels",
    "dsnu_column_e": "DSNU of columns",
    "dsnu_row_e": "DSNU of rows",
    "dsnu_e_s": "Spread of the dark current",
    "prnu_rel": "PRNU",
    "prnu_pixel_rel": "PRNU of pixels",
    "prnu_column_rel": "PRNU of columns",
    "prnu_row_rel": "PRNU of rows",
    "saturation_dn": "Saturation above darkness",
    "saturation_photons": "Saturation µ_p.sat",
    "full_well_e": "Saturation capacity µ_e.sat",
    "linearity_error_min_rel": "Linearity error, lowest LE_min",
    "linearity_error_max_rel": "Linearity error, highest LE_max",
    "linearity_error_rel": "Linearity error, mean LE",
    "snr_max": "Largest SNR",
    "sensitivity_threshold_e": "Sensitivity threshold µ_e.min",
    "sensitivity_threshold_photons": "Sensitivity threshold µ_p.min",
    "dynamic_range": "Dynamic range",
}
_UNITS = {"DN/e-": "DN/e⁻", "e-": "e⁻", "e-/s": "e⁻/s", "DN/(cd m^-2 s)": "DN/(cd m⁻² s)"}
#: Ratios of signal and noise; all other quantities without unit are shown in percent.
_RATIOS = ("snr_max", "dynamic_range")
#: 20 log10, as EMVA 1288 states ratios in decibels.
_DB = 20.0


def quantity_rows(result: Characterisation) -> list[Row]:
    """Return the quantities that are known, in the order they are shown; ratios in dB, too."""
    rows = []
    quantities = result.quantities()
    for key, name in _NAMES.items():
        quantity = quantities[key]
        if quantity is None:
            continue
        rows.append(_row(key, name, quantity))
        if key in _RATIOS and quantity.value > 0:
            uncertainty = _DB / log(10) * quantity.standard_uncertainty / quantity.value
            rows.append(Row(f"{name} in dB", _DB * log10(quantity.value), uncertainty, "dB", quantity.note))
    return rows


def _row(key: str, name: str, quantity: Quantity) -> Row:
    if quantity.unit == "1" and key not in _RATIOS:
        return Row(name, 100 * quantity.value, 100 * quantity.standard_uncertainty, "%", quantity.note)
    unit = "" if quantity.unit == "1" else _UNITS.get(quantity.unit, quantity.unit)
    return Row(name, quantity.value, quantity.standard_uncertainty, unit, quantity.note)


def characterisation_table(result: Characterisation) -> Table:
    """Return the summary: each quantity with its standard uncertainty, of which two digits are shown."""
    rows = [(row.name, shown(row.value, row.uncertainty), row.unit) for row in quantity_rows(result)]
    return Table(("quantity", "value ± standard uncertainty", "unit"), tuple(rows))


def shown(value: float, uncertainty: float) -> str:
    """Write a value and its standard uncertainty."""
    return with_half_width(value, uncertainty) if isfinite(uncertainty) else f"{significant(value)} ± unknown"


def note_facts(result: Characterisation) -> list[Fact]:
    """Tell how each quantity was found."""
    return [Fact(row.name, printable(row.note)) for row in quantity_rows(result) if row.note]


def plain_words(result: Characterisation) -> list[str]:
    """Tell a reader who does not know the standard what was found."""
    k, noise, full = result.k_dn_per_e, result.dark_noise_e, result.full_well_e
    end = {
        "converter": "then the converter ends, not the pixel",
        "full well": (
            "where its noise begins to vanish; it is full a little higher"
            if "peak of the temporal variance" in full.note
            else "then it is full"
        ),
        "not reached": "the brightest that was recorded; saturation was not reached",
    }[result.saturation_limit]
    efficiency = result.quantum_efficiency
    sentences = [
        f"One electron makes {short(k)} DN"
        + (f", and {short(efficiency, 100)} % of the photons make an electron" if efficiency else "")
        + (" (an estimate from lens data)." if efficiency and "estimated" in efficiency.note else "."),
        f"In darkness a pixel's noise is {short(noise)} electrons; a pixel shows up to {short(full)} electrons, {end}. "
        f"That is a range of {_DB * log10(result.dynamic_range.value):.1f} dB, and at best a signal-to-noise ratio of "
        f"{short(result.snr_max)}.",
    ]
    current = result.dark_current_e_s
    if current is not None:
        at = "" if result.temperature_c is None else f" at {result.temperature_c:.1f} °C"
        seen = current.value > 2 * current.standard_uncertainty
        half_width = significant(current.standard_uncertainty, 2)
        sentences.append(
            f"Darkness grows by {short(current)} electrons per second{at}."
            if seen
            else f"Darkness does not grow measurably{at}: by {short(current)} ± {half_width} electrons per second."
        )
    if result.prnu_rel is not None and result.dsnu_e is not None:
        sentences.append(
            f"Pixels differ by {short(result.prnu_rel, 100)} % in the light (PRNU) and by {short(result.dsnu_e)} "
            "electrons in darkness (DSNU)."
        )
    low, high = result.linearity_error_min_rel, result.linearity_error_max_rel
    if low is not None and high is not None:
        sentences.append(
            f"The response departs from a straight line by {100 * low.value:+.3f} % to {100 * high.value:+.3f} %."
        )
    sentences.append(
        f"Evaluated {result.definition}. This is a measurement with the standard's definitions, not a declaration of "
        "compliance with it: light source and procedure were not checked."
    )
    return sentences


def short(quantity: Quantity, factor: float = 1.0) -> str:
    """Write a value with the digits its uncertainty supports."""
    value, uncertainty = factor * quantity.value, factor * quantity.standard_uncertainty
    if not isfinite(uncertainty) or uncertainty <= 0:
        return significant(value, 3)
    return fixed(value, min(decimals(uncertainty, 1), decimals(value, 4) if value else 4))
