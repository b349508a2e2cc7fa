"""What is not the policy's own is not held against it."""

import gc
import os

from encircle.agents.policies.paper import xi_star
from encircle.conformance import scenes
from encircle.conformance.outside import check_outside
from encircle.conformance.subject import Subject


def test_what_runs_while_garbage_is_collected_is_not_the_policys():
    alone = {"alone": scenes.scenarios("xi-star", [], 2)["alone"]}
    parts = scenes.record(alone).participations

    def collected(_phase, _info):
        os.urandom(1)

    def policy(memory, view):
        # Lists that hold themselves, for the collector to find.
        for _ in range(50):
            circle = []
            circle.append(circle)
        return xi_star(memory, view)

    before = gc.get_threshold()
    gc.callbacks.append(collected)
    gc.set_threshold(10)
    try:
        result = check_outside(Subject("policy", policy, {}), parts)
    finally:
        gc.set_threshold(*before)
        gc.callbacks.remove(collected)
    assert result.level == "ok"
    assert gc.isenabled()
