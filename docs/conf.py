"""The documentation as web pages: sphinx-build -W docs /tmp/pages."""

from importlib import metadata

project = "periporo"
release = metadata.version("periporo")
extensions = ["myst_parser", "sphinx.ext.autodoc"]
default_role = "code"  # what docstrings have between single backticks
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
source_suffix = {".md": "markdown"}
exclude_patterns = ["figures/*.md"]  # tables that pages quote
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_title = f"periporo {release}"
html_show_copyright = False
myst_enable_extensions = ["dollarmath"]  # equations; the reader's browser loads MathJax
suppress_warnings = ["misc.highlighting_failure"]  # of blocks of CSV, which stay plain
myst_heading_anchors = 4  # headings can be linked to
