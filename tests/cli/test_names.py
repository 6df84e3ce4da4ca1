"""Files of any name a file system allows are evaluated, and their names are shown escaped."""

import json
import os
import shutil

import pytest

from labcdp.chain import Chain
from labcdp.cli.options import default_folder

from ..conftest import valid
from .test_foreign_files import run

#: Bytes that are no UTF-8, control characters, a colon, marks of patterns and of formats, the direction of writing.
NAMES = {
    "bytes": "Pr\udcfcf-\udcff",
    "controls": "a\n\x1b[31m\tb",
    "marks": "10:15 %03d *'{}",
    "right to left": "\u202eabc",
}
#: Commands with the names of their inputs; @ stands for the name.
COMMANDS = {
    "image": ["@.png", "--roi", "@.json"],
    "image-map": ["@.png", "--region-size", "10"],
    "flare": ["@.png", "--source", "@.json"],
    "video": ["@.avi", "--roi", "@.json", "--method", "fixed", "--annotated", "--frames"],
    "simulate": ["@.toml"],
    "sweep": ["@.toml", "--exact", "--over", "scene.contrast=0.2,0.5"],
    "compare": ["@", "@"],
    "info": ["@.png"],
    "rois": ["@.png", "--roi", "@.json", "--detect", "superpixels", "--no-page", "--output", "new-@.json"],
}


@pytest.fixture
def renamed(inputs, tmp_path, monkeypatch):
    """Put the inputs into the current folder under a name."""
    monkeypatch.chdir(tmp_path)

    def rename(name):
        for source in ("a.png", "a.avi", "rois.json", "small.toml"):
            shutil.copy(inputs / source, f"{name}{os.path.splitext(source)[1]}")
        shutil.copytree(inputs / "c", name)

    return rename


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        pytest.param(kind, command, marks=() if kind == "bytes" or command == "image" else pytest.mark.long)
        for kind in NAMES
        for command in COMMANDS
    ],
)
def test_results_of_a_file_of_any_name(renamed, capsys, kind, command):
    name = NAMES[kind]
    renamed(name)
    output = [] if command in ("info", "rois") else ["--output", f"out-{name}"]
    assert run(command, *(one.replace("@", name) for one in COMMANDS[command]), *output, "--json") == ""
    result = valid(capsys.readouterr().out)
    json.dumps(result, ensure_ascii=False).encode()
    if kind == "bytes":
        assert r"Pr\xfcf-\xff" in json.dumps(result, ensure_ascii=False).replace("\\\\", "\\")
    for path in map(os.fsencode, os.listdir(f"out-{name}") if output else ()):
        full = os.path.join(os.fsencode(f"out-{name}"), path)
        if path.endswith((b".json", b".html", b".toml")):
            with open(full, encoding="utf-8") as file:
                assert "\udcfc" not in file.read()
    if output:
        assert run("info", f"out-{name}") == ""
        assert run("info", f"out-{name}/results.json") == ""


def test_a_folder_with_such_a_file_is_evaluated_whole(renamed, labcdp_in, tmp_path, inputs):
    renamed(NAMES["bytes"])
    (tmp_path / "folder").mkdir()
    shutil.copy(inputs / "a.png", "folder/b.png")
    shutil.copy(inputs / "a.png", "folder/Pr\udcfcf.png")
    with open("folder/Pr\udcfcf.png", "ab") as file:
        file.write(b" ")
    shutil.copy(inputs / "rois.json", "rois.json")
    arguments = ("image", "folder", "--roi", "rois.json")
    done = labcdp_in(tmp_path, *arguments, "--json", environment={"PYTHONIOENCODING": "ascii"})
    rows = valid(done.stdout)["tables"]["pictures"]["rows"]
    assert len(rows) == 2
    assert done.stdout.isascii()
    done = labcdp_in(tmp_path, *arguments, "--force", environment={"LC_ALL": "C", "PYTHONUTF8": "0"})
    assert (done.returncode, "Traceback" in done.stderr) == (0, False)
    done = labcdp_in(tmp_path, "image", "not-h\udce9re.png", "--roi", "rois.json")
    assert "not-h\\xe9re.png cannot be read (No such file or directory)" in done.stderr


def test_a_video_of_such_a_name_is_resumed(renamed, tmp_path):
    name = NAMES["bytes"]
    renamed(name)
    arguments = ["video", "folder", "--roi", f"{name}.json", "--method", "fixed", "--output", f"out-{name}"]
    (tmp_path / "folder").mkdir()
    shutil.copy(f"{name}.avi", f"folder/{name}.avi")
    assert run(*arguments) == ""
    shutil.copy(f"{name}.avi", "folder/b.avi")
    with open("folder/b.avi", "ab") as file:
        file.write(bytes(1))
    assert run(*arguments) == ""
    assert sorted(one for one in os.listdir(f"out-{name}") if os.path.isdir(f"out-{name}/{one}")) == [
        "Pr-xfcf--xff",
        "b",
    ]


def test_a_session_of_such_a_name_is_evaluated_as_before(inputs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = NAMES["bytes"]
    shutil.copytree(inputs / "s", name)
    assert run("evaluate", name, "--recalibrate", "--output", f"out-{name}") == ""
    again = ("--against", f"out-{name}/results.json", "--output", f"again-{name}")
    assert run("evaluate", name, "--recalibrate", *again) == ""


@pytest.mark.parametrize("kind", NAMES)
def test_a_chain_of_a_sensor_and_a_preset_of_any_name(renamed, tmp_path, kind):
    name = NAMES[kind]
    renamed(name)
    with open(f"{name}-sheet.toml", "w") as file:
        file.write("[emva1288]\nk_dn_per_e = 0.25\n")
    assert run("init", "chain", f"new-{name}.toml", "--preset", f"{name}.toml", "--sensor", f"{name}-sheet.toml") == ""
    ((_, sensor),) = Chain.load(f"new-{name}.toml").sensors
    assert sensor.k_dn_per_e == 0.25


@pytest.mark.parametrize(
    ("beside", "names"),
    [
        (("night.png",), ("night-image",)),
        (("night.png", "night.json", "night.zip"), ("night-image",)),
        (("night.png", "night.jpg"), ("night.png-image", "night.jpg-image")),
        (("night.CR2", "night.JPG"), ("night.CR2-image", "night.JPG-image")),
    ],
)
def test_pictures_that_differ_in_their_suffix_have_folders_of_their_own(tmp_path, beside, names):
    for name in beside:
        (tmp_path / name).touch()
    assert tuple(str(default_folder(tmp_path / name, "image")) for name in beside[: len(names)]) == names
