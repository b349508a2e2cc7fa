"""A browser for all tests of the page that one worker runs."""

import pytest
from helpers_browser import SeenPage, running_browser


@pytest.fixture(scope="session")
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
