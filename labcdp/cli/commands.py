"""The commands by group, and how a function becomes one.

An argument of a command is a positional parameter of its function, an option one that is given by name. A parameter
that is a dataclass stands for an option for each of its fields. Their help are the sections Parameters of the
docstrings, in which a name may be followed by what the help shows for its value: ``pair : BRIGHT:DARK``. Every command
has ``--json``, which `labcdp.cli.terminal.print_result` heeds.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from ..core.errors import printable, short_words


@dataclass(frozen=True)
class As:
    """How a value is given on the command line, in ``Annotated[type, As(...)]``.

    Parameters
    ----------
    help : str
        Help, for parameters of several commands; the docstring of a command comes first.
    names : tuple of str
        Names of the option; by default that of the parameter.
    parse : callable or None
        Turns the text, or with `many` the texts, and the name of the option into the value.
    show : callable
        Turns a default into the text that stands for it.
    many : bool
        Whether it may be given several times.
    least, most : float or None
        Range of a number.
    """

    help: str = ""
    names: tuple[str, ...] = ()
    parse: Callable[[Any, str], Any] | None = None
    show: Callable[[Any], str] = str
    many: bool = False
    least: float | None = None
    most: float | None = None


class _Parameter:
    """A parameter of a command's function, or a field of a dataclass that is one, as Typer takes it.

    Parameters
    ----------
    name : str
        Its name.
    hint : type
        Its type.
    default : object
        `MISSING` or `inspect.Parameter.empty` for none.
    about : dict of str to (str, str)
        What stands for the values, and the help, by name.
    is_option : bool
        Whether it is given by name.
    """

    def __init__(self, name: str, hint: Any, default: Any, about: dict[str, tuple[str, str]], is_option: bool) -> None:
        self.name, (kind, self.how) = name, _unwrapped(hint)
        default = ... if default in (MISSING, inspect.Parameter.empty) else default
        how, many = self.how, get_origin(kind) is tuple and ... in get_args(kind)
        metavar, text = about.get(name, ("", how.help))
        if how.parse is not None:
            kind = list[str] if how.many else str | None
            default = default if default in (..., None) else how.show(default)
        elif many:
            kind = list[get_args(kind)[0]]  # type: ignore[misc]
        if (many or how.many) and default is not ...:
            default = []
        about_it: dict[str, Any] = {"help": text, "metavar": metavar or None, "min": how.least, "max": how.most}
        # Without another name a flag could be switched off, too.
        names = how.names or (f"--{name}/--no-{name}" if default is True else f"--{name}",)
        self.names = tuple(name.replace("_", "-") for name in names)
        made = typer.Option(default, *self.names, **about_it) if is_option else typer.Argument(default, **about_it)
        self.declared = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=made, annotation=kind)

    def value(self, given: Any) -> Any:
        """Return the value of what was given."""
        given = tuple(given) if isinstance(given, list) else given
        return given if self.how.parse is None or given is None else self.how.parse(given, self.names[0])


def _unwrapped(hint: Any) -> tuple[Any, As]:
    """Return a type without annotations, and how its values are given; ``Annotated[X, As(...)] | None`` too."""
    optional = [part for part in get_args(hint) if part is not NoneType] if NoneType in get_args(hint) else []
    if len(optional) == 1 and get_origin(optional[0]) is Annotated:
        kind, how = _unwrapped(optional[0])
        return kind | None, how
    if get_origin(hint) is not Annotated:
        return hint, As()
    kind, *notes = get_args(hint)
    return kind, next(note for note in notes if isinstance(note, As))


def _about(*documented: Any) -> dict[str, tuple[str, str]]:
    """Return what docstrings say of parameters, by name: what stands for the values, and the help."""
    entries_by_name: dict[str, tuple[str, str]] = {}
    for described in documented:
        _, _, section = inspect.cleandoc(described.__doc__ or "").partition("\n\nParameters\n----------\n")
        entries = re.findall(r"^(\w+)(?: : (.*))?\n((?: +.*\n?)+)", section.split("\n\n")[0], re.MULTILINE)
        entries_by_name |= {name: (metavar, " ".join(text.split())) for name, metavar, text in entries}
    return entries_by_name


#: Name of the command that runs, and what it was given by name of the parameter.
COMMAND: ContextVar[str] = ContextVar("command")
GIVEN: ContextVar[Mapping[str, Any]] = ContextVar("given")


def as_json() -> bool:
    """Whether the result of the command is printed as JSON."""
    return bool(GIVEN.get()["as_json"])


#: Option of every command; those with other options for results have it among these.
Json = Annotated[bool, As("Print the result as JSON.", ("--json",))]


def as_command(command: str, function: Callable[..., None]) -> Callable[..., None]:
    """Return the function of a command as Typer takes it."""
    parameters: list[_Parameter] = []
    groups: dict[str, tuple[Any, list[_Parameter]]] = {}
    hints, about = get_type_hints(function, include_extras=True), _about(function)
    for name, parameter in inspect.signature(function).parameters.items():
        if is_dataclass(hints[name]):
            group: Any = hints[name]
            types, documented = get_type_hints(group, include_extras=True), _about(*reversed(group.__mro__))
            members = [_Parameter(it.name, types[it.name], it.default, documented, True) for it in fields(group)]
            groups[name] = group, members
            parameters += members
        else:
            is_option = parameter.kind is inspect.Parameter.KEYWORD_ONLY
            parameters.append(_Parameter(name, hints[name], parameter.default, about, is_option))
    if all(parameter.name != "as_json" for parameter in parameters):
        parameters.append(_Parameter("as_json", Json, False, {}, True))

    @wraps(function)
    def call(**given: Any) -> None:
        COMMAND.set(command)
        GIVEN.set(given)
        values = {parameter.name: parameter.value(given[parameter.name]) for parameter in parameters}
        made = {
            name: group(**{parameter.name: values.pop(parameter.name) for parameter in ms})
            for name, (group, ms) in groups.items()
        }
        values.pop("as_json", None)
        function(**values, **made)

    call.__signature__ = inspect.Signature([parameter.declared for parameter in parameters])  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.declared.annotation for parameter in parameters}
    return call


#: Modules of the commands by group, as the help shows them. A command's function has its name.
_GROUPS = {
    "Start": {"demo": "start", "init": "start", "info": "info"},
    "Bench": {
        "doctor": "bench.doctor",
        "devices": "bench.devices",
        "snap": "bench.devices",
        "meter": "bench.devices",
        "bench": "bench.live",
        "acquire": "bench.acquire",
        "import": "bench.acquire",
        "simulate-bench": "bench.simulate_bench",
    },
    "Evaluate": {
        "calibrate": "session",
        "evaluate": "session",
        "luminance": "luminance",
        "verify": "camera",
        "history": "compare",
        "characterise": "camera",
        "twin": "camera",
        "compare": "compare",
    },
    "Pictures and videos": {
        "view": "pictures.rois",
        "rois": "pictures.rois",
        "image": "pictures.image",
        "image-map": "pictures.image_map",
        "sfr": "pictures.sfr",
        "flare": "pictures.flare",
        "video": "pictures.video",
    },
    "Simulation": {
        "presets": "simulation",
        "simulate": "simulation",
        "sweep": "simulation",
        "reproduce": "simulation",
    },
}
_GROUP_OF = {name: group for group, members in _GROUPS.items() for name in members}


def all_commands() -> dict[str, Any]:
    """Import all commands, in the order of the help."""
    return {name: _command(name) for name in _GROUP_OF}


@cache
def _command(name: str) -> Any:
    function = getattr(import_module(f".{_module(name)}", __package__), _function(name))
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    about, panel = _paragraphs(function.__doc__), _GROUP_OF[name]
    alone.command(name, cls=_Command, help=about, rich_help_panel=panel)(as_command(name, function))
    return typer.main.get_command(alone)


#: Typer has its own copy of Click, of which this is not public.
_UsageError: Any = typer.BadParameter.__base__


class _Command(TyperCommand):
    """A command that does not take one of its options for the value of another."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse what is given."""
        options: list[Any] = [option for option in self.get_params(ctx) if option.param_type_name == "option"]
        names = {name for option in options for name in (*option.opts, *option.secondary_opts)}
        with_value = {name for option in options if not option.is_flag for name in option.opts}
        rest = iter(args)
        for name in rest:
            if name == "--":
                break
            if name not in with_value:
                continue
            value = next(rest, None)
            if value is not None and value.partition("=")[0] in names:
                raise _UsageError(f"{name} has no value: the option {value.partition('=')[0]} follows it", ctx)
        return super().parse_args(ctx, args)


class Commands(TyperGroup):
    """All commands. To list them, only the first sentences of their help are read."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = {name: TyperCommand(name) for name in _GROUP_OF}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Give a command as the list shows it, with its help and without its options."""
        if cmd_name not in _GROUP_OF:
            return None
        return TyperCommand(cmd_name, help=_help(cmd_name), rich_help_panel=_GROUP_OF[cmd_name])

    def invoke(self, ctx: Any) -> Any:
        """Run the command; what is said of its arguments is short."""
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            error.message = short_words(printable(error.message))
            raise

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Give the command to be run."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, _command(name or args[0]), rest


def _module(name: str) -> str:
    return _GROUPS[_GROUP_OF[name]][name]


def _function(name: str) -> str:
    return {"import": "import_files"}.get(name, name.replace("-", "_"))


def _help(name: str) -> str:
    """Help of a command whose module is not imported for it."""
    source = Path(__file__).parent.joinpath(*_module(name).split(".")).with_suffix(".py").read_text(encoding="utf-8")
    # Parsing all modules would take a quarter of the time of the list of commands.
    match = re.search(rf'^def {_function(name)}\(.*?"""(.*?)"""', source, re.DOTALL | re.MULTILINE)
    return _paragraphs(match and match[1])


def _paragraphs(text: str | None) -> str:
    """Put each paragraph of a docstring, before its sections, on one line, which the help breaks at the terminal."""
    before = re.split(r"\n\n\w+\n-{3,}\n", inspect.cleandoc(text or ""))[0]
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in before.split("\n\n"))
