"""The commands by group; the module of a command, and all it needs, is imported when the command is run."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command as Typer takes it: a parameter that is a dataclass stands for an option for each of its fields.

    Parameters
    ----------
    command : callable
        Its dataclasses have the option of each field as default, ``typer.Option(...)``.
    """
    hints = get_type_hints(command)
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        if is_dataclass(hints[name]):
            groups[name] = hints[name]
            types = get_type_hints(hints[name])
            parameters += [_option(one.name, one.default, types[one.name]) for one in fields(hints[name])]
        else:
            parameters.append(_option(name, parameter.default, hints[name]))

    @wraps(command)
    def call(**given: Any) -> None:
        made = {
            name: group(**{one.name: given.pop(one.name) for one in fields(group)}) for name, group in groups.items()
        }
        command(**given, **made)

    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call


def _option(name: str, default: Any, annotation: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


#: Modules of the commands by group, as the help shows them. A command's function has its name.
_GROUPS = {
    "Start": {"demo": "bench.demo", "init": "start.init", "info": "start.info"},
    "Bench": {
        "doctor": "bench.doctor",
        "devices": "bench.devices",
        "snap": "bench.devices",
        "meter": "bench.devices",
        "bench": "bench.live",
        "acquire": "bench.acquire",
        "import": "bench.import_files",
        "simulate-bench": "bench.simulate_bench",
    },
    "Evaluate": {
        "calibrate": "evaluate.session",
        "evaluate": "evaluate.session",
        "luminance": "evaluate.luminance",
        "verify": "evaluate.verify",
        "history": "evaluate.history",
        "characterise": "evaluate.characterise",
        "twin": "evaluate.twin",
        "compare": "evaluate.compare",
    },
    "Pictures and videos": {
        "view": "pictures.rois",
        "rois": "pictures.rois",
        "image": "pictures.image",
        "image-map": "pictures.image_map",
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
    alone.command(name, help=_paragraphs(function.__doc__), rich_help_panel=_GROUP_OF[name])(grouped(function))
    return typer.main.get_command(alone)


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
    functions = (one for one in ast.parse(source).body if isinstance(one, ast.FunctionDef))
    return _paragraphs(next(ast.get_docstring(one) for one in functions if one.name == _function(name)))


def _paragraphs(text: str | None) -> str:
    """Put each paragraph of a docstring on one line, which the help breaks where the terminal ends."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in inspect.cleandoc(text or "").split("\n\n"))
