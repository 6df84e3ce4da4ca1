"""Certificates of a calibration and of a verification."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...calibration import AnyCalibration, Calibration
from ...calibration.verify.result import Verdict, Verification
from ...core.table import Column, Table
from ...report.html import render_page
from ...report.layout import SIMULATED, Card, Facts, Page, ReportFigure, Section, State, page_text
from ...report.maps import close_picture
from ...report.text import day, exposures, finding_text, minute, sentence, shortened, significant, span, with_half_width
from ...session import ConditionsConfiguration
from .calibration_result import CAMERA, DEVIATION, METER, PATCH_PIXELS, budget_at
from .observe import ObservedSession
from .quantities import lens_text, meter_text, range_text, responsivity, traceability
from .session import target_map
from .verification import decision_rule, verified_patches

_STATES: dict[Verdict, State] = {"conform": "good", "not conform": "bad", "undecided": "open"}


def calibration_certificate(observed: ObservedSession, calibration: AnyCalibration) -> bytes:
    """Return the certificate of a calibration as a page.

    Parameters
    ----------
    observed : ObservedSession
        What its first session says.
    calibration : Calibration or ColourCalibration
        The calibration.
    """
    scope = page_text("certificate-of-calibration", n_pixels=PATCH_PIXELS)
    sections = Section("Results", [_calibrated(calibration)]), *_statements(observed, scope)
    return _certificate("Calibration certificate", observed, calibration, sections)


def verification_certificate(
    observed: ObservedSession, calibration: AnyCalibration, verification: Verification
) -> bytes:
    """Return the certificate of a verification as a page; parameters as for `calibration_certificate`."""
    shown = ("patch", "meter_cd_m2", "expanded_meter_cd_m2", "camera_cd_m2", "deviation_rel", "expanded_deviation_rel")
    results = verified_patches(verification).only(*shown, "tolerance_rel", "verdict")
    scope, other = page_text("certificate-of-verification"), ""
    if not verification.same_meter:
        scope = page_text("certificate-of-verification-other-meter")
        before = verification.calibration_meter
        other = f" The camera was calibrated with {meter_text(before.meter)}; {traceability(before)}."
    rule, statements = Section("Decision rule", [decision_rule(verification)]), _statements(observed, scope, other)
    verdict = verification.verdict
    card = Card(verdict.capitalize(), _verdict_text(verification), state=_STATES[verdict])
    sections = Section("Results", [results]), rule, *statements
    return _certificate("Verification certificate", observed, calibration, sections, card)


def _verdict_text(verification: Verification) -> str:
    """Return what makes the verdict, without advice."""
    rows = verification.patches
    open_or_bad = [row for row in rows if row.verdict != "conform"]
    deviations = [with_half_width(100 * row.deviation_rel, 100 * row.expanded_rel) for row in open_or_bad]
    parts = [
        f"patch {row.patch} {row.verdict}, deviation ({deviation}) %"
        for row, deviation in zip(open_or_bad, deviations, strict=True)
    ]
    parts += [f"patch {name} could not be measured" for name in verification.unusable]
    parts += ["dark signal not conform"] if verification.dark_not_conform else []
    parts += ["colour balance not conform"] if verification.balance_not_conform else []
    n = sum(row.verdict == "conform" for row in rows)
    parts.append(f"{n} of {len(rows)} patches conform to ± {significant(100 * verification.tolerance_rel, 2)} %")
    return sentence("; ".join(parts))


def _statements(observed: ObservedSession, scope: str, other: str = "") -> tuple[Section, Section]:
    """Return what is said on uncertainty, and on certificate or data sheet of the meter and whether that is overdue."""
    warnings = [one for one in observed.meter_scale.findings(observed.readings) if one.severity == "warning"]
    texts = (traceability(observed.meter_scale), *map(finding_text, warnings))
    traced = " ".join(map(sentence, texts)) + other
    uncertainty = f"{page_text('certificate-uncertainty')} {scope}"
    return Section("Uncertainty", [uncertainty]), Section("Traceability", [traced])


def _certificate(
    kind: str, observed: ObservedSession, calibration: AnyCalibration, sections: Sequence[Section], *cards: Card
) -> bytes:
    camera = calibration.state.camera
    simulated = camera.simulated or observed.meter_scale.meter.simulated
    banner, conditions = SIMULATED if simulated else "", Facts(list(_conditions(observed, calibration)))
    lead = Facts(list(_identification(observed, calibration))), _picture(observed, calibration, simulated)
    sections = Section("Conditions", [conditions]), *sections
    page = Page(kind, f"{camera}", banner=banner, cards=cards, lead=lead, sections=sections)
    dates = [("Measured", day(observed.times[-1])), ("Operator", observed.configuration.operator)]
    return render_page(page, "certificate.html", number=observed.input_sha256[:12], dates=dates).encode()


def _identification(observed: ObservedSession, calibration: AnyCalibration) -> Iterator[tuple[str, str]]:
    state, own = calibration.state, calibration.provenance.input_sha256
    height, width = state.image_shape
    configuration = observed.configuration
    for what, party in (("Laboratory", configuration.laboratory), ("Customer", configuration.customer)):
        if party is not None:
            yield what, f"{party.name}, {party.address}"
    yield "Camera", f"{state.camera}"
    yield "Frames", f"{state.pixel_format}, {width} x {height} pixels, {state.gain_db:g} dB"
    yield "Lens", lens_text(calibration.lens)
    yield "Luminance meter", meter_text(observed.meter_scale.meter)
    yield "Target", configuration.target.name
    yield "Session", f"{observed.session.path.resolve().name}: {configuration.name}"
    yield "SHA-256 of data", observed.input_sha256
    if own != observed.input_sha256:
        yield "Calibration", f"{day(calibration.provenance.measured)}, SHA-256 of data {own}"


def _conditions(observed: ObservedSession, calibration: AnyCalibration) -> Iterator[tuple[str, str]]:
    configuration, lens = observed.configuration, calibration.lens
    yield "Light", configuration.source.spectrum
    yield "Range", range_text(calibration)
    yield "Exposures", exposures(calibration.exposures_s)
    yield "Aperture", f"f/{lens.f_number:g}"
    given = configuration.conditions or ConditionsConfiguration.model_validate({})
    optional = {
        "Focus": (lens.focus_distance_m, " m"),
        "Camera distance": (given.camera_distance_m, " m"),
        "Meter distance": (given.meter_distance_m, " m"),
        "Measuring field": (given.measuring_field_deg, "°"),
        "Angle": (given.angle_deg, "° to the normal"),
        "Room": (given.temperature_c, " °C"),
    }
    yield from ((name, f"{value:g}{unit}") for name, (value, unit) in optional.items() if value is not None)
    if missing := [name.lower() for name, (value, _) in optional.items() if value is None]:
        yield "Not stated", ", ".join(missing)
    times = observed.times
    yield "Readings", f"{len(times)}, {span(minute(times[0]), minute(times[-1]))}"


def _picture(observed: ObservedSession, calibration: AnyCalibration, simulated: bool) -> ReportFigure:
    regions = [patch.region() for patch in observed.configuration.target.patches if patch.name in observed.names]
    names = ", ".join(f"{number} {shortened(region.name, 30)}" for number, region in enumerate(regions, start=1))
    return ReportFigure(
        "target.png",
        close_picture(target_map(observed, calibration), regions, simulated),
        f"Target as the camera sees it, in logarithmic grey levels, with the patches {names}.",
        f"Grey picture of the target with {len(regions)} patches.",
    )


def _calibrated(calibration: AnyCalibration) -> Table:
    """Return the patches by meter and camera, with U and k of the camera's luminance."""
    rows = (*calibration.residuals, *calibration.held_out)
    whole = {row.luminance_cd_m2: budget_at(calibration, row.luminance_cd_m2).whole for row in rows}
    columns = (
        Column("patch", "patch",
               value=lambda row: row.patch if row in calibration.residuals else f"{row.patch} (held out)"),
        METER,
        CAMERA,
        DEVIATION,
        Column("expanded_rel", "U of the camera's luminance", "%", "Relative U (95 %).", digits=2,
               value=lambda row: whole[row.luminance_cd_m2].expanded_95_rel),
        Column("k", "k", "", "Coverage factor.", decimals=2,
               value=lambda row: whole[row.luminance_cd_m2].coverage_factor),
    )  # fmt: skip
    note = ""
    if isinstance(calibration, Calibration):
        r = responsivity(calibration)
        note = f"Responsivity R = ({with_half_width(r.value or 0.0, r.expanded or 0.0)}) {r.unit}."
    return Table.of_items("certificate", "Results", columns, rows, note).sorted_by("meter_cd_m2")
