# SPDX-License-Identifier: Apache-2.0
"""Settings of Sphinx, which builds these pages: `make docs`."""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

from reference_pages import write_reference_pages

project = "plsing_ros"
author = "plsing_ros developers"
copyright = "plsing_ros developers, Apache-2.0"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["**/_*"]
html_theme = "furo"
html_title = "plsing_ros"

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

# Docstrings are plain text with names in backticks.
default_role = "literal"
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True


def escape_docstring(app, what, name, obj, options, lines):
    """Take bars and stars of formulas, as in |v| and s*, for what they are."""
    lines[:] = [line.replace("|", r"\|").replace("*", r"\*") for line in lines]


def skip_field_alias(app, what, name, obj, skip, options):
    """Leave out the fields of named tuples: the docstring of the class says what they are."""
    return True if (getattr(obj, "__doc__", None) or "").startswith("Alias for field number") else None


def setup(app):
    write_reference_pages(DOCS / "reference")
    app.connect("autodoc-process-docstring", escape_docstring, priority=900)
    app.connect("autodoc-skip-member", skip_field_alias)
