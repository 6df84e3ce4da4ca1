"""How `make docs` builds the site; the pages about commands, schema and API are written from the code first."""

import os
import shutil
import sys
from importlib import metadata
from pathlib import Path

import bokeh

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

# For commands in notebooks.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"

project = "labcdp"
author = "The labcdp developers"
release = metadata.version("labcdp")
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "pages_from_code"]
exclude_patterns = ["extensions"]
html_theme = "furo"
html_title = f"labcdp {release}"
html_copy_source = False
html_show_sourcelink = False
# Bokeh's script is part of the site, so that its plots work without network.
_static = HERE.parent / "build" / "docs-static"
_static.mkdir(parents=True, exist_ok=True)
for _script in ("bokeh.min.js", "bokeh-widgets.min.js"):
    shutil.copy(Path(bokeh.__file__).parent / "server" / "static" / "js" / _script, _static)
html_static_path = [str(_static), "static"]
html_css_files = ["labcdp.css"]
html_show_copyright = False

default_role = "code"
napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
# Types in docstrings may name what several classes have, such as shape.
suppress_warnings = ["ref.python"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "auto"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
