"""How the pages become a site: ``make docs``, which needs the extra ``docs``."""

import re
from importlib import metadata
from typing import Any, get_type_hints

from encircle import Decision, Peer, TargetView, View

project = "Encircle"
version = release = metadata.version("encircle")
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"Encircle {release}"
html_favicon = "../encircle/viewer/page/icon.svg"
html_show_sphinx = False
html_show_copyright = False
pygments_dark_style = "monokai"

# The pages are written to be read as files, too: their links lead to files and headings.
myst_heading_anchors = 4
nb_execution_mode = "off"

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
maximum_signature_line_length = 100

PAGES = {
    "README": "index",
    "CONTRIBUTING": "contributing",
    "CHANGELOG": "changelog",
    "SECURITY": "reporting",
}
"""Pages of the repository's root, and where they are on the site."""
_LINK = re.compile(rf"\]\((?:\.\./)?({'|'.join(PAGES)})\.md(#[^)]*)?\)")
_FILE = re.compile(r"\]\((CITATION\.cff)\)")


def _on_the_site(text: str) -> str:
    text = _LINK.sub(lambda link: f"]({PAGES[link[1]]}.md{link[2] or ''})", text)
    return _FILE.sub(r"](../\1)", text)


def _read(_app: Any, _page: str, source: list[str]) -> None:
    source[0] = _on_the_site(source[0])


def _included(_app: Any, _path: Any, _page: str, content: list[str]) -> None:
    content[0] = _on_the_site(content[0])


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _read)
    app.connect("include-read", _included)
    for kind in (Decision, Peer, TargetView, View):
        # Without what the wire's declarations add to a point: three lines for each.
        kind.__annotations__ = get_type_hints(kind)
        made_by = kind.__init__ if "__init__" in vars(kind) else kind.__new__
        made_by.__annotations__ = kind.__annotations__
