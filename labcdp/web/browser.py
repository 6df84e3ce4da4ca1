"""Opens a page in the user's browser without showing its token to others."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from .server import Address

_REDIRECT = """<!doctype html>
<meta charset="utf-8">
<title>labcdp</title>
<meta http-equiv="refresh" content="0; url={url}">
<p><a href="{url}">Open labcdp</a></p>
"""


@contextmanager
def opened_in_browser(address: Address) -> Iterator[Path]:
    """Open a page in the browser while the context lasts; yields the file that leads there.

    The command line of a browser can be read by all users of a computer, so the address with its token is not put
    there, but into a file that only this user can read, which redirects to it.
    """
    import webbrowser

    import typer

    # The folder has mode 0700.
    with TemporaryDirectory(prefix="labcdp-page-", ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "labcdp.html"
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as redirect:
            redirect.write(_REDIRECT.format(url=escape(address.url)))
        if typer.launch(str(file)) != 0:
            webbrowser.open(file.as_uri())
        yield file
