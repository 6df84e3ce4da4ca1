"""Writing a wire transcript; `labcdp.drivers.wire_transcript` has its format, and reads it."""

from __future__ import annotations

import json
import logging
import time
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TextIO

from ..errors import InputError
from .wire_transcript import PortSettings, TranscriptHeader, WireEntry

_log = logging.getLogger(__name__)


class TranscriptWriter:
    """Writes a transcript while the wire is in use; each line is flushed as it happens.

    Parameters
    ----------
    path : path
        File to create.
    meter : str
        Model of the meter.
    port : str
        Name of the port.
    settings : PortSettings
        Its settings.
    timeout_s : float
        How long the driver waits for a reply, in seconds.
    """

    def __init__(
        self, path: str | PathLike[str], meter: str, port: str, settings: PortSettings, timeout_s: float
    ) -> None:
        self._path = Path(path)
        self._about = (meter, port, settings, timeout_s)
        self._started_s: float | None = None
        self._file: TextIO | None = None

    def start(self) -> None:
        """Create the file; one this writer created before is continued.

        Raises
        ------
        InputError
            If the file exists already, or cannot be created.
        """
        is_new = self._started_s is None
        try:
            self._file = open(self._path, "x" if is_new else "a", encoding="ascii")  # noqa: SIM115
        except OSError as error:
            if not is_new:
                self._give_up(error)
            elif isinstance(error, FileExistsError):
                raise InputError(f"{self._path} exists already: give the transcript another name") from None
            else:
                raise InputError(
                    f"{self._path} cannot be written ({error.strerror}): give the transcript another name"
                ) from error
        if is_new:
            self._started_s = time.monotonic()
            self._write(TranscriptHeader(*self._about, datetime.now(UTC), version("labcdp")).to_dict())

    def record(self, direction: Literal["sent", "received"], data: bytes, at_s: float) -> None:
        """Write one entry; `at_s` is the time on the monotonic clock."""
        if self._started_s is not None:
            self._write(WireEntry(at_s - self._started_s, direction, data).to_dict())

    def close(self) -> None:
        """Close the file; may be called twice."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _write(self, values: dict[str, Any]) -> None:
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(values) + "\n")
            self._file.flush()
        except OSError as error:
            file, self._file = self._file, None
            with suppress(OSError):  # what is left in its buffer fails again
                file.close()
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        # The readings matter more than their transcript.
        _log.warning("%s cannot be written (%s): the transcript ends here", self._path, error.strerror)
