"""How the site is built: python -m sphinx -W docs build/site."""

import sys
from importlib.metadata import version as versionOf
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "openmm-helfrich"
author = "The openmm-helfrich developers"
copyright = author
release = version = versionOf("openmm-helfrich")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "generated",
    "tutorials",
]
exclude_patterns = ["conf.py", "_ext"]

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "thisown"}
autoclass_content = "both"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "furo"
html_title = "openmm-helfrich"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "source_repository": "https://github.com/openmm-helfrich/openmm-helfrich/",
    "source_branch": "main",
    "source_directory": "docs/",
}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
