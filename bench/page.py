"""How fast the page draws, in a real browser without a graphics card.

    python bench/page.py [--robots 16] [--seconds 10]

Hunts in memory, writes the page as a file, opens it in a headless Chromium that draws in software,
plays it with all that can be shown, and prints one line for each size of the window: frames a
second, and how long it took from frame to frame and to draw one. A frame is counted by
``requestAnimationFrame``, which gives 60 a second at most.
"""

import argparse
import os
import shutil
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

import encircle
from encircle.viewer.html_export import export
from encircle.world.recording.recording import read_recording

OPTIONS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
SIZES = ((1366, 768), (1920, 1080))
CHANNEL = (
    "channel.loss={model='gilbert-elliott', good_to_bad=0.1, bad_to_good=0.3}",
    "channel.delay={model='gamma', mean_s=0.1, std_s=0.05}",
)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=16)
    parser.add_argument("--seconds", type=float, default=10.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory, sync_playwright() as playwright:
        page = _page_of(Path(directory), arguments.robots)
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=[*OPTIONS]
        )
        for width, height in SIZES:
            stats = _measured(browser, page, width, height, arguments.seconds)
            print(
                f"{arguments.robots} robots, {stats['packets_max']} packets at once,"
                f" {width} x {height}: {stats['frames_per_s']:.0f} frames/s;"
                f" from frame to frame {stats['interval_ms_median']:.0f} ms in the median,"
                f" {stats['interval_ms_p95']:.0f} ms at the 95th percentile;"
                f" drawing {stats['draw_ms_median']:.1f} ms and {stats['draw_ms_p95']:.1f} ms"
            )
        browser.close()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def _page_of(directory: Path, robots: int) -> Path:
    run = directory / "run"
    changes = [f"team={{robots={robots}}}", "ticks_max=200", "target.step_m_max=0.35", *CHANNEL]
    encircle.run("sim1", link="memory", out=run, overrides=changes)
    export(read_recording(run), directory / "page.html")
    return directory / "page.html"


def _measured(browser, page: Path, width: int, height: int, seconds: float) -> dict:
    shown = browser.new_page(viewport={"width": width, "height": height})
    shown.goto(page.as_uri() + "#speed=0.5")
    shown.wait_for_function("() => window.encircle && encircle.state().ready")
    shown.evaluate("encircle.play()")
    shown.wait_for_function("() => encircle.state().tick >= 3")
    shown.evaluate("encircle.reset_stats()")
    time.sleep(seconds)
    stats = shown.evaluate("encircle.stats()")
    shown.close()
    return stats


if __name__ == "__main__":
    main()
