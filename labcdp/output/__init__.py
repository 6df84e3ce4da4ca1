"""Output: files and folders of results, written whole, and never over what labcdp did not write."""

from .file import write_file
from .file_list import LIST_FILE, check_file, read_list
from .folder import Destination, ResultsFolder, open_results, write_files

__all__ = [
    "LIST_FILE",
    "Destination",
    "ResultsFolder",
    "check_file",
    "open_results",
    "read_list",
    "write_file",
    "write_files",
]
