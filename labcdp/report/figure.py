"""The figures of an evaluation, with captions and alternative texts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportFigure:
    """A figure with its caption.

    Parameters
    ----------
    file_name : str
        Its name in the folder of the figures.
    png : bytes
        The picture.
    caption : str
        Caption.
    alternative : str
        Alternative text for screen readers.
    """

    file_name: str
    png: bytes
    caption: str
    alternative: str
