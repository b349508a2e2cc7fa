"""Hunts as processes to which a seed's blows happen, and what must hold of each whatever they are.

A world, its robots and perhaps a router on loopback; robots and world are killed or frozen, the
router too, and started again, in the middle of the run. In the end:

1. every process ends by itself, with the status and the one line that belong to what was done;
2. nobody shows a traceback, and neither a process nor a listening port is left behind;
3. the recording is whole, fresh brains decide the same on it, and a world that is fed with it comes
   to the digest that was told;
4. if no robot was lost, that is the digest of the same scenario in memory;
5. cut off anywhere, the recording is gone on with to an end, and to the same one if no robot was
   lost.
"""

import os
import random
import shutil
import signal
import socket
import tempfile
from collections import Counter
from contextlib import suppress
from pathlib import Path

from helpers_hosts import NodeProcess
from helpers_hunt import LONG, Hunt
from helpers_scenarios import STRATEGIES, drawn_channel, drawn_parameters
from helpers_waiting import LONGEST_S, until

import encircle
from encircle.replay.replaying import replay
from encircle.world.loading.load import load
from encircle.world.recording.recording import RecordingError, read_recording
from encircle.world.recording.resuming import digest_of
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

BLOWS = (
    *("kill robot", "kill robot", "freeze robot", "freeze robot", "freeze world"),
    *("restart router", "restart router", "freeze router", "kill world", "kill and return"),
)
TICKS = (150, 400)
BY_CLOCK_SHARE, TERMINATED_SHARE, SILENT_SHARE, CUT_SHARE = 0.15, 0.1, 0.05, 0.3
TRIES_MAX = 50
LATE_JOIN_S = 10.0
TOO_LATE = ("did not take this robot in within", "cannot connect to")

# For the nodes, which lose nobody by a limit of time unless they are told to.
os.environ.setdefault("ENCIRCLE_ANSWER_TIMEOUT", f"{LONGEST_S}")


def struck(seed: int) -> Counter[str]:
    """One run of a seed; what was done to it and what came of it. Raises what is broken."""
    with tempfile.TemporaryDirectory() as folder:
        run = _Struck(Path(folder), seed)
        try:
            run.play()
            run.check_processes()
            run.check_recording()
        except BaseException as error:
            for name, node in run.names.items():
                error.add_note(f"{name}: {node.said[-1500:]}")
            raise
        finally:
            run.hunt.close()
        return run.figures


def drawn(draws: random.Random) -> Scenario:
    """A hunt whose target is out of reach, so that there is time for things to happen."""
    for _ in range(TRIES_MAX):
        count = draws.randint(3, 5)
        ids = [f"r{k + 1}" for k in range(count)]
        by_clock = draws.random() < BY_CLOCK_SHARE
        singles = {robot: {"strategy": draws.choice(STRATEGIES)} for robot in ids[:1]}
        tree = LONG | {
            "seed": draws.randrange(2**32),
            "ticks_max": draws.randint(*TICKS),
            "clock": "wall" if by_clock else "lockstep",
            "tick_s": 0.02 if by_clock else 0.1,
            "team": LONG["team"]
            | {"strategy": draws.choice(STRATEGIES), "robots": singles | {"count": count}},
            "channel": drawn_channel(draws, ids),
            "robot": drawn_parameters(draws),
        }
        try:
            return load(tree)
        except ScenarioError:
            continue
    raise AssertionError(f"no scenario in {TRIES_MAX} tries")


class _Struck:
    def __init__(self, folder: Path, seed: int) -> None:
        self.draws = random.Random(f"struck {seed}")
        self.scenario = drawn(self.draws)
        self.hunt = Hunt(folder, self.scenario.model_dump(mode="json"))
        self.figures: Counter[str] = Counter({"by the clock": int(self.by_clock)})
        self.names: dict[str, NodeProcess] = {}
        self.by_router = self.draws.random() < 0.5
        self.router: NodeProcess | None = None
        self.robots_lost = False
        self.late: set[str] = set()
        self.terminated = self.draws.random() < TERMINATED_SHARE
        if self.draws.random() < SILENT_SHARE:
            self.hunt.lose_the_silent()
            self.figures["silent robots are lost"] += 1

    @property
    def by_clock(self) -> bool:
        return self.scenario.clock == "wall"

    def play(self) -> None:
        """From the start of all nodes to the end of the world."""
        hunt, draws = self.hunt, self.draws
        if self.by_router:
            self._start_router()
        hunt.start_world("--connect" if self.by_router else "--listen")
        self.names["world"] = hunt.world
        for robot in self.scenario.ids:
            self._start_robot(robot)
        blows = sorted(
            (draws.randint(1, self.scenario.ticks_max * 3 // 4), draws.choice(BLOWS))
            for _ in range(draws.randint(1, 4))
        )
        for tick, blow in blows:
            if not self._reached(tick):
                break
            getattr(self, "_" + blow.replace(" ", "_"))()
        if self.terminated and self._reached(self.scenario.ticks_max // 2):
            hunt.world.terminate()
            self.figures["terminated"] += 1
        self.status = hunt.world.end()

    def _reached(self, tick: int) -> bool:
        """Wait for a tick; whether it came before the run's end."""
        world = self.hunt.world
        until(lambda: world.tick >= tick or not world.running, f"tick {tick}", lambda: world.tick)
        return world.running

    def _start_router(self) -> None:
        self.router = self.names[f"router {len(self.names)}"] = self.hunt.start_router()

    def _start_robot(self, robot: str, join_s: float = LONGEST_S) -> None:
        waits = ("--world-timeout", f"{LONGEST_S}", "--join-timeout", f"{join_s}")
        node = self.hunt.start_robot(robot, *waits)
        self.names[f"{robot} {len(self.names)}"] = node

    def _some_robot(self) -> str | None:
        running = [r for r in self.scenario.ids if self.hunt.robots[r].running]
        # One stays: a run without any robot ends, which is another test.
        return self.draws.choice(running) if len(running) > 1 else None

    def _kill_robot(self) -> str | None:
        robot = self._some_robot()
        if robot is not None:
            self.robots_lost = True
            self.hunt.robots[robot].kill()
            self.figures["robot killed"] += 1
        return robot

    def _kill_and_return(self) -> None:
        robot = self._kill_robot()
        if robot is None:
            return
        world = self.hunt.world
        until(
            lambda: (robot, "lost: it is gone") in self.hunt.departures or not world.running,
            f"the loss of {robot}",
            lambda: world.tick,
        )
        if world.running:
            self._start_robot(robot, LATE_JOIN_S)
            self.late.add(robot)
            self.figures["robot started anew"] += 1

    def _freeze_robot(self) -> None:
        robot = self._some_robot()
        if robot is not None:
            self._freeze(self.hunt.robots[robot], "robot")

    def _freeze_world(self) -> None:
        self._freeze(self.hunt.world, "world")

    def _freeze_router(self) -> None:
        if self.router is not None:
            self._freeze(self.router, "router")

    def _freeze(self, node: NodeProcess, kind: str) -> None:
        """Stop a node until it stands still, and let it go on."""
        try:
            os.kill(node.pid, signal.SIGSTOP)
        except ProcessLookupError:
            return
        try:
            until(lambda: _state(node.pid) in "TZX", f"{kind} {node.pid} to stand still")
            if self.hunt.limits and kind == "robot":
                # Long enough to be lost.
                seen = len(self.hunt.departures)
                world = self.hunt.world
                until(
                    lambda: len(self.hunt.departures) > seen or not world.running,
                    "the loss of the silent",
                )
        finally:
            os.kill(node.pid, signal.SIGCONT)
        self.robots_lost |= bool(self.hunt.limits)
        self.figures[f"{kind} frozen"] += 1

    def _restart_router(self) -> None:
        if self.router is None:
            return
        if self.draws.random() < 0.5:
            self.router.kill()
        else:
            self.router.terminate()
        self._start_router()
        self.figures["router restarted"] += 1

    def _kill_world(self) -> None:
        """The world is killed, and resumed: its robots wait for it."""
        hunt = self.hunt
        if self.by_clock or self.figures["world killed"] or not _can_be_resumed(hunt.out):
            return
        if self._is_over_while_it_stands_still(hunt.world):
            # There is nothing to go on with.
            return
        hunt.world.kill()
        hunt.world.end()
        where = ("--connect" if self.by_router else "--listen", hunt.endpoint)
        hunt.world = hunt.start("world", "--resume", str(hunt.out), *where, *hunt.limits)
        self.names[f"world {len(self.names)}"] = hunt.world
        self.figures["world killed"] += 1

    def _is_over_while_it_stands_still(self, world: NodeProcess) -> bool:
        """Stop the world; whether its run is over, and then it goes on to its end."""
        try:
            os.kill(world.pid, signal.SIGSTOP)
        except ProcessLookupError:
            return True
        until(lambda: _state(world.pid) in "TZX", f"world {world.pid} to stand still")
        is_over = not world.running or read_recording(self.hunt.out).complete
        if is_over:
            with suppress(ProcessLookupError):
                os.kill(world.pid, signal.SIGCONT)
        return is_over

    # What must hold.

    def check_processes(self) -> None:
        """Each has ended as what was done to it says, and nothing is left."""
        hunt = self.hunt
        said = [line for line in hunt.world.said.splitlines() if line]
        if self.figures["terminated"] and self.status == 1:
            assert "stopped by SIGTERM" in said[-1], said[-3:]
            expected = 1
        else:
            assert self.status == 0, said[-3:]
            expected = 0
        for robot in self.scenario.ids:
            node = hunt.robots[robot]
            status = node.end()
            if (
                status == 1
                and robot in self.late
                and any(words in node.said.splitlines()[-1] for words in TOO_LATE)
            ):
                # The run was over before it had begun.
                self.figures["robot came too late"] += 1
                continue
            assert status in (expected, -signal.SIGKILL), (robot, status, node.said[-600:])
        if self.router is not None:
            assert self.router.terminate() == 0, self.router.said
        for name, node in self.names.items():
            assert not node.running, name
            assert "Traceback" not in node.said, f"{name}: {node.said}"
        _check_port(hunt.endpoint)
        left = [pid for pid, words in _processes().items() if hunt.endpoint in words]
        assert not left, f"left behind: {left}"
        self.figures["ended " + ("in order" if expected == 0 else "by SIGTERM")] += 1

    def check_recording(self) -> None:
        """It is whole, is replayed to the same, and gone on with from a cut."""
        out, result = self.hunt.out, self.hunt.world.result()
        check = replay(out)
        assert not check.differences, check.differences[:3]
        recording = read_recording(out)
        self.figures["ticks"] += result["ticks"]
        self.figures["robots lost"] += sum(what != "back" for _, _, what in result["departures"])
        self.figures["robots back"] += sum(what == "back" for _, _, what in result["departures"])
        self.figures["refused"] += sum(result["refused"].values())
        if self.by_clock:
            return
        assert digest_of(recording) == result["digest"]
        self.robots_lost |= bool(result["departures"])
        if self.status != 0:
            return
        assert recording.complete
        if not self.robots_lost:
            memory = encircle.run(self.scenario, link="memory")
            assert memory.digest == result["digest"], "over Zenoh it is another run"
            self.figures["same as in memory"] += 1
        if self.draws.random() < CUT_SHARE:
            self._check_cut(result["digest"])

    def _check_cut(self, digest: str) -> None:
        into = self.hunt.folder / "cut"
        into.mkdir()
        shutil.copy(self.hunt.out / "recording.mcap", into)
        path = into / "recording.mcap"
        size = path.stat().st_size
        os.truncate(path, int(size * self.draws.uniform(0.3, 0.99)))
        resumed = encircle.resume(into, link="memory")
        assert resumed.result.ended in ("ticks", "captured")
        assert replay(into).same
        if not self.robots_lost:
            assert resumed.digest == digest
        self.figures["gone on with from a cut"] += 1


def _can_be_resumed(out: Path) -> bool:
    """Whether a part of the recording is on the disk; of the first ticks there is none."""
    try:
        return bool(read_recording(out).messages)
    except RecordingError:
        return False


def _state(pid: int) -> str:
    """The letter of a process's state; X if it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return "X"


def _processes() -> dict[int, str]:
    """The command lines of all that run."""
    lines: dict[int, str] = {}
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            lines[int(path.parent.name)] = path.read_bytes().replace(b"\0", b" ").decode()
        except (OSError, UnicodeDecodeError):
            continue
    return lines


def _check_port(endpoint: str) -> None:
    """Nobody listens there any more."""
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    with socket.socket() as tried:
        tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        tried.bind((host, int(port)))
