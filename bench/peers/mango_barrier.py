"""The same lock-step barrier over mango's TCP containers, for comparison; it decides nothing.

Usage: mango_barrier.py ROBOTS ROUNDS. One container per process; the coordinator sends every robot
a message of numbers per round and waits for all answers.
"""

import asyncio
import json
import socket
import subprocess
import sys
import time

from mango import Agent, activate, addr, create_tcp_container

WARM_UP = 50
OBSERVATION_NUMBERS = 40
ANSWER_NUMBERS = 20


class Coordinator(Agent):
    """Counts answers."""

    def __init__(self):
        super().__init__()
        self.answers = asyncio.Queue()

    def handle_message(self, content, meta):
        self.answers.put_nowait(content)


class Answerer(Agent):
    """Answers every round at once."""

    def __init__(self, coordinator):
        super().__init__()
        self.coordinator = coordinator
        self.over = asyncio.Event()

    def handle_message(self, content, meta):
        if content is None:
            self.over.set()
        else:
            self.schedule_instant_message([1.0] * ANSWER_NUMBERS, self.coordinator)


def free_ports(count):
    """Ports on loopback that are free now."""
    probes = [socket.socket() for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


async def answer(port, coordinator_port):
    container = create_tcp_container(addr=("127.0.0.1", port))
    agent = container.register(Answerer(addr(("127.0.0.1", coordinator_port), "coordinator")), "me")
    async with activate(container):
        await asyncio.sleep(0.5)
        await container.send_message("ready", agent.coordinator)
        await agent.over.wait()


async def coordinate(robots, rounds):
    own, *ports = free_ports(robots + 1)
    container = create_tcp_container(addr=("127.0.0.1", own))
    agent = container.register(Coordinator(), "coordinator")
    targets = [addr(("127.0.0.1", port), "me") for port in ports]
    async with activate(container):
        processes = [
            subprocess.Popen([sys.executable, __file__, "answer", str(port), str(own)])
            for port in ports
        ]
        for _ in range(robots):
            await agent.answers.get()
        took = []
        for _ in range(rounds + WARM_UP):
            begun = time.perf_counter()
            for target in targets:
                agent.schedule_instant_message([1.0] * OBSERVATION_NUMBERS, target)
            for _ in range(robots):
                await agent.answers.get()
            took.append(time.perf_counter() - begun)
        for target in targets:
            await container.send_message(None, target)
        await asyncio.sleep(0.3)
    for process in processes:
        process.terminate()
        process.wait(10)
    kept = sorted(took[WARM_UP:])
    print(json.dumps({"rounds_per_s": len(kept) / sum(kept)}))


if __name__ == "__main__":
    if sys.argv[1] == "answer":
        asyncio.run(answer(int(sys.argv[2]), int(sys.argv[3])))
    else:
        asyncio.run(coordinate(int(sys.argv[1]), int(sys.argv[2])))
