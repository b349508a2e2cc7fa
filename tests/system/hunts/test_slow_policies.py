"""Policies that answer too late: one line each names policy, robot and tick, and the hunt goes on.

The policy is in a file and sleeps in one robot: by the clock for some ticks, in lock-step for as
long as a second file is there.
"""

import os
import re
import signal

import pytest
from helpers_waiting import ample_s

import encircle
from encircle.agents.process.slow_decisions import ANSWER_S_MAX
from encircle.protocol.plugin_files import FOLDERS

POLICY = """
import time
from pathlib import Path

from encircle.agents.policies.paper import xi_star


def slow(memory, view):
    if view.robot == "r2" and view.tick >= 5:
        time.sleep(SLEEP_S)
    return xi_star(memory, view)


def held(memory, view):
    while view.robot == "r2" and view.tick == 5 and Path(__file__).with_name("hold").exists():
        time.sleep(0.05)
    return xi_star(memory, view)
"""


@pytest.fixture
def policies(tmp_path, monkeypatch):
    """The folder in which all nodes look for policies."""
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    (tmp_path / "slow.py").write_text(POLICY)
    return tmp_path


@pytest.mark.realtime
def test_by_the_clock_the_first_late_answer_is_told_and_the_others_counted(policies):
    tick_s = ample_s() / 20.0
    (policies / "slow.py").write_text(POLICY.replace("SLEEP_S", repr(3.0 * tick_s)))
    told = []
    changes = ("clock=wall", f"tick_s={tick_s}", "ticks_max=40", "team.strategy=slow.py:slow")
    hunt = encircle.run("sim1", overrides=changes, progress=told.append)
    lines = [report["log"] for report in told if "log" in report]
    late = [line for line in lines if line.startswith("robot r2: policy 'slow.py:slow' took")]
    first = r"took \S+ s at tick (\d+) \(\S+ s of processor time\), more than a tick of"
    matched = re.search(rf"{first} {tick_s:g} s: its answer came late", late[0])
    assert int(matched[1]) >= 5 or len(late) > 1
    assert re.search(
        rf"took more than a tick of {tick_s:g} s for \d+ of \d+ decisions, \S+ s at most", late[-1]
    )
    assert len(late) == 2
    assert all("\n" not in line for line in lines)
    # The others go on, and r2's newest step is repeated.
    assert hunt.result.ticks >= 20
    assert hunt.timing["real_time"]["robots"]["r2"]["held"] > 0


def test_in_lock_step_the_world_says_whose_policy_it_waits_for(hunt, policies):
    hold = policies / "hold"
    hold.touch()
    answer_s = max(2.0 * ANSWER_S_MAX, ample_s())
    hunt.limits = (
        *("--answer-timeout", f"{answer_s:g}"),
        *("--set", "team.strategy=slow.py:held", "--set", "ticks_max=1000000"),
        # Three of them are not to capture it before the fourth is back.
        *("--set", "target.step_m_max=0.6"),
    )
    hunt.start_all()
    silent = f"lost: no answer for {answer_s:g} s"
    hunt.wait_for(lambda seen: seen == [("r2", silent)])
    hold.unlink()
    hunt.wait_for(lambda seen: seen[1:] == [("r2", "back")])
    os.kill(hunt.world.pid, signal.SIGTERM)
    assert hunt.world.end() == 1
    assert [node.end() for node in hunt.robots.values()] == [1] * 4
    line = f"world: tick 5: robot r2 is {silent} (policy 'slow.py:held')"
    assert line in hunt.world.said.splitlines()
    (report,) = [r for r in hunt.world.reports() if "policy" in r]
    assert report == {"departure": [5, "r2", silent], "policy": "policy 'slow.py:held'"}
    late = [line for line in hunt.robots["r2"].said.splitlines() if "took" in line]
    assert len(late) == 1
    assert re.fullmatch(
        rf"robot r2: policy 'slow.py:held' took \S+ s at tick 5 \(\S+ s of processor time\), more"
        rf" than the {ANSWER_S_MAX:g} s that a world waits by default: its answer came late",
        late[0],
    )
    assert not any("took" in hunt.robots[robot].said for robot in ("r1", "r3", "r4"))


def test_in_lock_step_a_run_that_ends_for_want_of_an_answer_names_the_policy(hunt, policies):
    (policies / "hold").touch()
    answer_s = ample_s()
    hunt.limits = (
        *("--answer-timeout", f"{answer_s:g}", "--when-lost", "end"),
        *("--set", "team.strategy=slow.py:held"),
    )
    hunt.start_all()
    assert hunt.world.end() == 1
    # Its robot, which is still deciding, does not go on for ever either.
    os.kill(hunt.robots["r2"].pid, signal.SIGTERM)
    assert hunt.robots["r2"].end() == 1
    assert hunt.robots["r2"].said.splitlines()[-1] == "robot r2: stopped by SIGTERM"
    ended = f"no answer from r2 for {answer_s:g} s at tick 5 (policy 'slow.py:held')"
    assert hunt.world.result()["ended"] == f"failed: {ended}"
    assert any(ended in line for line in hunt.world.said.splitlines())
