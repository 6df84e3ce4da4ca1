"""What the decoders of images, written in C, print: caught, so that it is said in its place."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile
from threading import Lock

#: How the messages of libpng, libjpeg and OpenEXR look.
_OF_DECODERS = re.compile(
    rb"libpng |Corrupt JPEG|Premature end of JPEG|Invalid SOS|Invalid component|Warning: unknown JFIF|"
    rb"Inconsistent progression|Unknown Adobe|.*\(EXR_ERR_"
)
_STANDARD_ERROR = 2
#: The file descriptor belongs to the whole process.
_lock = Lock()


@contextmanager
def decoder_messages() -> Iterator[list[str]]:
    """Catch what decoders print on standard error; gives a list that is filled at the end, each message once.

    Whatever else is printed meanwhile, by another thread for example, continues to standard error afterwards.
    """
    messages: list[str] = []
    with _lock, TemporaryFile() as caught:
        try:
            kept = os.dup(_STANDARD_ERROR)
        except OSError:
            # Without a standard error nothing can be printed on it.
            yield messages
            return
        _flush()
        os.dup2(caught.fileno(), _STANDARD_ERROR)
        try:
            yield messages
        finally:
            _flush()
            os.dup2(kept, _STANDARD_ERROR)
            os.close(kept)
            caught.seek(0)
            for line in caught.read().splitlines(keepends=True):
                if _OF_DECODERS.match(line):
                    messages.append(line.decode("utf-8", "replace").strip())
                else:
                    os.write(_STANDARD_ERROR, line)
            messages[:] = dict.fromkeys(messages)


def _flush() -> None:
    if sys.stderr is not None and not sys.stderr.closed:
        sys.stderr.flush()
