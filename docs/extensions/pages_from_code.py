"""Pages of the reference that are written from the code: commands, API, JSON schema."""

import importlib
import inspect
import json
import re
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from labcdp.cli.commands import all_commands
from labcdp.tracking.settings import TrackingSettings

#: Modules of the API reference, and the title of each.
MODULES = {
    "labcdp": "What most programs need",
    "labcdp.metrics": "CDP and other metrics",
    "labcdp.chain": "The imaging chain",
    "labcdp.calibration": "Calibration",
    "labcdp.drivers": "Cameras and meters",
    "labcdp.drivers.camera": "What a camera is",
    "labcdp.drivers.camera_settings": "Settings of a camera",
    "labcdp.drivers.meter": "What a meter is",
    "labcdp.drivers.manual": "Meters read by hand",
    "labcdp.acquire": "Acquisition",
    "labcdp.session": "Sessions",
    "labcdp.files": "Pictures",
    "labcdp.regions": "Regions",
    "labcdp.tracking": "Regions that follow their objects",
    "labcdp.evaluate.picture.edges.map": "Maps of edges",
    "labcdp.evaluate.picture.edges.edges": "Edges",
    "labcdp.evaluate.sweep.thesis": "The 2018 thesis",
    "labcdp.core.frame": "Frames",
    "labcdp.core.reading": "Readings",
    "labcdp.core.errors": "Errors",
}

#: Classes, functions, constants with a comment of their own, and what a package imports under its own name, of a module
#: that does not list its public names.
PUBLIC = r"^(?:class |def |#: .*\n(?=[A-Z])|from \.[\w.]+ import \w+ as )([A-Za-z]\w*)"


def _escaped(text: str) -> str:
    """Return text that Markdown shows as it is in a cell of a table."""
    for mark in ("\\", "|", "<", "*", "_", "[", "`", "$"):
        text = text.replace(mark, "\\" + mark)
    return " ".join(text.split())


def commands_page() -> str:
    """Return every command with its arguments and options."""
    commands: dict[str, Any] = all_commands()
    introduction = "What `--help` prints. [Exit status](../exit-status.md) and [results](../results.md) are common."
    lines = ["# Commands", "", introduction]
    group = None
    for name, command in commands.items():
        if command.rich_help_panel != group:
            group = command.rich_help_panel
            lines += ["", f"## {group}"]
        context = command.make_context(name, [], resilient_parsing=True)
        usage = " ".join(piece.replace("{", "").replace("}", "") for piece in command.collect_usage_pieces(context))
        lines += ["", f"### labcdp {name}", ""]
        for paragraph in command.help.split("\n\n"):
            example = paragraph.removeprefix("Example: ")
            lines += [f"```sh\n{example}\n```" if example != paragraph else _escaped(paragraph), ""]
        lines += ["```text", f"labcdp {name} {usage}", "```", "", "| | |", "|---|---|"]
        records = [parameter.get_help_record(context) for parameter in command.params]
        lines += [f"| {_code(record[0])} | {_escaped(record[1])} |" for record in records if record]
    return "\n".join(lines) + "\n"


def _code(text: str) -> str:
    return f"`{text}`".replace("|", "\\|")


def _directive(module: str, name: str, thing: object) -> str:
    kind, members = ("autofunction" if inspect.isfunction(thing) else "autodata"), ""
    if inspect.isclass(thing):
        kind, members = "autoclass", "\n   :members:"
    return f".. {kind}:: {module}.{name}{members}\n"


def api_page(module: str, title: str, elsewhere: dict[int, str]) -> str:
    """Return the public names of a package with their docstrings; each object stands where it is first named."""
    loaded = importlib.import_module(module)
    names = getattr(loaded, "__all__", None) or re.findall(PUBLIC, inspect.getsource(loaded), re.MULTILINE)
    head = f"{title}: ``{module}``"
    lines = [head, "=" * len(head), "", f".. automodule:: {module}", "   :no-members:", ""]
    for name in names:
        thing = getattr(loaded, name)
        if inspect.ismodule(thing):
            continue
        if id(thing) in elsewhere:
            lines += [f":py:obj:`{module}.{name} <{elsewhere[id(thing)]}>`", ""]
        else:
            elsewhere[id(thing)] = f"{module}.{name}"
            lines.append(_directive(module, name, thing))
    return "\n".join(lines)


def schema_page() -> str:
    """Return the schema of all results."""
    text = files("labcdp").joinpath("data/schema/result.schema.json").read_text(encoding="utf-8")
    schema = json.loads(text)
    rows = [
        f"| `{name}` | {_escaped(about.get('description', '') or 'see below')} |"
        for name, about in schema["properties"].items()
    ]
    introduction = "`results.json` and `--json` of every command follow this JSON Schema, which is part of the package."
    table = ["| key | meaning |", "|---|---|", *rows]
    return "\n".join(["# JSON schema", "", introduction, "", *table, "", "```json", text.rstrip(), "```", ""])


def tracking_constants_page() -> str:
    """Return the constants of tracking with range, meaning and origin."""
    introduction = (
        "Defaults of `labcdp.tracking.settings.TrackingSettings`; what they do is in [](../../concepts/tracking.md)."
    )
    lines = [
        "# Constants of tracking",
        "",
        introduction,
        "",
        "| name | value | accepted | meaning | from |",
        "|---|---|---|---|---|",
    ]
    for constant in fields(TrackingSettings):
        about = constant.metadata
        cells = f"`{constant.name}`", f"{constant.default:g}", f"{about['least']:g} to {about['most']:g}"
        lines.append(f"| {' | '.join(cells)} | {_escaped(about['meaning'])} | {_escaped(about['origin'])} |")
    return "\n".join(lines) + "\n"


def write_pages(application: Sphinx) -> None:
    """Write those whose content changed, so that Sphinx reads no others again."""
    folder = Path(application.srcdir) / "reference" / "generated"
    folder.mkdir(exist_ok=True)
    elsewhere: dict[int, str] = {}
    pages = {
        "commands.md": commands_page(),
        "schema.md": schema_page(),
        "tracking-constants.md": tracking_constants_page(),
    }
    pages |= {f"{module}.rst": api_page(module, title, elsewhere) for module, title in MODULES.items()}
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(application: Sphinx) -> dict[str, bool]:
    """Tell Sphinx when to write the pages."""
    application.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
