"""What ``import labcdp`` gives, and what it needs."""

import subprocess
import sys
from pathlib import Path

import labcdp

#: Modules that other systems than Linux and macOS do not have, and those of devices.
POSIX = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty", "gi", "serial")

BLOCKED = f"""
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {POSIX!r}:
            raise ImportError(f"{{name}} is blocked")

sys.meta_path.insert(0, Blocked())
for name in {POSIX!r}:
    sys.modules.pop(name, None)
"""


def python(code, *arguments):
    program = [sys.executable, "-c", code, *arguments]
    return subprocess.run(program, check=True, capture_output=True, text=True, timeout=900).stdout


def test_every_public_name_is_listed_and_documented():
    assert set(labcdp.__all__) < set(dir(labcdp))
    assert all(getattr(labcdp, name).__doc__ for name in labcdp.__all__)


def test_import_loads_nothing_heavy():
    loaded = python("import sys, labcdp; dir(labcdp); print(*sys.modules)").split()
    assert not {"numpy", "scipy", "xarray", "cv2", "matplotlib", "pydantic", "typer"} & set(loaded)


def test_a_program_with_every_public_name_and_commands_run_without_posix_modules(
    picture, rois, video, tmp_path, monkeypatch
):
    program = Path(__file__).with_name("user_program.py")
    text = program.read_text()
    assert all(f"labcdp.{name}" in text for name in labcdp.__all__)
    monkeypatch.chdir(tmp_path)
    code = """
import runpy
import warnings

program, picture, video, rois, *commands = sys.argv[1:]
warnings.simplefilter("error")
sys.argv[1:] = [picture, video, rois, "."]
runpy.run_path(program, run_name="__main__")
warnings.resetwarnings()
from labcdp.cli import main

for command in commands:
    sys.argv[1:] = command.split()
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""
    commands = (
        "rois --help",
        f"image {picture} --roi {rois} -o i",
        f"video {video} --roi {rois} --method fixed --stop 2 -o v",
        "simulate manta-g505 --set sensor.width=320 --set sensor.height=240 --set scene.square_px=32 -o c",
        "sweep manta-g505 --exact --over scene.contrast=50%:150%:3 -o s",
    )
    python(BLOCKED + code, program, picture, video, rois, *commands)
    assert {path.name for path in tmp_path.iterdir()} >= {"i", "v", "c", "s"}
