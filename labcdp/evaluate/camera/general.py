"""Characterisation of a session after EMVA 1288 General, as a record, a result and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log10
from typing import TYPE_CHECKING

import numpy as np

from ...calibration.emva.general import DEFINITION_GENERAL, GeneralModel, general_model
from ...calibration.frames.observations import CameraState, DarkObservation
from ...core.errors import CalibrationError
from ...core.quantity import Quantity
from ...core.reading import Reading
from ...core.result import Finding, InputFile, NamedValue, Result, info, quantity_table
from ...core.table import Column, Table, uncertain
from ...core.vignetting import AnyVignetting, illuminance_in
from ...report.drawing import BLUE, ORANGE, finish, logarithmic, new_figure, reported
from ...report.files import result_files
from ...report.layout import Card, Page, ReportFigure, Section, facts_table, page_text
from ...report.text import capitalised
from .frames import SessionPoint, unsaturated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Unit of the stimulus of a session: the luminance of a patch, as on the optical axis, times the exposure time.
STIMULUS = "cd s/m²"


@dataclass(frozen=True, eq=False)
class GeneralCharacterisation:
    """A camera after EMVA 1288 General: what there is without a linear model, and so without K and full well.

    Parameters
    ----------
    source, camera : str
        Session, and camera.
    simulated : bool
        Whether the camera is simulated.
    state : CameraState
        Camera and settings.
    temperature_c : float or None
        Of the dark frames.
    black_level_dn : Quantity
        Mean dark signal at zero exposure, in linear DN.
    dark_noise_dn : Quantity
        Temporal noise in the dark at the shortest exposure, rounding included.
    model : GeneralModel
        Characteristic curve with noise and SNR.
    darks : tuple of DarkObservation
        Dark signal over the exposure.
    findings : tuple of Finding
        Findings for the user.
    """

    source: str
    camera: str
    simulated: bool
    state: CameraState
    temperature_c: float | None
    black_level_dn: Quantity
    dark_noise_dn: Quantity
    model: GeneralModel
    darks: tuple[DarkObservation, ...]
    findings: tuple[Finding, ...]


def session_model(
    points: Sequence[SessionPoint],
    readings: Mapping[str, Sequence[Reading]],
    vignetting: AnyVignetting | None,
    dark_noise_dn: float,
) -> GeneralModel:
    """Characteristic curve of the patches of a session over luminance times exposure.

    Parameters
    ----------
    points : sequence of SessionPoint
        All patches and exposures.
    readings : mapping of str to sequence of Reading
        Luminances by patch; patches without any are left out.
    vignetting : AnyVignetting or None
        Of the lens, which the stimulus at a patch is dimmed by.
    dark_noise_dn : float
        Temporal noise in the dark.

    Raises
    ------
    CalibrationError
        If there are no readings, or too few points.
    """
    if not readings:
        raise CalibrationError("the session has no meter readings: the characteristic curve is over luminance")
    rows = []
    for point in unsaturated(points):
        if point.label in readings:
            luminance = float(np.mean([reading.value * reading.cd_m2_per_unit for reading in readings[point.label]]))
            dimmed = 1.0
            if vignetting is not None:
                dimmed = float(illuminance_in(vignetting, point.light.state.image_shape, point.light.window).mean())
            light = point.light
            stimulus = luminance * point.exposure_s * dimmed
            rows.append((point.label, point.exposure_s, stimulus, point.net_dn, light.temporal_variance_dn2, light.dof))
    saturated = any(point.light.saturated_share > 0 for point in points)
    return general_model(rows, dark_noise_dn, STIMULUS, saturated)


def model_findings(model: GeneralModel) -> list[Finding]:
    """Name the dips of the SNR, and a range that was not measured to its end."""
    findings = [
        info("snr-dip", stimulus=dip.stimulus, before=dip.snr_before, after=dip.snr_after, fall_db=dip.fall_db)
        for dip in model.dips
    ]
    return findings if model.saturated else [*findings, info("general-not-saturated", stimulus=model.highest)]


def model_quantities(model: GeneralModel) -> Iterator[NamedValue]:
    """Yield threshold, highest stimulus, dynamic range, largest SNR and the dips of a model."""
    last = "highest that is not saturated, a lower limit of saturation"
    yield NamedValue(
        "threshold, General", model.threshold, model.unit, "SNR at the input is 1", key="general_threshold"
    )
    yield NamedValue("highest stimulus, General", model.highest, model.unit, last, key="general_highest_stimulus")
    range_db = 20 * log10(model.dynamic_range)
    yield NamedValue(
        "dynamic range, General", range_db, "dB", "20 log10 of the ratio, a lower limit", key="general_dynamic_range_db"
    )
    best = max(model.points, key=lambda point: point.snr)
    where = f"at {best.stimulus:.4g} {model.unit}"
    yield NamedValue("largest SNR at the input", best.snr, "", where, best.snr_u, key="general_snr_max")
    for number, dip in enumerate(model.dips, start=1):
        meaning = f"from {dip.snr_before:.4g} to {dip.snr_after:.4g}, above {dip.stimulus:.4g} {model.unit}"
        yield NamedValue(f"dip {number} of the SNR", dip.fall_db, "dB", meaning, key=f"general_dip_{number}_db")


def model_table(model: GeneralModel) -> Table:
    """Return the points of the characteristic curve."""
    columns = (
        Column("patch", "patch", meaning="Patch of a session.", value="label"),
        Column("exposure_s", "exposure", "s", "Exposure time.", time=True),
        Column("stimulus", "stimulus", model.unit, "Luminance by the meter times exposure, as on the optical axis.", 5),
        Column("net_dn", "mean above dark", "DN", "Mean minus that of the dark frames, in linear DN.", 6),
        Column("noise_dn", "noise", "DN", "Temporal noise of a pixel.", 4),
        Column("slope", "slope", "DN/(cd s/m²)", "Slope of the characteristic curve.", 4),
        Column("noise_stimulus", "noise at the input", model.unit, "Temporal noise over the slope.", 4),
        *uncertain(Column("snr", "SNR", "", "Stimulus over noise at the input.", 4), "snr_u"),
    )
    return Table.of_items("general", "Characteristic curve after EMVA 1288 General", columns, model.points, detail=True)


def general_result(
    characterisation: GeneralCharacterisation, title: str = "", inputs: Sequence[InputFile] = ()
) -> Result:
    """Return all numbers of a characterisation after EMVA 1288 General."""
    state, (height, width) = characterisation.state, characterisation.state.image_shape
    black, noise = characterisation.black_level_dn, characterisation.dark_noise_dn
    quantities = (
        NamedValue("dark signal µ_y.dark", black.value, "DN", black.note, black.u, black.U, "black_level_dn"),
        NamedValue("temporal dark noise", noise.value, "DN", noise.note, noise.u, noise.U, "dark_noise_dn"),
        *model_quantities(characterisation.model),
    )
    configuration = {
        "source": characterisation.source,
        "camera": characterisation.camera,
        "definition": DEFINITION_GENERAL,
        "bits": state.bit_depth,
        "curve": None if state.companding is None else state.companding.identity,
        "gain_db": state.gain_db,
        "temperature_c": characterisation.temperature_c,
        "height": height,
        "width": width,
    }
    table = quantity_table("characterisation", "Quantities after EMVA 1288 General", quantities)
    tables = (table, model_table(characterisation.model))
    name = title or characterisation.source
    return Result(
        "characterise",
        name,
        tables,
        characterisation.findings,
        tuple(inputs),
        configuration,
        simulated=characterisation.simulated,
    )


def model_figures(model: GeneralModel, simulated: bool) -> list[ReportFigure]:
    """Draw characteristic curve, and SNR at the input with its dips."""
    label, drawn = "camera" if simulated else "", {"curve": _curve, "snr": _snr}
    return [
        reported(f"characterise-general-{name}", draw(model, label), page_text(f"characterise-general-{name}"))
        for name, draw in drawn.items()
    ]


def _curve(model: GeneralModel, simulated: str) -> Figure:
    figure = new_figure(9.0, 4.6, simulated)
    axes = figure.subplots()
    stimulus, net, noise = _values(model, "stimulus", "net_dn", "noise_dn")
    axes.plot(stimulus, net, "o", color="black", markersize=4, label="mean above dark")
    axes.plot(stimulus, noise, "o", color=ORANGE, markersize=4, label="temporal noise")
    logarithmic(axes.xaxis, axes.yaxis)
    finish(axes, f"stimulus in {model.unit}", "DN", "Characteristic curve")
    return figure


def _snr(model: GeneralModel, simulated: str) -> Figure:
    figure = new_figure(9.0, 4.6, simulated)
    axes = figure.subplots()
    stimulus, ratio = _values(model, "stimulus", "snr")
    axes.plot(stimulus, ratio, "o-", color=BLUE, markersize=4, linewidth=0.8, label="SNR at the input")
    for number, dip in enumerate(model.dips):
        text = "dips" if number == 0 else None
        axes.plot([dip.stimulus] * 2, [dip.snr_after, dip.snr_before], color=ORANGE, linewidth=2, label=text)
    logarithmic(axes.xaxis, axes.yaxis)
    finish(axes, f"stimulus in {model.unit}", "SNR", "SNR at the input")
    return figure


def _values(model: GeneralModel, *names: str) -> list[list[float]]:
    return [[getattr(point, name) for point in model.points] for name in names]


def general_files(characterisation: GeneralCharacterisation, result: Result) -> dict[str, bytes]:
    """Return the files of a characterisation after EMVA 1288 General as `result_files` does."""
    height, width = characterisation.state.image_shape
    curve = characterisation.state.companding
    expanded = "linear values" if curve is None else f"codes of the curve {curve}"
    size = f"{width} x {height} pixels, {characterisation.state.bit_depth} bits, {expanded}"
    first, snr = model_figures(characterisation.model, characterisation.simulated)
    rows = {row["key"]: row for row in result.table("characterisation").rows()}
    falls = [dip.fall_db for dip in characterisation.model.dips]
    deepest = [f"general_dip_{int(np.argmax(falls)) + 1}_db"] if falls else []
    cards = [
        Card(capitalised(rows[key]["quantity"]), f"{rows[key]['value']:.4g} {rows[key]['unit']}".strip())
        for key in ("general_dynamic_range_db", "general_snr_max", "dark_noise_dn", *deepest)
    ]
    facts = [
        ("Source", characterisation.source),
        ("Camera", characterisation.camera),
        ("Images", size),
        ("Definitions", DEFINITION_GENERAL),
    ]
    sections = (
        Section("SNR at the input", (snr,)),
        Section("Points and provenance", (result.table("general"), facts_table(facts)), collapsed=True),
    )
    lead = (first, result.table("characterisation").only("quantity", "value", "expanded_value", "unit", "meaning"))
    summary = f"{characterisation.camera}, {size}"
    page = Page.of(result, "Characterisation after EMVA 1288 General", summary, cards, lead, sections)
    return result_files(result, page)


def dark_noise(darks: Sequence[DarkObservation]) -> Quantity:
    """Temporal noise of a pixel in the dark at the shortest exposure, rounding included."""
    first = min(darks, key=lambda dark: dark.exposure_s)
    noise = float(np.sqrt(first.temporal_variance_dn2))
    return Quantity(noise, noise / np.sqrt(2 * first.dof), "DN", "at the shortest exposure, rounding included")
