"""The floor for our processes: lock-step rounds over Zenoh by robots that decide nothing.

One world process and N robot processes exchange the same messages per round as the hunt does, an
observation out and a pose and a command back, of the same sizes, over sessions configured as ours,
waiting inside Zenoh on both sides. Nothing is encoded, decoded, checked, decided or recorded.
"""

import asyncio
import json
import subprocess
import sys
import time

import zenoh

from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.runner.launch import free_endpoint

WARM_UP = 50


def robot(place: int, endpoint: str, pose_bytes: int, command_bytes: int) -> None:
    """Answer each observation with a pose and a command, until an empty one."""
    link = ZenohConnection(Endpoints(connect=(endpoint,)), f"bare/robots/{place}/observation")
    link.send(f"bare/robots/{place}/ready", b"ready")
    pose, command = bytes(pose_bytes), bytes(command_bytes)
    while link.receive()[1]:
        link.send(f"bare/robots/{place}/pose", pose)
        link.send(f"bare/robots/{place}/command", command)
    link.close()


async def asyncio_robot(place: int, endpoint: str, pose_bytes: int, command_bytes: int) -> None:
    """The same with every message handed over to an event loop, for comparison."""
    loop = asyncio.get_running_loop()
    arrived: asyncio.Queue[bytes] = asyncio.Queue()
    link = ZenohConnection(Endpoints(connect=(endpoint,)), f"bare/robots/{place}/nothing")

    def hand_over(sample: zenoh.Sample) -> None:
        loop.call_soon_threadsafe(arrived.put_nowait, sample.payload.to_bytes())

    callback = zenoh.handlers.Callback(hand_over, indirect=False)
    link.session.declare_subscriber(f"bare/robots/{place}/observation", callback)
    link.send(f"bare/robots/{place}/ready", b"ready")
    pose, command = bytes(pose_bytes), bytes(command_bytes)
    while await arrived.get():
        link.send(f"bare/robots/{place}/pose", pose)
        link.send(f"bare/robots/{place}/command", command)
    link.close()


def world(kind: str, robots: int, rounds: int, sizes: tuple[int, int, int]) -> dict[str, float]:
    """Run the barrier; returns rounds per second and the median round in microseconds."""
    endpoint = free_endpoint()
    link = ZenohConnection(Endpoints(listen=(endpoint,)), "bare/robots/*/*")
    started = [
        subprocess.Popen(
            [sys.executable, __file__, kind, str(i), endpoint, str(sizes[1]), str(sizes[2])]
        )
        for i in range(robots)
    ]
    for _ in range(robots):
        link.receive()
    observation, took = bytes(sizes[0]), []
    for _ in range(rounds + WARM_UP):
        begun = time.perf_counter()
        for i in range(robots):
            link.send(f"bare/robots/{i}/observation", observation)
        for _ in range(2 * robots):
            link.receive()
        took.append(time.perf_counter() - begun)
    for i in range(robots):
        link.send(f"bare/robots/{i}/observation", b"")
    for process in started:
        process.wait(10)
    link.close()
    kept = sorted(took[WARM_UP:])
    return {"rounds_per_s": len(kept) / sum(kept), "round_us_median": kept[len(kept) // 2] * 1e6}


if __name__ == "__main__":
    role, *rest = sys.argv[1:]
    if role == "world":
        kind, *numbers = rest
        n, rounds, *sizes = map(int, numbers)
        print(json.dumps(world(kind, n, rounds, (sizes[0], sizes[1], sizes[2]))))
    elif role == "robot":
        robot(int(rest[0]), rest[1], int(rest[2]), int(rest[3]))
    else:
        asyncio.run(asyncio_robot(int(rest[0]), rest[1], int(rest[2]), int(rest[3])))
