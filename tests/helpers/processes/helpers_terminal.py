"""What a person sees: a command on a terminal of its own, and the screen that comes of it."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
from collections.abc import Sequence
from pathlib import Path

COLUMNS, ROWS = 80, 60
_PART = re.compile(r"\x1b\[[?]?([0-9;]*)([A-Za-z])|(\r)|(\n)|([^\x1b\r\n]+)")


def screen(written: str) -> list[str]:
    """The lines that are left on a screen wide enough: all that our programs do with one."""
    lines, row, column = [""], 0, 0
    for match in _PART.finditer(written):
        number, code, back, new, text = match.groups()
        if back:
            column = 0
        elif new:
            # A terminal's driver puts a carriage return before it.
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif text:
            before = lines[row].ljust(column)
            lines[row] = before[:column] + text + before[column + len(text) :]
            column += len(text)
        elif code == "A":
            row = max(0, row - int(number or 1))
        elif code == "K":
            lines[row] = "" if number == "2" else lines[row][:column]
    return [line.rstrip() for line in lines if line.strip()]


def seen(command: Sequence[str], folder: Path) -> tuple[int, list[str]]:
    """Run a command on a terminal; its exit status, and what is on the screen at its end."""
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "NO_COLOR")}
    process = subprocess.Popen(
        command,
        cwd=folder,
        env=environment | {"TERM": "xterm-256color"},
        stdin=its,
        stdout=its,
        stderr=its,
        start_new_session=True,
    )
    os.close(its)
    written = b""
    try:
        while part := _read(ours):
            written += part
        return process.wait(), screen(written.decode())
    finally:
        process.kill()
        process.wait()
        os.close(ours)


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # the last who had it open is gone
        return b""
