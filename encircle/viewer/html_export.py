"""A recording as one HTML file: the page, Bokeh's scripts, and the run's scene inside.

The file opens from a disk, without a server and offline. Its policy for content lets a browser run
the scripts that are in it, each by its hash, and load or send nothing. The scene's JSON is packed
with gzip, to about a tenth, and unpacked by the browser.
"""

import base64
import gzip
import json
import re
from hashlib import sha256
from pathlib import Path
from typing import Any

from encircle.scene.as_json import frame_json, stage_json
from encircle.scene.builder import Scene, scene_of_recording
from encircle.viewer.page_files import INDEX, page_text
from encircle.world.recording.recording import Recording

SCRIPT = re.compile(r'<script src="([^"]+)"></script>')
STYLE = re.compile(r'<link rel="stylesheet" href="([^"]+)">')
ICON_LINK = re.compile(r'(<link rel="icon" type="([^"]+)" href=")([^"]+)(">)')
POLICY = re.compile(r'(<meta http-equiv="Content-Security-Policy" content=")[^"]*(">)')
CLOSING_TAG = re.compile(r"</(script)", re.IGNORECASE)


def export(recording: Recording, out: Path, *, beliefs: bool = True) -> None:
    """Write a recording as one HTML file, to a path at which there is nothing.

    ``beliefs``: whether it holds what the robots believed. Raises ``RecordingError`` for a
    recording that cannot be read, ``ModuleNotFoundError`` without Bokeh.
    """
    out.write_text(page_html(scene_of_recording(recording, beliefs)), encoding="utf-8")


def page_html(scene: Scene) -> str:
    """The page with a scene in it, as the text of one HTML file."""
    index = page_text(INDEX)
    scripts = [CLOSING_TAG.sub(r"<\\/\1", page_text(name)) for name in SCRIPT.findall(index)]
    styles = [page_text(name) for name in STYLE.findall(index)]
    index = _each_replaced(STYLE, index, [f"<style>\n{style}</style>" for style in styles])
    index = _each_replaced(SCRIPT, index, [f"<script>{script}</script>" for script in scripts])
    index = ICON_LINK.sub(
        lambda found: f"{found[1]}{_as_address(found[2], found[3])}{found[4]}", index
    )
    index = POLICY.sub(lambda found: f"{found[1]}{_policy(scripts)}{found[2]}", index, count=1)
    data = f'<script type="application/json" id="recording">{packed(message(scene))}</script>\n'
    return index.replace("<script>", f"{data}<script>", 1)


def message(scene: Scene) -> dict[str, Any]:
    """All of a scene as one message to the page (``page/source.js``)."""
    return {
        "stage": stage_json(scene.stage),
        "frames": [frame_json(frame) for frame in scene.frames],
        "status": {"state": "ended", "text": "", "complete": scene.complete},
    }


def packed(content: dict[str, Any]) -> str:
    """Base64 of the gzip of an object's JSON; the same for the same object."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")


def _as_address(media_type: str, name: str) -> str:
    """One of the page's files as an address that has all of it."""
    content = base64.b64encode(page_text(name).encode()).decode()
    return f"data:{media_type};base64,{content}"


def _policy(scripts: list[str]) -> str:
    """A content security policy: only these scripts run, and nothing is loaded or sent."""
    hashes = [base64.b64encode(sha256(s.encode()).digest()).decode() for s in scripts]
    allowed = " ".join(f"'sha256-{h}'" for h in dict.fromkeys(hashes))
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline';"
        " img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def _each_replaced(pattern: re.Pattern[str], text: str, replacements: list[str]) -> str:
    """The text with each match replaced by the next replacement, taken as it is."""
    following = iter(replacements)
    return pattern.sub(lambda _: next(following), text)
