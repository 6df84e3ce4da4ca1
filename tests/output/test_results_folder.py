"""A folder of results never loses what labcdp did not write in it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.output import LIST_FILE, ResultsFolder, check_file, write_file, write_files

#: Names as commands and people choose them.
NAMES = (
    *("report.html", "results.json", "a.png", ".hidden", "video.jsonl", "figures/a.png", "figures/b.png"),
    *("figures", "sub/deep/frame-000001.png", "ünï côdé 100 %.png", ".labcdp-0123456789abcdef.part", LIST_FILE),
    *(".labcdp-0123456789abcdef.unfinished/x", ".labcdp-unfinished/x", "map.nc", "x" * 255),
)
OWN = [name for name in NAMES if name not in (LIST_FILE, "figures") and not name.startswith(".labcdp-")]

names = st.sampled_from(NAMES)
actions = st.one_of(
    st.tuples(st.just("foreign"), names, st.sampled_from([b"mine", b"mine too"])),
    st.tuples(st.just("link"), names, st.sampled_from(["../outside", "../outside/file", "nowhere", "report.html"])),
    st.tuples(st.just("delete"), names),
    st.tuples(
        st.just("run"),
        st.dictionaries(st.sampled_from(OWN), st.sampled_from([b"", b"1", b"2"]), max_size=5),
        st.sampled_from(["image", "image", "video"]),
        st.booleans(),
        st.sampled_from(["", "fails", "keeps a journal", "fails with a journal"]),
    ),
)


def contents(folder: Path) -> dict[str, bytes | str]:
    """All that is in a folder: content of files, targets of links."""
    found: dict[str, bytes | str] = {}
    for path in folder.rglob("*"):
        if path.is_symlink():
            found[str(path.relative_to(folder))] = os.readlink(path)
        elif path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def run(folder: Path, files: dict[str, bytes], command: str, force: bool, way: str) -> None:
    with suppress(InputError, KeyboardInterrupt), ResultsFolder(folder, command, force=force) as results:
        if way.endswith("journal"):
            with results.journal("video.jsonl").open("ab") as file:
                file.write(b"row\n")
        results.add({name: data for name, data in files.items() if not (way and name == "video.jsonl")})
        if way.startswith("fails"):
            raise KeyboardInterrupt


@given(st.lists(actions, max_size=8))
def test_files_of_others_stay_whatever_happens(steps: list[tuple]) -> None:
    with TemporaryDirectory() as temporary:
        folder, outside = Path(temporary, "results"), Path(temporary, "outside")
        outside.mkdir()
        (outside / "file").write_bytes(b"outside")
        foreign: set[str] = set()
        for what, *arguments in steps:
            before = contents(folder)
            if what == "run":
                run(folder, *arguments)
                assert {name: contents(folder).get(name) for name in foreign} == {
                    name: before[name] for name in foreign
                }
                continue
            path = folder / arguments[0]
            # While an evaluation is unfinished its journal is labcdp's.
            is_journal = path.name == "video.jsonl" and '"journal": "video.jsonl"' in str(before.get(LIST_FILE))
            if is_journal or path.parent.resolve() != path.parent:
                continue
            with suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
                if path.is_symlink() or path.is_file():
                    path.unlink()
                if what == "foreign":
                    path.write_bytes(arguments[1])
                elif what == "link":
                    path.symlink_to(arguments[1])
            after = contents(folder)
            foreign = {name for name in after if name in foreign or after[name] != before.get(name)}
        assert contents(outside) == {"file": b"outside"}


def _write(folder: Path, files: dict[str, bytes], command: str = "image", **options: bool) -> None:
    with ResultsFolder(folder, command, **options) as results:
        results.add(files)


def test_a_folder_holds_the_files_and_their_list_and_force_replaces_them(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "out"
    files = {"x": b"1", "s/y": b"2", "t/z": b"3"}
    assert write_files(folder, "image", files) == [folder / name for name in files]
    listed = json.loads((folder / LIST_FILE).read_bytes())
    assert (listed["command"], listed["finished"]) == ("image", True)
    assert [one["name"] for one in listed["files"]] == sorted(files)
    (folder / "t/mine").write_bytes(b"mine")
    with pytest.raises(InputError, match="already has results: give --force"):
        _write(folder, {"x": b"2"})
    _write(folder, {"x": b"2"}, force=True)
    assert set(contents(folder)) == {"x", "t/mine", LIST_FILE}
    assert (folder / "x").read_bytes() == b"2"
    assert not (folder / "s").exists()


def _changed(folder: Path, name: str = "x", text: str = "2") -> None:
    _write(folder, {"x": b"1"})
    (folder / name).write_text(text)


def _linked(folder: Path) -> None:
    _write(folder, {"s/x": b"1"})
    (folder / "s").rename(folder.parent / "elsewhere")
    (folder / "s").symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda folder: (folder / "mine.png").mkdir(parents=True), f"has files and no {LIST_FILE}"),
        (_changed, "x was changed since labcdp wrote it"),
        (_linked, "x was changed since labcdp wrote it"),
        (lambda folder: _changed(folder, LIST_FILE, '{"format": "labcdp-files", "version": 1}'), "is damaged"),
        (lambda folder: _write(folder, {"x": b"1"}, "video"), "has results of labcdp video"),
        (lambda folder: folder.write_text("mine"), "is not a folder"),
        (lambda folder: folder.symlink_to("nowhere"), "is not a folder"),
    ],
)
def test_refused_before_any_work_even_with_force(tmp_path: Path, prepare: Callable[[Path], None], words: str) -> None:
    prepare(tmp_path / "out")
    before = contents(tmp_path)
    with pytest.raises(InputError, match=words):
        ResultsFolder(tmp_path / "out", "image", force=True).__enter__()
    assert contents(tmp_path) == before


def test_inputs_other_results_and_what_appears_during_the_work_are_not_replaced(tmp_path: Path) -> None:
    folder, name = tmp_path / "out", "s/chain.toml"
    _write(folder, {name: b"1"})
    os.link(folder / name, tmp_path / "same.toml")
    for path in (folder, folder / "s", folder / name, tmp_path / "same.toml"):
        with pytest.raises(InputError, match="is an input of this command"):
            ResultsFolder(folder, "image", force=True, inputs=[path]).__enter__()
    with pytest.raises(InputError, match=r"chain\.toml is an input of this command"):
        check_file(folder / name, force=True, inputs=[folder])
    for listed in (name, LIST_FILE):
        with pytest.raises(InputError, match="belongs to the results of labcdp image: give another name"):
            check_file(folder / listed, force=True)

    with ResultsFolder(tmp_path / "two", "image") as results:
        results.add({"x": b"1"})
        with pytest.raises(InputError, match="another labcdp writes to"):
            ResultsFolder(tmp_path / "two", "image").__enter__()

    def work() -> None:
        with ResultsFolder(tmp_path / "new", "image") as results:
            results.add({"x": b"1", "y": b"2"})
            (tmp_path / "new/x").write_bytes(b"mine")

    with pytest.raises(InputError, match="x was not written by labcdp"):
        work()
    assert contents(tmp_path / "new") == {"x": b"mine"}


def test_resume_after_kill_needs_no_force(tmp_path: Path) -> None:
    program = f"""
import os, signal
from labcdp.output import ResultsFolder
with ResultsFolder({str(tmp_path / "out")!r}, "video") as results:
    results.add({{"x": b"1"}})
    results.journal("video.jsonl").write_text("row")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", program]).returncode == -signal.SIGKILL
    assert len(list((tmp_path / "out").glob(".labcdp-*"))) == 1
    with ResultsFolder(tmp_path / "out", "video") as results:
        assert results.journal("video.jsonl").read_text() == "row"
        results.add({"x": b"2"})
    assert set(contents(tmp_path / "out")) == {"x", "video.jsonl", LIST_FILE}
    with pytest.raises(InputError, match="already has results"):
        ResultsFolder(tmp_path / "out", "video").__enter__()
    with ResultsFolder(tmp_path / "out", "video", force=True) as results:
        assert not results.journal("video.jsonl").exists()
        results.add({"x": b"3"})


def test_a_disk_that_is_full_leaves_the_results_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _write(tmp_path / "out", {"x": b"1"})
    before = contents(tmp_path)

    def full(descriptor: int) -> None:
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(InputError, match=r"out cannot be written \(No space left on device\)"):
            _write(tmp_path / "out", {"x": b"2"}, force=True)
    assert contents(tmp_path) == before


# Root may do anything, so it becomes somebody else first, who may not be able to import what is loaded late.
WITHOUT_RIGHTS = """
import os, sys
from labcdp.core.errors import InputError
from labcdp.output import ResultsFolder

for _ in range(2):
    with ResultsFolder(sys.argv[1] + "/out", "image", force=True) as results:
        results.add({"x": b"1"})
if os.geteuid() == 0:
    os.setuid(65534)
for folder in sys.argv[2:]:
    try:
        with ResultsFolder(folder, "image", force=True):
            print("work")
    except InputError as error:
        print(error)
"""


def test_a_folder_that_may_not_be_written_to_is_refused_before_any_work():
    with TemporaryDirectory() as writable, TemporaryDirectory() as temporary:
        folders = [Path(temporary, name) for name in ("out", "new")]
        _write(folders[0], {"x": b"1"})
        before = contents(Path(temporary))
        for folder in (folders[0], Path(temporary)):
            folder.chmod(0o555)
        command = [sys.executable, "-c", WITHOUT_RIGHTS, writable, *folders]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        assert contents(Path(temporary)) == before
    for folder, line in zip(folders, said, strict=True):
        assert line.startswith(f"{folder} cannot be written (Permission denied)")


def test_a_file_is_written_whole_and_replaced_with_force_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*_: object) -> None:
        raise OSError(1, os.strerror(1))

    path = tmp_path / "a.tif"
    write_file(path, b"1")
    for _ in range(2):
        for attempt, remedy in ((lambda: check_file(path), "--force"), (lambda: write_file(path, b"2"), "force=True")):
            with pytest.raises(InputError, match=rf"a\.tif exists: give another name, or {remedy} to replace it"):
                attempt()
        # As on a file system without hard links.
        monkeypatch.setattr(os, "link", no_links)
    assert contents(tmp_path) == {"a.tif": b"1"}
    write_file(check_file(path, force=True), b"2", force=True)
    write_files(tmp_path / "out", "image", {"x": b"1"})
    assert {name: data for name, data in contents(tmp_path).items() if LIST_FILE not in name} == {
        "a.tif": b"2",
        "out/x": b"1",
    }
    for wrong, message in (
        (path, "is an input of this command"),
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "a.tif", "is not a folder"),
    ):
        with pytest.raises(InputError, match=message):
            check_file(wrong, force=True, inputs=[tmp_path / "." / "a.tif"])
