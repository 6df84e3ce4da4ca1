"""The report of a calibration as a document."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING

from .calibration_budget import budget_conditions, budget_facts, budget_table, budgets
from .calibration_combination import combination_facts, combination_ladder, plane_table
from .calibration_figures import calibration_figures
from .calibration_tables import (
    ladder_facts,
    ladder_table,
    left_out_facts,
    patch_table,
    test_facts,
    test_table,
)
from .calibration_wording import cautions, purpose, quality, quality_of_combination, simulated
from .digits import printable
from .document import Document, Section
from .facts import Fact, calibration_facts
from .wording import minute

if TYPE_CHECKING:
    from ..calibration import AnyCalibration, Calibration
    from ..calibration.colour import ColourCalibration

_KIND = "labcdp report: calibration of a camera as a luminance meter"


def calibration_document(calibration: Calibration, title: str = "") -> Document:
    """Make the report of the calibration of a monochrome sensor, or of one plane.

    Parameters
    ----------
    calibration : Calibration
        What to report.
    title : str
        Name of the measurement; empty for that of the camera.
    """
    short = Section("In short", (purpose(calibration), quality(calibration), *cautions(calibration)))
    return Document(
        _KIND,
        title or str(calibration.state.camera),
        simulated(calibration),
        [printable(warning) for warning in calibration.warnings],
        (short, *_sections(calibration), _provenance(calibration)),
    )


def combination_document(colour: ColourCalibration, title: str = "") -> Document:
    """Make the report of the calibration of a sensor with colour filters: the combination, then each plane."""
    first = colour.planes[0]
    short = Section("In short", (purpose(colour), quality_of_combination(colour), *cautions(colour)))
    combination = Section(
        "Luminance from the colour planes",
        (
            "The luminance is a weighted sum of what the four planes say, with the weights that fit the meter best. A "
            "weight may be negative; the nearer the sum of the planes' sensitivities comes to V(λ), the less the "
            "result depends on the light.",
        ),
        (
            ("Planes and their weights", plane_table(colour)),
            ("Patches by the meter and by the combination", patch_table(colour.residuals)),
            *([("Held-out patches", patch_table(colour.held_out))] if colour.held_out else []),
            ("The combination against single colours", combination_ladder(colour)),
        ),
        facts=combination_facts(colour),
    )
    uncertainty = _uncertainty(colour, "grey patch")
    left_out = Section("Left out", facts=left_out_facts(colour.left_out))
    planes = []
    for plane in colour.planes:
        name = f"Plane {plane.state.plane}"
        planes.append(Section(name, (purpose(plane), quality(plane))))
        planes += [
            Section(f"{name}: {s.title.lower()}", s.paragraphs, s.tables, s.figures, s.facts) for s in _sections(plane)
        ]
    return Document(
        _KIND,
        title or str(first.state.camera),
        simulated(first),
        [printable(warning) for warning in colour.warnings],
        (short, combination, uncertainty, *([left_out] if colour.left_out else []), *planes, _provenance(first)),
    )


def _sections(calibration: Calibration) -> Sequence[Section]:
    fit, *rest = calibration_figures(calibration)
    response, residuals = rest[:-1], rest[-1]
    return [
        section
        for section in (
            Section(
                "Fit",
                tables=(
                    (
                        "Patches of the fit; meter with 95 % half width, its scale left out",
                        patch_table(calibration.residuals),
                    ),
                ),
                figures=(fit, *response, residuals),
                facts=calibration_facts(calibration),
            ),
            _held_out(calibration),
            _left_out(calibration),
            _models(calibration),
            _tests(calibration),
            _uncertainty(calibration, "patch"),
            Section("Valid for", facts=_validity(calibration)),
        )
        if section is not None
    ]


def _uncertainty(calibration: AnyCalibration, patch: str) -> Section:
    found = budgets(calibration)
    return Section(
        "Uncertainty",
        (budget_conditions(found, patch),),
        (("Budget at the lowest, a middle and the highest luminance", budget_table(found)),),
        facts=budget_facts(found),
    )


def _held_out(calibration: Calibration) -> Section | None:
    if not calibration.held_out:
        return None
    return Section(
        "Held-out patches",
        ("The fit was not shown these patches: they test it, but for the scale error of the meter.",),
        (("Held-out patches; meter with 95 % half width, its scale left out", patch_table(calibration.held_out)),),
    )


def _left_out(calibration: Calibration) -> Section | None:
    if not calibration.left_out:
        return None
    return Section("Left out", ("What the fit does not use, and why.",), facts=left_out_facts(calibration.left_out))


def _models(calibration: Calibration) -> Section | None:
    if not calibration.ladder:
        return None
    return Section(
        "Models",
        ("Each model was judged by how well it predicts patches it was not shown, not by how well it fits.",),
        (("Models of the response", ladder_table(calibration)),),
        facts=ladder_facts(calibration),
    )


def _tests(calibration: Calibration) -> Section | None:
    if not calibration.tests:
        return None
    return Section(
        "Tests",
        (),
        (("Tests of what the model takes for granted", test_table(calibration)),),
        facts=test_facts(calibration),
    )


def _validity(calibration: Calibration) -> list[Fact]:
    facts = {fact.name: fact.value for fact in calibration_facts(calibration)}
    state = calibration.state
    height, width = state.image_shape
    plane = [Fact("Colour plane", state.plane)] if state.plane else []
    gains = [state.gain_db, *(gain.gain_db for gain in calibration.gains)]
    return [
        Fact("Camera", printable(str(state.camera))),
        *plane,
        Fact("Pixel format", f"{printable(state.pixel_format)}, {state.bit_depth} bit, {width} x {height} pixels"),
        Fact("Gain", ", ".join(f"{gain:g} dB" for gain in gains)),
        Fact("Black level", f"{state.black_level_dn:g} DN; saturated from {state.saturation_dn:g} DN"),
        *(
            Fact(name, facts[name])
            for name in (
                "Lens",
                "Light",
                "Calibrated luminance",
                "Calibrated signal above dark",
                "Calibrated exposures",
            )
        ),
    ]


def _provenance(calibration: Calibration) -> Section:
    facts = {fact.name: fact.value for fact in calibration_facts(calibration)}
    provenance = calibration.provenance
    versions = ", ".join(f"{name} {text}" for name, text in provenance.versions.items())
    return Section(
        "Provenance",
        facts=[
            Fact("Luminance meter", facts["Luminance meter"]),
            Fact("Last reading", minute(provenance.measured)),
            Fact("SHA-256 of frames and readings", provenance.input_sha256),
            Fact("Calibrated with", printable(versions)),
            Fact("Report written by", f"labcdp {version('labcdp')}"),
        ],
    )
