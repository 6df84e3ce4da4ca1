"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

from . import wording
from .calibration_combination import facts_of_any
from .digits import printable, shortened
from .document import Document
from .facts import provenance_facts
from .figures import ReportFigure, ReportFigures
from .tables import contrast_table, residual_table, summary_table

if TYPE_CHECKING:
    from jinja2 import Environment

    from ..evaluate import SessionEvaluation

_TEMPLATES = Path(__file__).with_name("templates")


def html_page(evaluation: SessionEvaluation, figures: ReportFigures) -> str:
    """Write the report as a page with figures and style inside; all text of the session is escaped.

    Parameters
    ----------
    evaluation : SessionEvaluation
        What to report.
    figures : ReportFigures
        Its figures.

    Returns
    -------
    str
        HTML 5.
    """
    configuration = evaluation.observed.configuration
    return (
        page_environment()
        .get_template("report.html")
        .render(
            kind="labcdp report: luminance and contrast detection probability (CDP)",
            title=printable(configuration.name),
            measured=wording.measured(evaluation),
            simulated=wording.simulated(evaluation),
            results=wording.results(evaluation),
            check=wording.check(evaluation),
            warnings=wording.warnings(evaluation),
            figures=figures,
            patches=summary_table(evaluation),
            contrasts=contrast_table(evaluation),
            residuals=residual_table(evaluation.calibration),
            calibration=facts_of_any(evaluation.calibration),
            provenance=provenance_facts(evaluation),
            # Spectra stand in the session; here their first values tell which ones.
            configuration="\n".join(shortened(line, 160) for line in configuration.to_toml().splitlines()),
        )
    )


def document_page(document: Document) -> str:
    """Write any document as a page with figures and style inside; all text is escaped.

    Parameters
    ----------
    document : Document
        What to write.

    Returns
    -------
    str
        HTML 5.
    """
    return (
        page_environment()
        .get_template("document.html")
        .render(
            kind=document.kind,
            title=printable(document.title),
            banner=document.banner,
            warnings=document.warnings,
            sections=document.sections,
        )
    )


def page_environment() -> Environment:
    """Return what makes pages of the templates; all text is escaped, and nothing may be missing."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = _data_uri
    return environment


def _data_uri(figure: ReportFigure) -> str:
    return f"data:image/png;base64,{b64encode(figure.png).decode()}"
