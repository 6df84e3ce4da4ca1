"""Report: an evaluation as tables, figures, a page and a spreadsheet."""

from .results import write_results
from .tables import Table, contrast_table, summary_table

__all__ = ["Table", "contrast_table", "summary_table", "write_results"]
