"""The file: what is in it, and that it says to a browser what may run."""

import base64
import gzip
import json
import re
from hashlib import sha256
from xml.etree import ElementTree

import pytest
from helpers_scene import hunted

from encircle.scene.as_json import frame_json, stage_json
from encircle.scene.builder import scene_of_recording
from encircle.viewer.html_export import export, packed, page_html
from encircle.viewer.page_files import BOKEH_SCRIPTS, page_names, page_text

DATA = re.compile(r'<script type="application/json" id="recording">([^<]*)</script>')


@pytest.fixture(scope="module")
def recording():
    return hunted("sim1", ["ticks_max=6", 'title="</script><b>&amp;"'])[0]


@pytest.fixture(scope="module")
def text(recording):
    return page_html(scene_of_recording(recording))


def unpacked(text):
    return json.loads(gzip.decompress(base64.b64decode(DATA.search(text)[1])))


def test_the_file_holds_the_whole_scene(recording, text):
    scene = scene_of_recording(recording)
    message = unpacked(text)
    assert message["stage"] == stage_json(scene.stage)
    assert message["frames"] == [frame_json(frame) for frame in scene.frames]
    assert message["status"] == {"state": "ended", "text": "", "complete": True}


def test_nothing_in_the_file_is_loaded(text):
    assert not re.search(r'<script[^>]* src=|<link rel="stylesheet"', text)
    for name in page_names():
        if name.endswith((".js", ".css")):
            assert page_text(name) in text, name
    for name in BOKEH_SCRIPTS:
        assert page_text(name)[:400] in text


def test_the_icon_is_in_the_file(text):
    (address,) = re.findall(r'<link rel="icon" type="image/svg\+xml" href="([^"]*)">', text)
    kind, _, content = address.partition(";base64,")
    assert kind == "data:image/svg+xml"
    assert ElementTree.fromstring(base64.b64decode(content)).tag.endswith("}svg")


def test_only_the_scripts_in_the_file_may_run(text):
    """The hashes are made by the standard's rule: of what is between the tags, byte for byte."""
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    allowed = set(re.findall("'sha256-([^']+)'", policy))
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    hashes = {base64.b64encode(sha256(s.encode()).digest()).decode() for s in scripts}
    assert hashes == allowed
    assert "unsafe" not in policy.split("script-src")[1].split(";")[0]
    assert "connect-src" not in policy, "default-src 'none' forbids to send anything"


def test_a_title_cannot_end_the_data(text):
    assert unpacked(text)["stage"]["title"] == "</script><b>&amp;"
    assert "<b>&amp;" not in text


def test_without_beliefs_there_are_none(recording, tmp_path):
    export(recording, tmp_path / "a.html", beliefs=False)
    frames = unpacked((tmp_path / "a.html").read_text(encoding="utf-8"))["frames"]
    assert all(belief is None for frame in frames for belief in frame["bel"])


def test_the_same_recording_gives_the_same_file(recording, tmp_path):
    for name in ("a.html", "b.html"):
        export(recording, tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_what_is_packed_is_no_markup():
    assert re.fullmatch(r"[A-Za-z0-9+/=]+", packed({"title": "<script>"}))
