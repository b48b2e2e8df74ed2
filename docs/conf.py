"""Sphinx configuration: the pages of casid. Pages of causes and criteria are written from their definitions first."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import written  # noqa: E402  after the path
from sphinx_gallery.sorting import FileNameSortKey  # noqa: E402

import casid  # noqa: E402

project = "casid"
copyright = "casid developers"  # noqa: A001
version = release = casid.__version__
extensions = [
    "mathml",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_gallery.gen_gallery",
]
# without its record an example has no figure, and its picture in the gallery would be blank
left_out = [] if "CASID_DATA" in os.environ else ["hfb320"]
exclude_patterns = ["_build", "examples", "**/README.rst", *(f"gallery/*{name}*" for name in left_out)]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
autosummary_generate = True
numpydoc_show_class_members = False
autodoc_typehints = "none"
intersphinx_mapping = {}
html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = "casid"
html_static_path = ["_static"]
html_css_files = ["casid.css"]
html_show_sourcelink = False
html_sidebars = {"*": []}  # pages of their own have no section to navigate
html_theme_options = {"show_toc_level": 2, "navigation_with_keys": False, "secondary_sidebar_items": ["page-toc"]}
sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "within_subsection_order": FileNameSortKey,
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,
    "parallel": 2,  # examples run beside each other
    "plot_gallery": "True",
    "filename_pattern": r"/plot_",
    "ignore_pattern": "|".join([r"__init__\.py", *left_out]),
    "abort_on_example_error": True,
}
suppress_warnings = ["config.cache"]
# joblib replaces a process that has grown by 300 MB, as one does that ran several examples; no example is lost.
warnings.filterwarnings("ignore", message="A worker stopped while some jobs", category=UserWarning)

written.write(HERE / "reference")
