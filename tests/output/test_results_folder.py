"""A folder of results never loses what labcdp did not write in it."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.output import LIST_FILE, ResultsFolder, check_file, write_file

#: Names as commands and people choose them.
NAMES = (
    *("report.html", "results.json", "a.png", ".hidden", "video.jsonl", "figures/a.png", "figures/b.png"),
    *("figures", "sub/deep/frame-000001.png", "ünï côdé 100 %.png", ".labcdp-0123456789abcdef.part", LIST_FILE),
    *(".labcdp-0123456789abcdef.unfinished/x", ".labcdp-unfinished/x", "map.nc", "x" * 255),
)
OWN = [name for name in NAMES if name not in (LIST_FILE, "figures") and not name.startswith(".labcdp-")]
FILES = st.dictionaries(st.sampled_from(OWN), st.sampled_from([b"", b"1", b"2"]), max_size=5)
WAYS = st.sampled_from(["", "fails", "keeps a journal", "fails with a journal"])
ACTIONS = st.one_of(
    st.tuples(st.just("foreign"), st.sampled_from(NAMES), st.sampled_from([b"mine", b"mine too"])),
    st.tuples(
        st.just("link"), st.sampled_from(NAMES), st.sampled_from(["../outside", "../outside/file", "report.html"])
    ),
    st.tuples(st.just("delete"), st.sampled_from(NAMES)),
    st.tuples(st.just("run"), FILES, st.sampled_from(["image", "image", "video"]), st.booleans(), WAYS),
)


def contents(folder):
    """All that is in a folder: content of files, targets of links."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_symlink() or path.is_file()}
    return {name: os.readlink(path) if path.is_symlink() else path.read_bytes() for name, path in found.items()}


def run(folder, files, command, force, way):
    with suppress(InputError, KeyboardInterrupt), ResultsFolder(folder, command, force=force) as results:
        if way.endswith("journal"):
            with results.journal("video.jsonl").open("ab") as file:
                file.write(b"row\n")
        results.add({name: data for name, data in files.items() if not (way and name == "video.jsonl")})
        if way.startswith("fails"):
            raise KeyboardInterrupt


def change(folder, what, name, content=None):
    """Do what a user does to a file of any name, unless a folder or a link is in the way."""
    path = folder / name
    if path.parent.resolve() == path.parent:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
            if what == "foreign":
                path.write_bytes(content)
            elif what == "link":
                path.symlink_to(content)


@given(st.lists(ACTIONS, max_size=8))
def test_files_of_others_stay_whatever_happens(steps):
    with TemporaryDirectory() as temporary:
        folder, outside = Path(temporary, "results"), Path(temporary, "outside")
        outside.mkdir()
        (outside / "file").write_bytes(b"outside")
        foreign = set()
        for what, *arguments in steps:
            before = contents(folder)
            if what == "run":
                run(folder, *arguments)
                after = contents(folder)
                assert {name: after.get(name) for name in foreign} == {name: before[name] for name in foreign}
            # While an evaluation is unfinished its journal is labcdp's.
            elif arguments[0] != "video.jsonl" or '"journal": "video.jsonl"' not in str(before.get(LIST_FILE)):
                change(folder, what, *arguments)
                after = contents(folder)
                foreign = {name for name in after if name in foreign or after[name] != before.get(name)}
        assert contents(outside) == {"file": b"outside"}


def write(folder, files, command="image", **options):
    with ResultsFolder(folder, command, **options) as results:
        return results.add(files)


def test_a_folder_holds_the_files_and_their_list_and_force_replaces_them(tmp_path):
    folder, files = tmp_path / "a" / "out", {"x": b"1", "s/y": b"2", "t/z": b"3"}
    assert write(folder, files) == [folder / name for name in files]
    listed = json.loads((folder / LIST_FILE).read_bytes())
    assert (listed["command"], listed["finished"]) == ("image", True)
    assert [one["name"] for one in listed["files"]] == sorted(files)
    (folder / "t/mine").write_bytes(b"mine")
    with pytest.raises(InputError, match="already has results"):
        write(folder, {"x": b"2"})
    write(folder, {"x": b"2"}, force=True)
    assert set(contents(folder)) == {"x", "t/mine", LIST_FILE}


def changed(folder, name="x", text="2"):
    write(folder, {"x": b"1"})
    (folder / name).write_text(text)


def linked(folder):
    write(folder, {"s/x": b"1"})
    (folder / "s").rename(folder.parent / "elsewhere")
    (folder / "s").symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda folder: (folder / "mine.png").mkdir(parents=True), f"contains files but no {LIST_FILE}"),
        (changed, "x was changed since labcdp wrote it"),
        (linked, "x was changed since labcdp wrote it"),
        (
            lambda folder: changed(folder, LIST_FILE, '{"format": "labcdp-files", "version": 1}'),
            "is not as labcdp wrote it",
        ),
        (lambda folder: write(folder, {"x": b"1"}, "video"), "has results of labcdp video"),
        (lambda folder: folder.write_text("mine"), "is not a folder"),
        (lambda folder: folder.symlink_to("nowhere"), "is not a folder"),
    ],
)
def test_refused_before_any_work_even_with_force(tmp_path, prepare, words):
    prepare(tmp_path / "out")
    before = contents(tmp_path)
    with pytest.raises(InputError, match=words):
        ResultsFolder(tmp_path / "out", "image", force=True).__enter__()
    assert contents(tmp_path) == before


def test_inputs_other_results_and_what_appears_during_the_work_are_not_replaced(tmp_path):
    folder, name = tmp_path / "out", "s/chain.toml"
    write(folder, {name: b"1"})
    os.link(folder / name, tmp_path / "same.toml")
    for path in (folder, folder / "s", folder / name, tmp_path / "same.toml"):
        with pytest.raises(InputError, match="is an input of this command"):
            ResultsFolder(folder, "image", force=True, inputs=[path]).__enter__()
    for file, inputs, words in (
        (name, [folder], r"chain\.toml is an input of this command"),
        (name, [], "belongs to the results of labcdp image"),
        (LIST_FILE, [], "belongs to the results of labcdp image"),
    ):
        with pytest.raises(InputError, match=words):
            check_file(folder / file, force=True, inputs=inputs)
    with ResultsFolder(tmp_path / "two", "image"), pytest.raises(InputError, match="another labcdp writes to"):
        ResultsFolder(tmp_path / "two", "image").__enter__()
    appeared = pytest.raises(InputError, match="x was not written by")
    with appeared, ResultsFolder(tmp_path / "new", "image") as results:
        results.add({"x": b"1", "y": b"2"})
        (tmp_path / "new/x").write_bytes(b"mine")
    assert contents(tmp_path / "new") == {"x": b"mine"}
    altered = pytest.raises(InputError, match="was changed since labcdp wrote it")
    with altered, ResultsFolder(folder, "image", force=True) as results:
        results.add({name: b"2"})
        (folder / name).write_bytes(b"mine")
    assert contents(folder)[name] == b"mine"


def test_resume_after_kill_needs_no_force(tmp_path):
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


@contextmanager
def without_rights(folder):
    """A folder to which one may not write; root may do anything, so it becomes somebody else."""
    folder.chmod(0o555)
    if os.geteuid() == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(os.getuid())


def test_a_full_disk_or_a_folder_that_may_not_be_written_to_leaves_the_results_before(monkeypatch):
    def full(descriptor):
        raise OSError(28, os.strerror(28))

    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write(folder / "out", {"x": b"1"})
        before = contents(folder)
        with without_rights(folder), pytest.raises(InputError, match=r"new cannot be written \(Permission denied\)"):
            ResultsFolder(folder / "new", "image").__enter__()
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(InputError, match=r"out cannot be written \(No space left on device\)"):
            write(folder / "out", {"x": b"2"}, force=True)
        assert contents(folder) == before


def test_a_file_is_written_whole_and_replaced_with_force_only(tmp_path, monkeypatch):
    def no_links(*_):
        raise OSError(1, os.strerror(1))

    path = tmp_path / "a.tif"
    write_file(path, b"1")
    for _ in range(2):
        for attempt in (check_file, lambda path: write_file(path, b"2")):
            with pytest.raises(InputError, match=r"a\.tif exists: .*force"):
                attempt(path)
        # As on a file system without hard links.
        monkeypatch.setattr(os, "link", no_links)
    assert contents(tmp_path) == {"a.tif": b"1"}
    write_file(check_file(path, force=True), b"2", force=True)
    assert contents(tmp_path) == {"a.tif": b"2"}
    for wrong, words in ((path, "is an input"), (tmp_path, "is a folder")):
        with pytest.raises(InputError, match=words):
            check_file(wrong, force=True, inputs=[tmp_path / "." / "a.tif"])


def test_only_files_and_links_to_files_are_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        (tmp_path / "to a device").symlink_to(os.devnull)
        (tmp_path / "to nowhere").symlink_to("gone")
        before = sorted((path.name, path.lstat().st_mode, path.lstat().st_ino) for path in tmp_path.iterdir())
        for name in ("pipe", "socket", "to a device", "to nowhere"):
            for attempt in (check_file, partial(write_file, data=b"1")):
                with pytest.raises(InputError, match=f"{name} is a .*another name"):
                    attempt(tmp_path / name, force=True)
        assert sorted((path.name, path.lstat().st_mode, path.lstat().st_ino) for path in tmp_path.iterdir()) == before
    (tmp_path / "file").write_bytes(b"1")
    (tmp_path / "to a file").symlink_to("file")
    write_file(check_file(tmp_path / "to a file", force=True), b"2", force=True)
    assert (tmp_path / "to a file").read_bytes() == b"2"
