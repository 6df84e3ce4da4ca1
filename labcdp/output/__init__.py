"""Output: files and folders of results, written whole, and never over what labcdp did not write."""

from .file import write_file as write_file
from .file_list import LIST_FILE as LIST_FILE
from .file_list import check_file as check_file
from .file_list import read_list as read_list
from .folder import Destination as Destination
from .folder import ResultsFolder as ResultsFolder
from .folder import open_results as open_results
from .journal import results_journal as results_journal
