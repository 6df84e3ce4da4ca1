"""The wheel holds all that the repository's packages hold."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
FOLDERS = {"labcdp": ROOT / "labcdp", "labcdp.drivers": ROOT / "drivers", "labcdp.calibration": ROOT / "calibration"}


def test_every_folder_with_modules_is_a_package_of_the_wheel():
    found = {
        ".".join([name, *path.parent.relative_to(folder).parts])
        for name, folder in FOLDERS.items()
        for path in folder.rglob("__init__.py")
        if "data" not in path.relative_to(folder).parts
    }
    modules = {path.parent for folder in FOLDERS.values() for path in folder.rglob("*.py")}
    assert set(SETUPTOOLS["packages"]) == found
    assert all((folder / "__init__.py").exists() or "data" in folder.parts for folder in modules)


@pytest.mark.parametrize("folder", FOLDERS.values(), ids=FOLDERS)
def test_every_other_file_is_data_of_the_wheel(folder):
    data = {path for pattern in SETUPTOOLS["package-data"]["labcdp"] for path in FOLDERS["labcdp"].glob(pattern)}
    others = {path for path in folder.rglob("*") if path.is_file() and path.suffix != ".py"}
    assert {path for path in others if "__pycache__" not in path.parts} <= data
