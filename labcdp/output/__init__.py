"""Output: files and folders of results, written whole, and never over what labcdp did not write."""

from .file import write_file as write_file
from .folder import LIST_FILE as LIST_FILE
from .folder import Destination as Destination
from .folder import ResultsFolder as ResultsFolder
from .folder import check_file as check_file
from .folder import open_results as open_results
from .folder import read_list as read_list
from .folder import results_journal as results_journal
