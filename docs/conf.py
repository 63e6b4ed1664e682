"""How Sphinx makes the manual: see tools/docs.sh."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import dynstiction

project = "dynstiction"
author = "The dynstiction developers"
copyright = "the dynstiction developers"
release = version = dynstiction.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml"]
exclude_patterns = ["ford.md", "requirements.txt"]

# Pages are plain Markdown, as a forge shows it.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"
# The notebooks have no outputs in the repository: they run when the manual is made.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

# In docstrings `name` is a name.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False

# Blocks without a language are what a terminal shows.
highlight_language = "none"
pygments_style = "default"
pygments_dark_style = "github-dark"

html_theme = "furo"
html_title = f"dynstiction {release}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_copy_source = False
html_show_sourcelink = False
