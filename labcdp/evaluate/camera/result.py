"""A characterisation as a result, and its files: page, spreadsheet, numbers and figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite, log, log10

from ...calibration import DarkObservation
from ...calibration.emva.result import QUANTITY_NAMES, Characterisation, SeriesPoint
from ...calibration.sensor.dark_fit import black_level_drift, mean_uncertainties_dn, variance_uncertainties_dn2
from ...core.quantity import Quantity
from ...core.result import InputFile, NamedValue, Result, quantity_table
from ...core.table import Column, Table, uncertain
from ...report.files import result_files
from ...report.layout import Card, Page, ReportFigure, Section, facts_table, page_text
from ...report.text import capitalised, cell_expanded, cell_text, cell_value
from ..bench.quantities import RESPONSIVITY
from .figures import signal_figures
from .general import model_figures, model_quantities, model_table
from .nonuniformity import spatial_figures

#: Units as they are printed.
_UNITS = {"DN/e-": "DN/e⁻", "e-": "e⁻", "e-/s": "e⁻/s", "DN/(cd m^-2 s)": RESPONSIVITY}
#: Attributes of a characterisation that its result states as settings.
_STATED = ("source", "camera", "definition", "bits", "gain_db", "temperature_c", "saturation_limit")
#: Ratios of signal and noise; all other quantities without unit are shown in percent.
_RATIOS = ("snr_max", "dynamic_range")
#: 20 log10, as EMVA 1288 states ratios in decibels.
_DB = 20.0


def result(characterisation: Characterisation, title: str = "", inputs: Sequence[InputFile] = ()) -> Result:
    """Return all numbers of a characterisation.

    Parameters
    ----------
    characterisation : Characterisation
        The characterisation to report.
    title : str
        Title; empty for the source of the characterisation.
    inputs : sequence of InputFile
        Inputs it was made from.
    """
    height, width = characterisation.image_shape
    return Result(
        "characterise",
        title or characterisation.source,
        (
            quantity_table("characterisation", "Quantities after EMVA 1288", _quantities(characterisation)),
            _series(characterisation.series),
            *(() if characterisation.general is None else (model_table(characterisation.general),)),
            _darks(characterisation.darks),
        ),
        characterisation.findings,
        tuple(inputs),
        {**{name: getattr(characterisation, name) for name in _STATED}, "height": height, "width": width},
        simulated=characterisation.simulated,
    )


def _quantities(characterisation: Characterisation) -> Iterator[NamedValue]:
    """Yield the quantities that are known; ratios in dB, too."""
    for key, quantity in characterisation.quantities().items():
        if quantity is None:
            continue
        name = QUANTITY_NAMES[key]
        shown = stated(key, name, quantity)
        yield shown
        if key in _RATIOS and quantity.value > 0:
            u_db = None if shown.u is None else _DB / log(10) * shown.u / quantity.value
            yield NamedValue(
                f"{name} in dB", _DB * log10(quantity.value), "dB", "20 log10 of the ratio", u_db, key=f"{key}_db"
            )

    if characterisation.general is not None:
        yield from model_quantities(characterisation.general)


def stated(key: str, name: str, quantity: Quantity) -> NamedValue:
    """Return a quantity after EMVA 1288 as the row of a table."""
    percent = "" if key in _RATIOS else "%"
    unit = percent if quantity.unit == "1" else _UNITS.get(quantity.unit, quantity.unit)
    u = quantity.u if isfinite(quantity.u) else None
    return NamedValue(name, quantity.value, unit, quantity.note, u, None if u is None else quantity.U, key)


def _series(points: Sequence[SeriesPoint]) -> Table:
    source = "of the dark frames"
    above = Column("net_variance_dn2", "variance above dark", "DN²", "Variance minus that of the dark frames.")
    columns = (
        Column("patch", "patch", meaning="Patch of a session; missing in a data set.", value="label"),
        Column("exposure_s", "exposure", "s", "Exposure time.", time=True),
        Column("photons", "photons", "", "Mean photons of a pixel.", decimals=0),
        Column("mean_dn", "mean", "DN", "Mean in the light.", 6, value="light.mean_dn"),
        Column("variance_dn2", "variance", "DN²", "Temporal variance of a pixel in the light.", 5,
               value="light.temporal_variance_dn2"),
        Column("dark_mean_dn", "dark mean", "DN", f"Mean {source} at this exposure.", 6, value="dark.mean_dn"),
        Column("dark_variance_dn2", "dark variance", "DN²", f"Temporal variance {source}.", 5,
               value="dark.temporal_variance_dn2"),
        *uncertain(Column("net_dn", "mean above dark", "DN", "Mean minus that of the dark frames."),
                   "net_uncertainty_dn"),
        *uncertain(above, "variance_uncertainty_dn2"),
        Column("saturated_share", "saturated", "%", "Share of values at the converter's last DN.", decimals=2,
               value="light.saturated_share"),
        Column("dark_black_share", "dark at 0 DN", "%", f"Share of the values {source} at 0 DN.", decimals=2,
               value="dark.black_share"),
        Column("n_pixels", "pixels", meaning="Number of pixels averaged.", value="light.n_pixels"),
        Column("n_frames", "frames", meaning="Number of frames averaged.", value="light.n_frames"),
        Column("dark_n_pixels", "dark pixels", meaning=f"Pixels {source}.", value="dark.n_pixels"),
        Column("dark_n_frames", "dark frames", meaning="Number of dark frames averaged.", value="dark.n_frames"),
    )  # fmt: skip
    return Table.of_items("series", "Light and dark at each level", columns, points, detail=True)


def _darks(points: Sequence[DarkObservation]) -> Table:
    mean_u_dn = dict(zip(map(id, points), mean_uncertainties_dn(points, black_level_drift(points)[0]), strict=True))
    variance_u_dn2 = dict(zip(map(id, points), variance_uncertainties_dn2(points), strict=True))
    variance = Column("variance_dn2", "variance", "DN²", "Temporal variance of a pixel.", value="temporal_variance_dn2")
    columns = (
        Column("exposure_s", "exposure", "s", "Exposure time.", time=True),
        Column("temperature_c", "temperature", "°C", "Of the sensor.", decimals=1),
        *uncertain(Column("mean_dn", "mean", "DN", "Mean dark signal."), lambda point: float(mean_u_dn[id(point)])),
        *uncertain(variance, lambda point: float(variance_u_dn2[id(point)])),
        Column("spatial_variance_dn2", "spatial variance", "DN²", "Variance of the pixels' means.", 4,
               value=lambda point: point.pattern_dn**2),
        Column("n_pixels", "pixels", meaning="Number of pixels averaged."),
        Column("n_frames", "frames", meaning="Number of frames averaged."),
    )  # fmt: skip
    return Table.of_items("dark_signal", "Dark signal", columns, points, detail=True)


#: Quantities on the cards, with a second one where there is one.
_CARDS = (
    ("k_dn_per_e", ""),
    ("dark_noise_e", "dark_current_e_s"),
    ("full_well_e", "snr_max_db"),
    ("dynamic_range_db", ""),
    ("prnu_rel", "dsnu_e"),
    ("quantum_efficiency", "responsivity"),
    ("linearity_error_rel", ""),
)


def characterisation_files(characterisation: Characterisation, result: Result) -> dict[str, bytes]:
    """Return the files of a characterisation as `result_files` does."""
    size = f"{characterisation.image_shape[1]} x {characterisation.image_shape[0]} pixels, {characterisation.bits} bits"
    summary = ", ".join(part for part in (characterisation.camera, size) if part)
    transfer, *others = signal_figures(characterisation)
    lead = (transfer, result.table("characterisation").only("quantity", "value", "expanded_value", "unit"))
    sections = _sections(characterisation, result, size, others)
    page = Page.of(result, "Characterisation after EMVA 1288", summary, _cards(result), lead, sections)
    return result_files(result, page)


def _sections(
    characterisation: Characterisation, result: Result, size: str, figures: Sequence[ReportFigure]
) -> Iterator[Section]:
    meanings = result.table("characterisation").only("quantity", "meaning")
    yield Section("How the values were determined", (page_text("characterise-no-compliance"), meanings), collapsed=True)
    yield Section("Signal and noise", figures)
    general = characterisation.general
    if general is not None:
        of_model = model_figures(general, characterisation.simulated)
        yield Section("EMVA 1288 General", (*of_model, result.table("general")), collapsed=True)
    spatial = spatial_figures(characterisation)
    if spatial:
        yield Section("Non-uniformity", spatial)
    facts = [
        ("Source", characterisation.source),
        ("Camera", characterisation.camera or "not stated by the data set"),
        ("Images", size if characterisation.gain_db is None else f"{size}, gain {characterisation.gain_db:g} dB"),
        (
            "Temperature",
            "not known" if characterisation.temperature_c is None else f"{characterisation.temperature_c:.1f} °C",
        ),
        ("Definitions", characterisation.definition),
    ]
    yield Section(
        "Series and provenance", (result.table("series"), result.table("dark_signal"), facts_table(facts)), True
    )


def _cards(result: Result) -> Iterator[Card]:
    table = result.table("characterisation")
    # The unit on the card already says that it is in dB.
    rows = {row["key"]: {**row, "quantity": row["quantity"].removesuffix(" in dB")} for row in table.rows()}
    column = table.column("value")
    for key, beside in _CARDS:
        if key in rows:
            name, unit = rows[key]["quantity"], rows[key]["unit"]
            value, expanded = cell_value(column, rows[key]), cell_expanded(column, rows[key])
            detail = f"± {expanded} {unit}, U (95 %)" if expanded else ""
            lines = (
                (f"{rows[beside]['quantity']} {cell_text(column, rows[beside])} {rows[beside]['unit']}",)
                if beside in rows
                else ()
            )
            yield Card(capitalised(name), f"{value} {unit}".strip(), detail, lines)
