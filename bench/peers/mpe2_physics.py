"""Steps per second of MPE2's simple_tag with N pursuers: physics, no messages, no decisions."""

import json
import sys
import time

from mpe2 import simple_tag_v3

if __name__ == "__main__":
    robots, steps = int(sys.argv[1]), int(sys.argv[2])
    environment = simple_tag_v3.parallel_env(
        num_good=1, num_adversaries=robots, num_obstacles=0, max_cycles=10**9
    )
    environment.reset(seed=0)
    actions = dict.fromkeys(environment.agents, 1)
    begun = time.perf_counter()
    for _ in range(steps):
        environment.step(actions)
    print(json.dumps({"steps_per_s": steps / (time.perf_counter() - begun)}))
