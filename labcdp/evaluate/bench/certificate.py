"""Certificates of a calibration and of a verification."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version
from math import inf

from ...calibration import AnyCalibration, Calibration
from ...calibration.budget import darkest_corner_px
from ...calibration.record import SavedFile
from ...calibration.verify.result import Verdict, Verification
from ...core.result import Finding, FindingValue
from ...core.table import Column, Table
from ...report.html import render_page
from ...report.layout import SIMULATED, Card, Page, ReportFigure, Section, State, facts_table, page_text
from ...report.maps import close_picture
from ...report.text import (
    day,
    exposures,
    minute,
    sentence,
    shortened,
    significant,
    span,
    warning_texts,
    with_half_width,
)
from ...session import ConditionsConfiguration
from .calibration_result import CAMERA, DEVIATION, PATCH_PIXELS, UNCERTAINTY, budget_at, limited_dof, meter_columns
from .observe import ObservedSession, frame_maps
from .quantities import RESPONSIVITY, conditions, lens_text, meter_text, range_text, responsivity, traceability
from .session import target_map
from .verification import decision_rule, verified_patches

_STATES: dict[Verdict, State] = {"conform": "good", "not conform": "bad", "undecided": "open"}


def calibration_certificate(observed: ObservedSession, calibration: AnyCalibration, saved: SavedFile) -> bytes:
    """Return the certificate of a calibration as a page, with what ISO/IEC 17025:2017, 7.8.2 and 7.8.4, asks for.

    Parameters
    ----------
    observed : ObservedSession
        What its first session says.
    calibration : Calibration or ColourCalibration
        The calibration.
    saved : SavedFile
        Its file, which gives the certificate its number.
    """
    text = page_text("certificate-of-calibration", n_pixels=PATCH_PIXELS)
    method = page_text("certificate-method-of-calibration", **_method(calibration))
    sections = (
        Section("Results", [certified_patches(calibration)]),
        _warnings(calibration.findings),
        Section("Method", [method]),
        *_statements(observed, text),
    )
    return _certificate("Calibration certificate", observed, calibration, saved, saved, sections)


def calibration_dcc(observed: ObservedSession, calibration: AnyCalibration, saved: SavedFile) -> bytes | None:
    """Return the certificate of a calibration as a digital calibration certificate (DCC), parameters as above.

    The meter's luminances are the reference, those of the calibrated camera what was measured.

    Returns
    -------
    bytes or None
        XML; None if the configuration does not state the country of the laboratory.
    """
    configuration, state = observed.configuration, calibration.state
    laboratory = configuration.laboratory
    if laboratory is None or laboratory.country is None:
        return None
    from ...core.dcc import LUMINANCE, MEASURED, REFERENCE, CertifiedQuantity, DigitalCertificate, write_dcc

    customer = configuration.customer or laboratory
    every = (*calibration.residuals, *calibration.held_out)
    rows = [row for row in every if row.luminance_cd_m2 > 0 and None not in (row.U_rel, row.k)]
    meter_U, camera_U = ([], [])  # noqa: N806 - the symbol of the GUM
    for row in rows:
        meter_U.append(row.reading_cd_m2 * (row.reading_U_rel or 0.0))
        camera_U.append(row.luminance_cd_m2 * (row.U_rel or 0.0))
    names = ", ".join(row.patch for row in rows)
    read, seen = tuple(row.reading_cd_m2 for row in rows), tuple(row.luminance_cd_m2 for row in rows)
    quantities = (
        CertifiedQuantity(f"luminance by the meter of {names}", REFERENCE, LUMINANCE, read, tuple(meter_U)),
        CertifiedQuantity(
            "luminance by the calibrated camera",
            MEASURED,
            LUMINANCE,
            seen,
            tuple(camera_U),
            tuple(row.k or 2.0 for row in rows),
        ),
    )
    simulated = state.camera.simulated or observed.meter_scale.meter.simulated
    traced = f"Traceability of the luminances: {traceability(observed.meter_scale, observed.times[-1])}"
    statements = [traced, *warning_texts(calibration.findings)]
    statements += ["Simulated devices: no measurement."] if simulated else []
    stated = (f"{name}: {text}" for name, text in _conditions(observed, calibration))
    certificate = DigitalCertificate(
        number=saved.number,
        begin=observed.times[0].date(),
        end=observed.times[-1].date(),
        laboratory=laboratory.name,
        laboratory_address=laboratory.address,
        country=laboratory.country,
        customer=customer.name,
        customer_address=customer.address,
        person=configuration.operator,
        item=f"camera with lens {lens_text(calibration.lens)}",
        manufacturer=state.camera.vendor,
        model=state.camera.model,
        serial=state.camera.serial,
        quantities=quantities,
        method=f"{page_text('certificate-method-of-calibration', **_method(calibration))} {'; '.join(stated)}",
        statements=tuple(map(sentence, statements)),
        software=version("labcdp"),
    )
    return write_dcc(certificate)


def verification_certificate(
    observed: ObservedSession,
    calibration: AnyCalibration,
    verification: Verification,
    saved: SavedFile,
    saved_calibration: SavedFile,
) -> bytes:
    """Return the certificate of a verification as a page; parameters as for `calibration_certificate`."""
    shown = ("patch", "meter_cd_m2", "expanded_meter_cd_m2", "camera_cd_m2", "deviation_rel", "expanded_deviation_rel")
    results = verified_patches(verification).only(*shown, "tolerance_rel", "verdict")
    text, other = page_text("certificate-of-verification"), ""
    if not verification.same_meter:
        text = page_text("certificate-of-verification-other-meter")
        before, then = verification.calibration_meter, verification.calibration_measured
        other = f" The camera was calibrated with {meter_text(before.meter)}; {traceability(before, then)}."
    # The verdict is on top, without its advice.
    shown_findings = [finding for finding in verification.findings if not finding.code.startswith("verification-")]
    others = [finding for finding in calibration.findings if finding not in shown_findings]
    sections = (
        Section("Results", [results]),
        Section("As found and as left", [_as_found(verification, saved_calibration)]),
        _warnings(shown_findings),
        *([_warnings(others, "Further warnings of the calibration")] if warning_texts(others) else []),
        Section("Decision rule", [decision_rule(verification)]),
        Section("Method", [page_text("certificate-method-of-verification", **_method(calibration))]),
        *_statements(observed, text, other),
    )
    card = Card(verification.verdict.capitalize(), _verdict_text(verification), state=_STATES[verification.verdict])
    kind = "Verification certificate"
    return _certificate(kind, observed, calibration, saved, saved_calibration, sections, card, compact=True)


def _method(calibration: AnyCalibration) -> dict[str, FindingValue]:
    """Return model and programs of a calibration."""
    stated = dict(conditions(calibration))
    vignetting = stated.get("vignetting V(x, y)", "that of each plane")
    return {"model": stated["model"], "vignetting": vignetting, "programs": stated["calibrated with"]}


def _warnings(findings: Iterable[Finding], title: str = "Warnings") -> Section:
    return Section(title, [*map(sentence, warning_texts(findings))] or ["None."])


def _as_found(verification: Verification, calibration: SavedFile) -> str:
    """Return the state of the camera before and after a verification, which adjusts nothing."""
    mean = with_half_width(100 * verification.mean_rel, 100 * verification.mean_expanded_rel)
    now = []
    for plane in verification.planes:
        if (drift := plane.drift) is not None:
            r = drift.responsivity_dn_s_cd_m2
            name = "R" if plane.plane is None else f"R of {plane.plane}"
            now.append(f"{name} = ({with_half_width(r, r * drift.responsivity_expanded_rel)}) {RESPONSIVITY}")
    return page_text("certificate-as-found", mean=mean, now=" and ".join(now) or "-", number=calibration.number)


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
    to = f" to ± {significant(100 * verification.tolerance_rel, 2)} %" if verification.tolerance_stated else ""
    parts.append(f"{n} of {len(rows)} patches conform{to}")
    return sentence("; ".join(parts))


def _statements(observed: ObservedSession, text: str, other: str = "") -> tuple[Section, Section, Section]:
    """Return what is said on uncertainty, on certificate or data sheet of the meter, and what all relates to."""
    traced = sentence(traceability(observed.meter_scale, observed.times[-1])) + other
    uncertainty = f"{page_text('certificate-uncertainty')} {text}"
    scope = page_text("certificate-scope")
    return Section("Uncertainty", [uncertainty]), Section("Traceability", [traced]), Section("Scope", [scope])


def _certificate(
    kind: str,
    observed: ObservedSession,
    calibration: AnyCalibration,
    saved: SavedFile,
    saved_calibration: SavedFile,
    sections: Sequence[Section],
    *cards: Card,
    compact: bool = False,
) -> bytes:
    camera = calibration.state.camera
    simulated = camera.simulated or observed.meter_scale.meter.simulated
    banner, facts = SIMULATED if simulated else "", facts_table(_conditions(observed, calibration))
    identification = facts_table(_identification(observed, calibration, saved, saved_calibration))
    sections = Section("Conditions", [facts]), *sections
    lead = identification, _picture(observed, calibration, simulated)
    page = Page(kind, f"{camera}", banner=banner, cards=cards, lead=lead, sections=sections)
    dates = [("Measured", day(observed.times[-1])), ("Operator", observed.configuration.operator)]
    return render_page(page, "certificate.html", number=saved.number, dates=dates, compact=compact).encode()


def _identification(
    observed: ObservedSession, calibration: AnyCalibration, saved: SavedFile, saved_calibration: SavedFile
) -> Iterator[tuple[str, str]]:
    state, provenance = calibration.state, calibration.provenance
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
    yield "Data", f"SHA-256 {observed.input_sha256}"
    yield "File", f"{saved.name}, SHA-256 {saved.sha256}"
    if saved != saved_calibration:
        when = f"number {saved_calibration.number}, measured {day(provenance.measured)}"
        yield "Calibration", f"{when}, SHA-256 of its file {saved_calibration.sha256}"
    if provenance.input_sha256 != observed.input_sha256:
        yield "Calibration data", f"SHA-256 {provenance.input_sha256}"


def _conditions(observed: ObservedSession, calibration: AnyCalibration) -> Iterator[tuple[str, str]]:
    configuration, lens = observed.configuration, calibration.lens
    yield "Light", configuration.source.spectrum
    yield "Range", range_text(calibration)
    yield "Exposures", exposures(calibration.exposures_s)
    yield "Aperture", f"f/{lens.f_number:g}"
    given = configuration.conditions or ConditionsConfiguration.model_validate({})
    percent = None if given.relative_humidity is None else 100 * given.relative_humidity
    texts = {"Place": given.place, "Camera's condition": given.camera_condition, **_temperatures(observed)}
    yield from ((name, text) for name, text in texts.items() if text)
    optional = {
        "Focus": (lens.focus_distance_m, " m"),
        "Camera distance": (given.camera_distance_m, " m"),
        "Meter distance": (given.meter_distance_m, " m"),
        "Measuring field": (given.measuring_field_deg, "°"),
        "Angle": (given.angle_deg, "° to the normal"),
        "Room": (given.temperature_c, " °C"),
        "Humidity": (percent, " % relative"),
    }
    yield from ((name, f"{value:g}{unit}") for name, (value, unit) in optional.items() if value is not None)
    missing = [name.lower() for name, text in texts.items() if not text]
    missing += [name.lower() for name, (value, _) in optional.items() if value is None]
    if missing:
        yield "Not stated", ", ".join(missing)
    times = observed.times
    yield "Readings", f"{len(times)}, {span(minute(times[0]), minute(times[-1]))}"


def _temperatures(observed: ObservedSession) -> dict[str, str]:
    """Return the lowest and highest temperature of the camera, by its frames; empty if they have none."""
    planes = (*observed.darks_by_plane.values(), *observed.by_plane.values())
    seen = [observation for group in planes for observation in group]
    measured = sorted(o.temperature_c for o in seen if o.temperature_c is not None)
    ends = dict.fromkeys(f"{value:.1f}" for value in (measured[0], measured[-1])) if measured else {}
    return {"Camera's temperature": f"{span(*ends)} °C" if ends else ""}


def _picture(observed: ObservedSession, calibration: AnyCalibration, simulated: bool) -> ReportFigure:
    regions = [patch.region() for patch in observed.configuration.target.patches if patch.name in observed.names]
    names = ", ".join(f"{number} {shortened(region.name, 30)}" for number, region in enumerate(regions, start=1))
    return ReportFigure(
        "target.png",
        close_picture(target_map(observed, frame_maps(observed, calibration)), regions, simulated),
        f"Target as the camera sees it, in logarithmic grey levels, with the patches {names}.",
        f"Grey picture of the target with {len(regions)} patches.",
    )


def certified_patches(calibration: AnyCalibration) -> Table:
    """Return the patches by meter and camera, with U of the camera's luminance there and in the corners."""
    rows, corner = (*calibration.residuals, *calibration.held_out), darkest_corner_px(calibration)
    *expanded, dof = UNCERTAINTY
    columns = (
        Column("patch", "patch",
               value=lambda row: row.patch if row in calibration.residuals else f"{row.patch} (held out)"),
        *meter_columns(),
        CAMERA,
        DEVIATION,
        *expanded,
        replace(dof, value=lambda row: limited_dof(row.dof) or inf),
        Column("expanded_corner_rel", "U in the corners", "%",
               f"Relative U (95 %) of this luminance in the corners, of {PATCH_PIXELS} pixels in one frame.", digits=2,
               value=lambda row: budget_at(calibration, row.luminance_cd_m2, corner).U_rel),
    )  # fmt: skip
    note = ""
    if isinstance(calibration, Calibration):
        r = responsivity(calibration)
        note = f"Responsivity R = ({with_half_width(r.value or 0.0, r.expanded or 0.0)}) {r.unit}."
    return Table.of_items("certificate", "Results", columns, rows, note).sorted_by("meter_cd_m2")
