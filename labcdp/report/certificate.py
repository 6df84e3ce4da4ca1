"""Certificate of a measurement: what a laboratory hands to its customer, one or two printed pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version

from ..core.table import Table
from .figure import ReportFigure
from .html import environment
from .layout import Facts, State


@dataclass(frozen=True)
class Certificate:
    """A certificate.

    Parameters
    ----------
    kind, title : str
        What it certifies, and of which device.
    number : sequence of (str, str)
        Number, dates and operator.
    identification, conditions : Facts
        Devices, and how was measured.
    picture : ReportFigure
        The target.
    results : Table or None
        The results with their uncertainties.
    statements : sequence of (str, str)
        Titles and texts, for example on uncertainty and traceability.
    banner : str
        Prominent notice, for example that the data is simulated; may be empty.
    verdict, verdict_text : str
        Verdict in words; may be empty.
    state : {'good', 'bad', 'open'}
        Colour of the verdict.
    """

    kind: str
    title: str
    number: Sequence[tuple[str, str]]
    identification: Facts
    conditions: Facts
    picture: ReportFigure
    results: Table | None = None
    statements: Sequence[tuple[str, str]] = ()
    banner: str = ""
    verdict: str = ""
    verdict_text: str = ""
    state: State = "open"


def render_certificate(sheet: Certificate) -> bytes:
    """Return a certificate as a self-contained HTML page for A4; all text is escaped."""
    template = environment().get_template("certificate.html")
    return template.render(sheet=sheet, version=version("labcdp")).encode()
