"""Hunts as processes, each ended with its test."""

from collections.abc import Iterator

import pytest
from helpers_hunt import ENDLESS, LONG, Hunt


@pytest.fixture
def hunt(tmp_path) -> Iterator[Hunt]:
    made = Hunt(tmp_path, ENDLESS)
    yield made
    made.close()


@pytest.fixture
def finite_hunt(tmp_path) -> Iterator[Hunt]:
    made = Hunt(tmp_path, LONG)
    yield made
    made.close()
