"""Examples in docstrings give what they say."""

import doctest
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def modules():
    """Names of the modules whose docstrings have examples."""
    for folder in ("labcdp", "drivers", "calibration"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if re.search(r"^ +>>> \w", path.read_text(encoding="utf-8"), flags=re.MULTILINE):
                parts = path.relative_to(ROOT).with_suffix("").parts
                yield ".".join(parts if folder == "labcdp" else ("labcdp", *parts)).removesuffix(".__init__")


@pytest.mark.parametrize("name", list(modules()))
def test_examples_give_what_they_say(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    results = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert results.failed == 0
