"""What is made in a directory of its own is made whole, or not at all."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def emptied_on_failure(directory: Path) -> Iterator[None]:
    """Leave a directory that is empty now as it is, if what is made in it is left before its end.

    The next start would find it in use.
    """
    try:
        yield
    except BaseException:
        for made in directory.iterdir():
            if made.is_dir():
                shutil.rmtree(made)
            else:
                made.unlink()
        raise
