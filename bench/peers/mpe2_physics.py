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
    begun, cpu_begun = time.perf_counter(), time.process_time()
    for _ in range(steps):
        environment.step(actions)
    took_s, cpu_s = time.perf_counter() - begun, time.process_time() - cpu_begun
    print(json.dumps({"steps_per_s": steps / took_s, "cpu_steps_per_s": steps / cpu_s}))
