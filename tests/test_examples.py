"""Examples in docstrings give what they say."""

import doctest
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import pytest

import labcdp

ROOT = Path(__file__).resolve().parents[1]
#: Their examples need a camera, and are shown without being run.
NEED_A_CAMERA = {"discover", "open_camera"}


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


def public_modules():
    """Packages that list their public names, and the modules of the API reference."""
    source = (ROOT / "docs/extensions/pages_from_code.py").read_text(encoding="utf-8")
    (pattern,) = re.findall('^PUBLIC = r"(.*)"$', source, re.MULTILINE)
    documented = re.findall(r"^    \"(labcdp[\w.]*)\": \"", source, re.MULTILINE)
    packages = [f"labcdp.{found.name}" for found in pkgutil.iter_modules(labcdp.__path__) if found.ispkg]
    for name in sorted({*documented, *packages, "labcdp.calibration", "labcdp.drivers"}):
        module = importlib.import_module(name)
        names = getattr(module, "__all__", None)
        if names is None and name in documented:
            names = re.findall(pattern, inspect.getsource(module), re.MULTILINE)
        yield module, names or ()


def test_each_public_class_and_function_has_an_example_that_runs():
    things = {getattr(module, name) for module, names in public_modules() for name in names if is_code(module, name)}
    lacking = {thing.__name__ for thing in things if not runs_an_example(thing)}
    assert len(things) > 250
    assert lacking == NEED_A_CAMERA


def is_code(module, name):
    """Whether it is a class or function, and not a constant, a type alias or a module."""
    thing = getattr(module, name)
    return inspect.isclass(thing) or inspect.isfunction(thing)


def runs_an_example(thing):
    """Whether the docstring of its own has an example with more than imports and what is skipped."""
    examples = doctest.DocTestParser().get_examples(thing.__doc__ or "")
    return any(
        not example.options.get(doctest.SKIP) and not re.match("import |from ", example.source) for example in examples
    )
