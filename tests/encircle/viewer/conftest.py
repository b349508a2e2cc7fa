"""A browser for the tests of the page, one for each module.

As long as it is there an event loop runs in the thread of the tests, in which ``asyncio.run`` is
refused: tests of other modules must not meet it.
"""

import pytest
from helpers_browser import SeenPage, running_browser


@pytest.fixture(scope="module")
def browser():
    with running_browser() as running:
        yield running


@pytest.fixture
def new_page(browser):
    """Makes pages, and closes them."""
    opened = []

    def make(**options):
        opened.append(SeenPage(browser, **options))
        return opened[-1]

    yield make
    for seen in opened:
        seen.context.close()
