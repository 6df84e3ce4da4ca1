"""The files: all there, whole, the same again, and one clear error if they cannot be."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from labcdp.core.errors import InputError
from labcdp.evaluate.bench.report.page import write_results
from labcdp.evaluate.bench.report.result import session_result
from labcdp.evaluate.bench.session import SessionEvaluation
from labcdp.output import LIST_FILE

NAMES = [
    "results.json",
    "report.html",
    "results.xlsx",
    "figures/target.png",
    "figures/luminance.png",
    "figures/contrasts-1.png",
    "figures/calibration-fit.png",
    "figures/calibration-residuals.png",
]


def write(evaluation: SessionEvaluation, folder: Path) -> list[Path]:
    return write_results(evaluation, session_result(evaluation), folder)


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != LIST_FILE
    }


def test_writes_these_files_and_the_same_again(evaluation: SessionEvaluation, written: Path, tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    assert write(evaluation, folder) == [folder / name for name in NAMES]
    assert sorted(files(written)) == sorted(NAMES)
    assert files(folder) == files(written)


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size: writing fails as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_file_that_does_not_fit_leaves_no_half_of_it(evaluation: SessionEvaluation, tmp_path: Path) -> None:
    with largest_file(100_000), pytest.raises(InputError, match=r"report\.html cannot be written \(File too large\)"):
        write(replace(evaluation, contrasts=[]), tmp_path)
    # Nor a part of the results: they belong together.
    assert set(files(tmp_path)) == set()
