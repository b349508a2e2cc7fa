"""The files that the page is made of: its own, and the scripts of the chart package.

The page's own scripts are plain files in ``page/``, which a browser loads as they are. Bokeh's are
read from the installed package, so that the repository holds no script of others.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

PAGE = Path(__file__).parent / "page"
INDEX, ICON = "index.html", "icon.svg"
BOKEH_SCRIPTS = ("bokeh.min.js", "bokeh-api.min.js")
MEDIA_TYPES: Mapping[str, str] = MappingProxyType(
    {
        ".html": "text/html",
        ".css": "text/css",
        ".js": "text/javascript",
        ".svg": "image/svg+xml",
    }
)
"""By the ending of a file's name."""


def page_text(name: str) -> str:
    """The text of one of the page's files, of its own or of Bokeh's.

    Raises ``FileNotFoundError`` for a name that is none of them, and ``ModuleNotFoundError`` for a
    script of Bokeh's if Bokeh is not installed.
    """
    if name in BOKEH_SCRIPTS:
        return (_bokeh_folder() / name).read_text(encoding="utf-8")
    if name not in page_names():
        raise FileNotFoundError(f"{name[:200]}: not a file of the page")
    return (PAGE / name).read_text(encoding="utf-8")


def page_type(name: str) -> str:
    """The media type of one of the page's files."""
    return f"{MEDIA_TYPES[Path(name).suffix]}; charset=utf-8"


def page_names() -> tuple[str, ...]:
    """The names of the page's own files, sorted."""
    return tuple(sorted(p.name for p in PAGE.iterdir() if p.suffix in MEDIA_TYPES))


def _bokeh_folder() -> Path:
    from bokeh.util.paths import static_path

    return Path(static_path()) / "js"
