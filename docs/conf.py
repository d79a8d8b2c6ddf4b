"""How Sphinx builds the handbook: `make docs`, with warnings as errors and nothing from the net.

The pages are Markdown with the directives of MyST, and can be read where they lie, too.
CONTRIBUTING.md tells their writers how the tests run the code blocks.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from pygments.lexers.rust import RustLexer
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "HPRM"
author = "the authors of HPRM"
extensions = [
    "lingua_franca",
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["requirements.txt", "_diagrams"]
highlight_language = "none"

myst_enable_extensions = ["colon_fence", "deflist"]
# Headings that links from other pages may name: `[ending](../concepts/federations.md#ending)`.
myst_heading_anchors = 4

autodoc_member_order = "bysource"
# Types as programs write them, and not where they are defined.
autodoc_typehints_format = "short"
autodoc_type_aliases = {"Time": "hprm.Time"}
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = "HPRM handbook"
html_static_path = ["_static"]
html_css_files = ["handbook.css"]
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "github-dark"

# The button copies commands, without their prompts and without what they print.
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True


def changelog(app: Sphinx, name: str, source: list[str]) -> None:
    """Puts CHANGELOG.md in the place of its page; its links start at the root of the repository."""
    if name == "changelog":
        text = (Path(__file__).parents[1] / "CHANGELOG.md").read_text()
        inside = re.sub(r"\]\(docs/", "](", text)
        # What is not a page stays words.
        source[0] = re.sub(r"\[([^]]+)\]\((?!http)(?:examples|crates|tests)/[^)]*\)", r"\1", inside)


def setup(app: Sphinx) -> None:
    """Adds what settings cannot say."""
    # A block that the tests of Rust compile and do not run.
    app.add_lexer("rust,no_run", RustLexer)
    app.connect("source-read", changelog)
