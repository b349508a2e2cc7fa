"""``python .../under_load.py COMMAND...``: run a command while every core is busy.

Two busy loops for each core compete with it at the same priority, for as long as it lasts; they end
by themselves if this program is killed. Its exit status is the command's.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

LOOPS_PER_CORE = 2
LOOP = """
import os, sys
while os.getppid() == int(sys.argv[1]):
    sum(range(100_000))
"""


@contextmanager
def load(loops: int = LOOPS_PER_CORE * (os.cpu_count() or 1)) -> Iterator[list[int]]:
    """Keep all cores busy in a context; the process ids of the busy loops."""
    command = [sys.executable, "-S", "-c", LOOP, f"{os.getpid()}"]
    started = [subprocess.Popen(command) for _ in range(loops)]
    try:
        yield [loop.pid for loop in started]
    finally:
        for loop in started:
            loop.kill()
            loop.wait()


def main(command: Sequence[str]) -> int:
    """Run the command; its exit status, or that of the signal that ended it."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _frame: sys.exit(128 + number))
    with load() as loops:
        print(f"under load: {len(loops)} busy loops", file=sys.stderr, flush=True)
        return subprocess.call(command)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
