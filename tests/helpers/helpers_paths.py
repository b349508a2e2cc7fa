"""Where things lie in the repository, for tests that read its files."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
DOCS = ROOT / "docs"
STRANGER = TESTS / "system" / "hunts" / "stranger"
