"""Why a directory cannot be used, in plain words."""

from pathlib import Path


def unusable(directory: Path, error: OSError) -> str:
    """``runs/one cannot be used: ...``, and why; a file that is in its place is named."""
    reason = error.strerror or str(error)
    if isinstance(error, FileExistsError | NotADirectoryError):
        for path in (directory, *directory.parents):
            if path.exists() and not path.is_dir():
                what = "it" if path == directory else str(path)
                reason = f"{what} is a file, and a directory is needed"
    return f"{directory} cannot be used: {reason}"
