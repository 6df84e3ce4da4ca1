"""The wheel holds all that the repository's packages hold, and works without make, root and Aravis."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SETUPTOOLS = PYPROJECT["tool"]["setuptools"]
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


def test_citation_and_changelog_name_the_version():
    version = PYPROJECT["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert next(one for one in headings if one != "Unreleased") == version


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run([sys.executable, "-m", "build", "--outdir", folder, ROOT], check=True, capture_output=True)
    return sorted(folder.iterdir())


@pytest.fixture
def installed(tmp_path, distributions):
    """Run the program of the wheel, with the libraries of this environment but nothing of Debian's."""
    folder = tmp_path / "environment"
    venv.create(folder, with_pip=True, symlinks=True)
    python = folder / "bin" / "python"
    (wheel,) = (one for one in distributions if one.suffix == ".whl")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-deps", wheel], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "libraries.pth").write_text(sysconfig.get_paths()["purelib"])

    def run(*arguments, status=0):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        words = [folder / "bin" / "labcdp", *arguments]
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
        assert done.returncode == status, done.stderr
        return done

    return run


@pytest.mark.long
def test_sdist_and_wheel_can_be_published(distributions):
    assert [one.suffix for one in distributions] == [".whl", ".gz"]
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *distributions], check=True)


@pytest.mark.long
def test_the_wheel_evaluates_and_simulates_without_aravis(installed, tmp_path):
    assert installed("--version").stdout == f"labcdp {PYPROJECT['project']['version']}\n"
    result = json.loads(installed("evaluate", "--recalibrate", "--json", "--output", "results").stdout)
    assert len(result["tables"]["contrasts"]["rows"]) == 4
    cv2.imwrite(str(tmp_path / "board.png"), (np.indices((40, 40)).sum(axis=0) % 2 * 100 + 100).astype(np.uint8))
    result = json.loads(installed("image", "board.png", "--neighbours", "--contrast", "100%", "--json").stdout)
    assert result["tables"]["cdp"]["rows"][0]["cdp"] == 1
    installed("simulate", "manta-g505", "--exact")
    assert "Aravis" in installed("snap", "first.tif", status=1).stderr
