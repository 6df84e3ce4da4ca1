"""Reading from disk: regular files of a limited size, whose text and values are checked before anyone uses them.

Whatever is wrong with a file becomes one line of `InputError` that names the file and quotes little of it.
"""

from .documents import number_of, parse_json, parse_toml, read_json, read_toml, record_of, validated_as
from .files import (
    file_sha256,
    is_file,
    open_regular,
    quoted,
    read_at_most,
    read_bytes,
    read_text,
    reading,
    real_path,
    reason,
    require_regular,
    shortened,
)

__all__ = [
    "file_sha256",
    "is_file",
    "number_of",
    "open_regular",
    "parse_json",
    "parse_toml",
    "quoted",
    "read_at_most",
    "read_bytes",
    "read_json",
    "read_text",
    "read_toml",
    "reading",
    "real_path",
    "reason",
    "record_of",
    "require_regular",
    "shortened",
    "validated_as",
]
