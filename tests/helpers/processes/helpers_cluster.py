"""A dask scheduler and its workers, as processes of a test's own."""

import subprocess
import sys
from pathlib import Path

from encircle.runner.launch import free_endpoint


class Cluster:
    """A dask scheduler and workers of the test's own, on loopback."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch
        self.address = free_endpoint().replace("tcp/", "tcp://")
        self.processes: list[subprocess.Popen[bytes]] = []
        port = self.address.rsplit(":", 1)[1]
        self._start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")

    def add_worker(self, folder: Path | None = None) -> subprocess.Popen[bytes]:
        """Start a worker, in a folder of its own."""
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        local = ("--local-directory", str(self.scratch), "--memory-limit", "0")
        return self._start("worker", self.address, *options, *local, folder=folder)

    def _start(self, *words: str, folder: Path | None = None) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            cwd=folder,
        )
        self.processes.append(process)
        return process

    def end(self) -> None:
        """Kill them all."""
        for process in self.processes:
            process.kill()
            process.wait()
