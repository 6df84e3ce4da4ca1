"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

from . import wording
from .digits import printable
from .facts import calibration_facts, provenance_facts
from .figures import ReportFigure, ReportFigures
from .tables import contrast_table, residual_table, summary_table

if TYPE_CHECKING:
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
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = _data_uri
    configuration = evaluation.observed.configuration
    return environment.get_template("report.html").render(
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
        calibration=calibration_facts(evaluation.calibration),
        provenance=provenance_facts(evaluation),
        configuration="\n".join(printable(line) for line in configuration.to_toml().splitlines()),
    )


def _data_uri(figure: ReportFigure) -> str:
    return f"data:image/png;base64,{b64encode(figure.png).decode()}"
