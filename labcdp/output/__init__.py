"""Output: files and folders of results, written whole, and never over what labcdp did not write."""

from .file import write_file
from .folder import LIST_FILE, Destination, ResultsFolder, check_file, open_results, read_list, results_journal

__all__ = [
    "LIST_FILE",
    "Destination",
    "ResultsFolder",
    "check_file",
    "open_results",
    "read_list",
    "results_journal",
    "write_file",
]
