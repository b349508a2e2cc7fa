"""A compose project as long as a test lasts, and what became of its containers."""

import json
import os
import re
from collections.abc import Callable, Sequence

from helpers_engine import Daemon, output
from helpers_paths import ROOT
from helpers_waiting import completed, until


class Project:
    """Containers of some compose files. Use as a context, which removes them and their network.

    ``program``: the Compose to be used.
    """

    def __init__(
        self,
        engine: Daemon,
        name: str,
        files: Sequence[str],
        settings: dict[str, str],
        program: str = "docker-compose",
    ) -> None:
        self._engine = engine
        chosen = [part for file in files for part in ("--file", str(ROOT / file))]
        self._compose = [program, "--project-name", name, *chosen]
        self._env = engine.env | settings

    def __enter__(self) -> "Project":
        return self

    def __exit__(self, *_: object) -> None:
        self.compose("down", "--timeout", "5")

    def compose(self, *arguments: str) -> str:
        return output(*self._compose, *arguments, env=self._env)

    def up(self, *options: str) -> None:
        """``docker compose up`` as a user gives it: it comes back when all have ended."""
        command = [*self._compose, "up", "--no-build", "--no-color", *options]
        said = completed(command, env=os.environ | self._env)
        assert said.returncode == 0, said.stdout[-8000:] + said.stderr[-8000:]

    def start(self) -> None:
        """The same without waiting for the end."""
        try:
            self.compose("up", "--no-build", "--detach")
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.compose('logs', '--no-color')}") from None

    def inspected(self, field: str) -> dict[str, str]:
        """A field of ``docker inspect`` of every container, by service (and number, above one)."""
        form = (
            '{{index .Config.Labels "com.docker.compose.service"}}'
            '{{index .Config.Labels "com.docker.compose.container-number"}} {{json ' + field + "}}"
        )
        ids = self.compose("ps", "--all", "--quiet").split()
        lines = self._engine.docker("inspect", "--format", form, *ids).splitlines()
        pairs = (line.split(" ", 1) for line in lines)
        return {name.removesuffix("1"): json.loads(value) for name, value in pairs}

    def statuses(self) -> dict[str, str]:
        """Exit status of every container; ``AssertionError`` if some do not end in time."""
        self.wait_until(lambda: "running" not in self.inspected(".State.Status").values())
        return self.inspected(".State.ExitCode")

    def logs(self, service: str) -> str:
        return self.compose("logs", "--no-color", service)

    def tick(self) -> int:
        """How far the world has come."""
        ticks = re.findall(r"world: tick (\d+)", self.logs("world"))
        return max(map(int, ticks), default=-1)

    def wait_for_tick(self, tick: int) -> None:
        """Until the world has come so far."""
        self.wait_until(lambda: self.tick() >= tick)

    def wait_for_line(self, service: str, part: str) -> None:
        """Until a service has said something."""
        self.wait_until(lambda: part in self.logs(service))

    def wait_until(self, happened: Callable[[], bool]) -> None:
        try:
            until(happened, "the containers to go on", self.tick)
        except AssertionError as error:
            said = self.compose("ps") + self.compose("logs")
            raise AssertionError(f"{error}\n{said}") from None
