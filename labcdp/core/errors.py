"""The error tree: every message says what was wrong, with which value, and what to do."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import inf


def printable(text: str) -> str:
    r"""Return the text with all control characters, and what else has no picture, escaped: ``\\x1b`` for ESC.

    Examples
    --------
    >>> from labcdp.core.errors import printable
    >>> print(printable(chr(27) + "[2J"))
    \x1b[2J
    """
    return text if text.isprintable() else "".join(map(_escaped, text))


def _escaped(character: str) -> str:
    if "\udc80" <= character <= "\udcff":
        # A byte of a file name that is no UTF-8 (PEP 383).
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character if character.isprintable() else character.encode("unicode_escape").decode()


#: What UTF-8 cannot encode: bytes of file names that are none, and halves of characters.
_SURROGATE = re.compile("[\ud800-\udfff]")


def encodable(text: str) -> str:
    r"""Return the text with what UTF-8 cannot encode escaped: ``\\xfc`` for a byte of a file name that is no UTF-8.

    Examples
    --------
    >>> from labcdp.core.errors import encodable
    >>> print(encodable("gr" + chr(0xDCFC) + "n.png"))
    gr\xfcn.png
    """
    return text if text.isascii() else _SURROGATE.sub(lambda found: _escaped(found[0]), text)


#: Characters of one word of a message, as of a path: what is left out of a longer one is its middle.
_WORD = re.compile(r"(\S{60})\S{9,}(\S{32})")
#: What is quoted, in which there may be spaces; no apostrophe.
_QUOTE = re.compile(r"""(?<!\w)(['"])(.*?)\1(?!\w)""")
#: Characters of a message: what is left out of a longer one is its middle, as it ends with what to do.
_MOST_CHARACTERS, _LAST = 2000, 300


def short_words(text: str) -> str:
    """Return the text with long words and quotes cut, such as paths and what a file or user gave, and itself.

    Examples
    --------
    >>> from labcdp.core.errors import short_words
    >>> len(short_words("x" * 100_000)) < 1000
    True
    """
    text = _WORD.sub(r"\1...\2", text)
    if len(text) > _MOST_CHARACTERS:
        text = f"{text[: _MOST_CHARACTERS - _LAST - 3]}...{text[-_LAST:]}"
    return _QUOTE.sub(_short_quote, text)


def _short_quote(found: re.Match[str]) -> str:
    mark, quoted = found.groups()
    return found[0] if len(quoted) <= 100 else f"{mark}{quoted[:60]}...{quoted[-32:]}{mark}"


class LabcdpError(Exception):
    """Base of every error labcdp raises on purpose: a short printable line, whatever a file or device says.

    Examples
    --------
    >>> from labcdp import InputError, LabcdpError, Roi
    >>> try:
    ...     Roi.rectangle("road", 0, 0, 0, 10)
    ... except LabcdpError as error:
    ...     print(isinstance(error, InputError))
    True
    """

    def __str__(self) -> str:
        """Return the message."""
        return printable(" ".join(short_words(super().__str__()).splitlines()))


class InputError(LabcdpError, ValueError):
    """A value, array, region or file the caller gave cannot be used.

    Parameters
    ----------
    message : str
        What is wrong, and what to give.
    key : str
        Parameter with which the message begins; empty if it begins with none.

    Examples
    --------
    >>> from labcdp import InputError
    >>> InputError("epsilon is -1: give a fraction above 0", key="epsilon").problem
    'is -1: give a fraction above 0'
    """

    def __init__(self, message: str = "", key: str = "") -> None:
        super().__init__(message)
        self.key = key

    @property
    def problem(self) -> str:
        """The message without the parameter that it begins with."""
        return str(self)[len(self.key) :].lstrip()


class ConfigurationError(InputError):
    """A configuration file has an unknown key, or a value of the wrong type, unit or range.

    Examples
    --------
    >>> from labcdp.chain import Chain
    >>> from labcdp.core.errors import ConfigurationError
    >>> try:
    ...     Chain.from_toml("[scene]", "my-chain.toml")
    ... except ConfigurationError as error:
    ...     print(error)
    my-chain.toml: scene.type is missing: give one of flat, checkerboard, step-chart, patches, image, lamp
    """


class PredictionError(InputError):
    """A chain cannot be predicted without random numbers, but it can be simulated.

    Examples
    --------
    >>> from labcdp.core.errors import InputError, PredictionError
    >>> issubclass(PredictionError, InputError)
    True
    """


class SessionError(LabcdpError):
    """A recorded session is missing a file, was altered, or is in use.

    Examples
    --------
    >>> from labcdp.core.errors import SessionError
    >>> from labcdp.session import Session
    >>> try:
    ...     Session.open("no-such-session")
    ... except SessionError as error:
    ...     print(error)
    no-such-session is not a session: it has no journal.jsonl; give the folder of a session
    """


class CalibrationError(LabcdpError):
    """The readings or frames do not support a calibration, or a calibration does not fit a frame.

    Examples
    --------
    >>> from labcdp.calibration import observe_patches
    >>> from labcdp.core.errors import CalibrationError
    >>> try:
    ...     observe_patches([], [])
    ... except CalibrationError as error:
    ...     print(error)
    there is no frame: give at least 2 frames of one exposure
    """


class DeviceError(LabcdpError):
    """A camera or meter is absent, busy, silent or answered with an error.

    Parameters
    ----------
    cause : str
        What was observed.
    remedy : str or None
        What to do; the message has it after the cause.

    Examples
    --------
    >>> from labcdp.core.errors import DeviceError
    >>> print(DeviceError("the meter is silent", "switch it on"))
    the meter is silent: switch it on
    """

    def __init__(self, cause: str, remedy: str | None = None) -> None:
        super().__init__(cause if remedy is None else f"{cause}: {remedy}")
        self.cause = cause
        self.remedy = remedy


def require_not_negative(**values: float | Iterable[float]) -> None:
    """Raise InputError for a number, or one of several, that is negative or not finite; by its name.

    Examples
    --------
    >>> from labcdp.core.errors import require_not_negative
    >>> require_not_negative(read_noise_e=-1.0)
    Traceback (most recent call last):
        ...
    labcdp.core.errors.InputError: read_noise_e is -1: give 0 or a positive number
    """
    for name, value in values.items():
        for number in value if isinstance(value, Iterable) else (value,):
            if not 0 <= number < inf:
                raise InputError(f"{name} is {number:g}: give 0 or a positive number")


@contextmanager
def naming(where: object, kind: type[LabcdpError] = InputError) -> Iterator[None]:
    """Say first what an InputError is about, such as a file, its line or a key, and raise it as another kind.

    Examples
    --------
    >>> from labcdp.core.errors import InputError, naming
    >>> with naming("my-chain.toml"):
    ...     raise InputError("bits is 40: give 1 to 24")
    Traceback (most recent call last):
        ...
    labcdp.core.errors.InputError: my-chain.toml: bits is 40: give 1 to 24
    """
    try:
        yield
    except InputError as error:
        raise kind(f"{where}: {error}") from error
