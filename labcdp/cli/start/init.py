"""Command init: write templates."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

import typer

from ...chain import preset_text
from ...core.errors import InputError
from ...core.result import Result
from ...core.table import Column, Table
from ...evaluate.camera.sensor import chain_text
from ...output import write_file
from ...session.configuration import example_camera, example_configuration, example_simulated_bench
from ..output import FORCE_OPTION, output_file
from ..terminal import JSON_OPTION, print_result, say

#: Default preset of a chain.
DEFAULT_PRESET = "manta-g505"


class Template(StrEnum):
    """Templates."""

    bench = "bench"
    chain = "chain"
    camera = "camera"
    simulated_bench = "simulated-bench"


#: The command that uses the file.
_NEXT = {
    Template.bench: "labcdp acquire {file} my-session --simulated",
    Template.chain: "labcdp simulate {file}",
    Template.simulated_bench: "labcdp acquire PLAN rehearsal --simulated-bench {file}",
    Template.camera: "labcdp image PICTURE --camera-spec {file}",
}


def init(
    context: typer.Context,
    template: Template = typer.Argument(
        help="bench: plan of an acquisition; chain: imaging chain; camera: camera specification; simulated-bench: its "
        "devices."
    ),
    file: Path = typer.Argument(help="New TOML file to write."),
    preset: str | None = typer.Option(
        None, help="For a chain: preset to start from, see labcdp presets.", show_default=DEFAULT_PRESET
    ),
    sensor: Path | None = typer.Option(
        None,
        help="For a chain: EMVA 1288 results for its sensor, of labcdp characterise (results.json or folder) or of a "
        "data sheet (TOML with a table emva1288); the preset gives the rest.",
    ),
    force: bool = FORCE_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Write a commented template of a bench plan, an imaging chain, a camera specification or a simulated bench.

    Example: labcdp init bench bench.toml
    """
    path = output_file(context, file, force, option="FILE")
    write_file(path, _text(template, preset, sensor).encode(), force=force)
    command = _NEXT[template].format(file=file)
    if as_json:
        columns = (Column("template", "template"), Column("next_command", "next command"))
        row = {"template": template.value, "next_command": command}
        print_result(Result("init", str(file), (Table.of_rows("template", "Template", columns, [row]),)), as_json)
    else:
        say(f"Written: {file}")
        say(f"Next: {command}")


def _text(template: Template, preset: str | None, sensor: Path | None) -> str:
    if template is Template.chain:
        chosen = preset or DEFAULT_PRESET
        return preset_text(chosen) if sensor is None else chain_text(chosen, sensor)
    for option, given in (("--preset", preset), ("--sensor", sensor)):
        if given is not None:
            raise InputError(f"{option} is {str(given)!r}, but only a chain has one: leave it out")
    texts = {
        Template.bench: example_configuration,
        Template.camera: example_camera,
        Template.simulated_bench: example_simulated_bench,
    }
    return texts[template]()
