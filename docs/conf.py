"""Sphinx: ``make docs`` builds ``out/docs/index.html`` from these pages and the docstrings, without network."""

import wvr

project = "wvr"
copyright = "the wvr developers"
version = release = wvr.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
html_theme = "furo"
html_title = "wvr"
myst_heading_anchors = 3
napoleon_google_docstring = False
napoleon_use_ivar = True  # fields of tuples are described once
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signature says them; the text says units and shapes
exclude_patterns = ["_build"]
# Links to files outside this folder are for readers of the repository; tests/test_docs.py follows all links.
suppress_warnings = ["myst.xref_missing"]
