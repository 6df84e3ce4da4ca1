"""The notebooks of examples/ run, as programs; `make docs` runs them as notebooks."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.md"))
_COMMAND = re.compile(r"^!(.*)$", re.MULTILINE)


def program(notebook):
    """The code cells of a notebook; a line that begins with ! is a command of the shell, with names in braces."""
    text = notebook.read_text(encoding="utf-8")
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    code = _COMMAND.sub(r"__import__('subprocess').run(f'''\1''', shell=True, check=True)", "\n".join(cells))
    return f"import warnings\nwarnings.simplefilter('error')\n{code}"


@pytest.mark.parametrize(
    "notebook",
    [pytest.param(one, marks=() if one.stem == "first-cdp" else pytest.mark.long, id=one.stem) for one in EXAMPLES],
)
def test_notebook_runs(tmp_path, notebook):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"MPLBACKEND": "Agg", "PATH": path}
    subprocess.run([sys.executable, "-c", program(notebook)], cwd=tmp_path, env=environment, check=True, timeout=600)
