"""A real browser for tests of the page, and what is to be seen in it.

Tests of a browser carry the marker ``browser``. Where there is none they are skipped, and say why;
with ``ENCIRCLE_BROWSER=yes`` in the environment they fail instead.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    "--no-sandbox",  # tests may be run as root
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
LAPTOP = {"width": 1366, "height": 768}
OWN_SCHEMES = ("file:", "data:", "blob:")


def browser_path() -> str:
    """The program of a browser; skips the test without one, or fails it if one is asked for."""
    for name in NAMES:
        if path := shutil.which(name):
            return path
    reason = f"no browser: none of {', '.join(NAMES)} is installed (make pages installs one)"
    if os.environ.get("ENCIRCLE_BROWSER") == "yes":
        pytest.fail(reason)
    pytest.skip(reason)


@contextmanager
def running_browser() -> Iterator[Any]:
    """A browser without a window, ended at the end."""
    path = browser_path()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*OPTIONS])
        try:
            yield browser
        finally:
            browser.close()


class SeenPage:
    """A page in a browser, with all that it asked of the network and said on its console.

    Playwright's own limits are off: a test that hangs is ended by the limit on all tests.
    """

    def __init__(self, browser: Any, **options: Any) -> None:
        self.context = browser.new_context(
            **{"viewport": LAPTOP, "color_scheme": "light"} | options
        )
        self.context.set_default_timeout(0)
        self.page = self.context.new_page()
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._hear)

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)

    def open(self, address: str) -> "SeenPage":
        """Open an address and wait until the page shows a run."""
        self.page.goto(address)
        return self.until("encircle.state().ready")

    def until(self, condition: str) -> "SeenPage":
        """Wait until an expression of the page's is true, and what comes of it is drawn."""
        self.page.wait_for_function(f"() => window.encircle && ({condition})")
        return self.drawn()

    def state(self) -> dict[str, Any]:
        """What the page says that it shows."""
        return self.page.evaluate("encircle.state()")

    def do(self, act: str) -> "SeenPage":
        """Do something by the page's interface for scripts, and let it be drawn."""
        self.page.evaluate(f"encircle.{act}")
        return self.drawn()

    def press(self, *keys: str) -> "SeenPage":
        """Press keys, one after another, and let what comes of it be drawn."""
        for key in keys:
            self.page.keyboard.press(key)
        return self.drawn()

    def drawn(self) -> "SeenPage":
        """Wait until what has changed is drawn."""
        self.page.evaluate(
            "new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))"
        )
        return self

    def text(self, selector: str) -> str:
        """The text of an element."""
        return self.page.text_content(selector)

    @property
    def foreign_requests(self) -> list[str]:
        """Requests for anything that is not in the file itself."""
        return [url for url in self.requests if not url.startswith(OWN_SCHEMES)]
