"""The page's files: all that is there is loaded, nothing else is, and colours are the palette's."""

import json
import re

import pytest
from helpers_paths import ROOT

from encircle.scene import palette
from encircle.viewer.html_export import ICON_LINK, SCRIPT, STYLE
from encircle.viewer.page_files import (
    BOKEH_SCRIPTS,
    ICON,
    INDEX,
    PAGE,
    page_names,
    page_text,
    page_type,
)
from encircle.world.channel.loss_causes import CAUSES

LINES_MAX = 350
LONGEST_LINE = 124


def test_the_index_loads_every_file_and_no_other():
    index = page_text(INDEX)
    icons = [name for _, _, name, _ in ICON_LINK.findall(index)]
    assert icons == [ICON]
    loaded = [*SCRIPT.findall(index), *STYLE.findall(index), *icons]
    assert sorted(loaded) == sorted({*page_names(), *BOKEH_SCRIPTS} - {INDEX})
    assert len(re.findall("<script", index)) == len(SCRIPT.findall(index)), "none is in the page"


def test_no_file_of_the_page_is_fetched_from_elsewhere_or_is_of_others():
    for name in page_names():
        text = page_text(name)
        assert not re.search(r"https?://(?!www\.w3\.org)", text), name
        assert "eval(" not in text, name
        assert "innerHTML" not in text, name
        assert max(map(len, text.splitlines())) <= LONGEST_LINE or name == INDEX, name
        assert len(text.splitlines()) <= LINES_MAX, name
    assert {path.suffix for path in PAGE.iterdir()} == {".html", ".css", ".js", ".svg"}


def test_the_served_page_runs_only_scripts_of_its_server():
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page_text(INDEX))[1]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == rules["connect-src"] == "'self'"


@pytest.mark.parametrize("name", ["../page_files.py", "nothing.js", "", "page_files.py"])
def test_what_is_no_file_of_the_page_is_not_given_out(name):
    with pytest.raises(FileNotFoundError, match="not a file of the page"):
        page_text(name)


def test_media_types():
    assert page_type(INDEX) == "text/html; charset=utf-8"
    assert {page_type(name) for name in BOKEH_SCRIPTS} == {"text/javascript; charset=utf-8"}


def test_the_colours_and_shapes_are_the_palettes():
    def style(of):
        return {"role": of.role, "shape": of.shape, "reach": of.reach}

    text = page_text("palette.js")
    assert json.loads(text[text.index("= {\n") + 1 : text.rindex(";")]) == {
        "robots": list(palette.ROBOTS),
        "themes": {name: dict(colours) for name, colours in palette.THEMES.items()},
        "arrived": style(palette.ARRIVED),
        "late": style(palette.LATE),
        "lost": {cause: style(of) for cause, of in palette.LOST.items()},
        "unknownLoss": style(palette.UNKNOWN_LOSS),
    }


def test_every_fate_has_words():
    words = page_text("legend.js").split("const WORDS")[1].split("};")[0]
    for fate in ("arrived", "late", *CAUSES.values()):
        assert re.search(rf'(?m)^    "?{fate}"?: "', words), fate


def test_the_files_are_installed():
    assert '"encircle.viewer" = ["page/*"]' in (ROOT / "pyproject.toml").read_text()


def test_the_site_of_the_docs_has_the_pages_icon():
    favicon = re.search(r'(?m)^html_favicon = "(.*)"$', (ROOT / "docs/conf.py").read_text())[1]
    assert (ROOT / "docs" / favicon).resolve() == PAGE / ICON
