"""Reading from disk: regular files of a limited size, whose text and values are checked before anyone uses them.

Whatever is wrong with a file becomes one line of `InputError` that names the file and quotes little of it.
"""

from .documents import number_of as number_of
from .documents import parse_json as parse_json
from .documents import parse_toml as parse_toml
from .documents import read_json as read_json
from .documents import read_toml as read_toml
from .documents import record_of as record_of
from .documents import validated_as as validated_as
from .files import file_sha256 as file_sha256
from .files import is_file as is_file
from .files import open_regular as open_regular
from .files import quoted as quoted
from .files import read_at_most as read_at_most
from .files import read_bytes as read_bytes
from .files import read_text as read_text
from .files import reading as reading
from .files import real_path as real_path
from .files import reason as reason
from .files import require_regular as require_regular
from .files import shortened as shortened
from .text import read_csv as read_csv
