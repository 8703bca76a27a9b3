"""The documentation as a site: the pages as they stand in the repository, and the reference of the public names.

`make docs` builds it into `build/site`; it asks for nothing from the network when it is read.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

from pygments.lexers.special import TextLexer  # noqa: E402 - the path goes before
from sphinx.highlighting import lexers  # noqa: E402

from photogram import __version__  # noqa: E402

project = "photogram"
author = "the photogram developers"
version = release = __version__
language = "en"

extensions = ["myst_nb", "sphinx.ext.autodoc", "mathml", "public_names"]
include_patterns = ["docs/*.md", "docs/course/*.md", "docs/site/*.md", "examples/**/*.md", "*.md"]
root_doc = "docs/site/index"

myst_enable_extensions = ["dollarmath", "strikethrough"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

myst_heading_anchors = 4
myst_dmath_double_inline = True
suppress_warnings = ["myst.header"]

lexers["csv"] = TextLexer()

html_theme = "furo"
html_title = f"photogram {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_math_renderer = "mathml"
html_extra_path = ["redirect"]

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
