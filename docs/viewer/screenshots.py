"""Makes the pictures of docs/viewer.md.

    python docs/viewer/screenshots.py [DIRECTORY]

Hunts in memory, exports each as one HTML file, opens it in a headless Chromium and takes pictures
of 256 colours each into this file's folder, or another one. One hunt is shown while it goes on, and
is changed by hand.
"""

import shutil
import sys
import tempfile
import threading
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from playwright.sync_api import sync_playwright

import encircle
from encircle.viewer.html_export import export
from encircle.viewer.hunt_show import HuntShow
from encircle.viewer.showing import ShowOptions, WatchEnd
from encircle.world.recording.recording import read_recording

OPTIONS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
NONE = Image.Dither.NONE
LAPTOP, PROJECTOR = (1366, 768), (1920, 1080)

GROUPS = [["r1", "r2", "r3"], ["r4", "r5", "r6"]]
CUT = {
    "title": "Obstacles, a cut team, a lost and a silent robot",
    "ticks_max": 120,
    "team": {"positions": [[-5, 0.5], [-3, -9], [11, -1], [2, 9], [-8, 6], [9, 8]]},
    "target": {"behaviour": "gap", "step_m_max": 0.28},
    "sensing": {"noise_m_std": 0.2},
    "channel": {"loss": {"model": "bernoulli", "rate": 0.2}},
    "obstacles": [
        {"position": [3, 3], "radius_m": 0.8},
        {"position": [-4, -4], "radius_m": 1.2},
        {"position": [7, -5], "radius_m": 1.0},
    ],
    "events": [
        {"kind": "partition", "tick": 15, "ticks": 30, "groups": GROUPS},
        {"kind": "crash", "tick": 20, "ticks": 15, "robot": "r5"},
        {"kind": "silence", "tick": 30, "ticks": 40, "robot": "r2"},
    ],
}
LOSS_60 = ["channel.loss={model='bernoulli', rate=0.6}"]
FASTER = [
    "channel.loss={model='bernoulli', rate=0.3}",
    "channel.delay={model='gamma', mean_s=0.3, std_s=0.2}",
    "sensing.noise_m_std=0.15",
]
SIXTEEN = [
    "title='Sixteen robots, burst loss and delay'",
    "team={robots=16}",
    "target.step_m_max=0.22",
    "sensing.noise_m_std=0.15",
    "channel.loss={model='gilbert-elliott', good_to_bad=0.1, bad_to_good=0.3}",
    "channel.delay={model='gamma', mean_s=0.1, std_s=0.1}",
]


class Picture(NamedTuple):
    """A picture: of which run, what is shown of it (the end of the page's address), how large."""

    run: str
    shows: str
    size: tuple[int, int] = LAPTOP


RUNS = {
    "loss": ("sim1", LOSS_60),
    "faster": ("sim4", FASTER),
    "sixteen": ("sim1", SIXTEEN),
    "cut": (CUT, []),
}
BY_HAND = [
    {"kind": "loss", "rate": 0.6, "tick": 20},
    {"kind": "partition", "groups": [["r1", "r2"], ["r3", "r4"]], "tick": 35},
    {"kind": "move-target", "position": [4.0, 3.0], "tick": 42},
    {"kind": "silence", "robot": "r3", "tick": 47, "ticks": 30},
    {"kind": "range", "range_m": 14.0, "tick": 50},
]
CONTROL_TICK = 60
PICTURES = {
    "loss.png": Picture("loss", "tick=20.4&theme=light"),
    "belief.png": Picture("cut", "tick=40&robot=r2&view=close&theme=light"),
    "faster.png": Picture("faster", "tick=9.5&theme=dark"),
    "sixteen.png": Picture("sixteen", "tick=30.5&theme=dark"),
    "cut.png": Picture("cut", "tick=22.5&theme=light"),
    "projector.png": Picture("cut", "tick=40&robot=r2&view=close&theme=dark&type=large", PROJECTOR),
}


def main(folder: Path) -> None:
    """Take all pictures into a folder."""
    with tempfile.TemporaryDirectory() as directory, sync_playwright() as playwright:
        pages = {name: _page_of(Path(directory), name) for name in RUNS}
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=[*OPTIONS]
        )
        for name, picture in PICTURES.items():
            page = _opened(browser, f"{pages[picture.run].as_uri()}#{picture.shows}", picture.size)
            _take(page, folder / name)
        _take_control(browser, folder / "control.png")
        browser.close()


def _page_of(directory: Path, name: str) -> Path:
    scenario, changes = RUNS[name]
    encircle.run(scenario, link="memory", out=directory / name, overrides=changes)
    page = directory / f"{name}.html"
    export(read_recording(directory / name), page)
    return page


def _take_control(browser, path: Path) -> None:
    """A picture of the page of a hunt that goes on, whose radio is changed by hand."""
    interventions = encircle.Interventions()
    show = HuntShow(ShowOptions(browser=False, end=WatchEnd.RUN), True, interventions)
    # The hunt is held at its begin until the page is open, and near its end for the picture.
    held = {tick: (threading.Event(), threading.Event()) for tick in (0, CONTROL_TICK)}

    def progress(report) -> None:
        show.on_report(report)
        for tick, (is_there, may_go_on) in held.items():
            if report.get("tick", -1) >= tick and not is_there.is_set():
                is_there.set()
                may_go_on.wait()

    changes = ["ticks_max=75", "target.step_m_max=0.6"]
    how = {"link": "memory", "overrides": changes, "pace": 4.0}
    how |= {"interventions": interventions, "onlooker": show, "progress": progress}
    hunt = threading.Thread(target=encircle.run, args=("sim1",), kwargs=how)
    hunt.start()
    held[0][0].wait()
    shown = _opened(browser, f"{show.show.server.address}#theme=light", LAPTOP)
    for event in BY_HAND:
        interventions.give(event)
    held[0][1].set()
    held[CONTROL_TICK][0].wait()
    shown.wait_for_function(f"() => encircle.state().last_tick >= {CONTROL_TICK - 2}")
    shown.wait_for_selector("#control-said:has-text('range 14')")
    shown.evaluate("encircle.seek(54)")
    _take(shown, path)
    held[CONTROL_TICK][1].set()
    hunt.join()
    show.stop()


def _opened(browser, address: str, size: tuple[int, int]):
    width, height = size
    shown = browser.new_page(viewport={"width": width, "height": height})
    shown.goto(address)
    shown.wait_for_function("() => window.encircle && encircle.state().ready")
    return shown


def _take(shown, path: Path) -> None:
    shown.wait_for_function("() => document.querySelectorAll('#charts .bk-Figure').length === 6")
    shown.wait_for_load_state("networkidle")
    shown.evaluate("new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))")
    shown.screenshot(path=path)
    shown.close()
    with Image.open(path) as image:
        small = image.convert("RGB").quantize(
            256, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=NONE
        )
    small.save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
