"""Remarks on scenarios that can be run but may not be what was meant; and that they are told."""

import json
import warnings
from pathlib import Path

import pytest
from helpers_commands import ours, run_forked

import encircle
from encircle.runner.memory import run_in_memory
from encircle.studies.plan_files import load_plan
from encircle.world.arena.engine import build
from encircle.world.loading.files import shipped
from encircle.world.loading.load import load
from encircle.world.loading.remarks import remarks_on

SMALL = {"ticks_max": 3, "team": {"robots": 4}}
NEVER = "can never capture"


def remarks(*changes, **tables):
    return remarks_on(load({**SMALL, **tables}, changes))


@pytest.mark.parametrize("name", shipped())
def test_nothing_is_remarked_on_the_shipped_scenarios(name):
    assert remarks_on(load(name)) == []


@pytest.mark.parametrize(("robots", "who"), [(1, "one robot"), (2, "2 robots")])
def test_a_team_of_one_or_two_is_told_that_it_can_never_capture(robots, who):
    (line,) = remarks(f"team.robots={robots}")
    assert line.startswith(f"team.robots = {robots}: {who} {NEVER}")
    (line,) = remarks(team={"positions": [[4.0 * k - 6.0, 0.0] for k in range(robots)]})
    assert line.startswith(f"team.positions: {who} {NEVER}")
    assert remarks("team.robots=3") == []


def test_a_count_above_what_fits_is_told_of_and_one_above_what_is_possible_as_well():
    assert remarks("team.robots=8") == remarks("team.robots=8", "capture.count=5") == []
    (line,) = remarks("team.robots=8", "capture.count=6")
    assert line.startswith("capture.count = 6: only 5 robots fit around the target")
    (line,) = remarks("team.robots=8", "capture.count=8")
    assert "no more than 7 robots" in line
    assert "a capture takes 8" in line
    (line,) = remarks(
        "team.radius_m=1.0",
        "target.radius_m=0.1",
        "capture.stop_distance_m=1.1",
        team={"robots": 3},
    )
    assert "no more than 2 robots" in line


def test_a_team_given_as_a_table_is_told_by_the_key_of_its_count():
    (line,) = remarks("team.robots=2", "team.robots.r1.step_m_max=0.1")
    assert line.startswith(f"team.robots.count = 2: 2 robots {NEVER}")


def test_a_radio_that_reaches_no_body_is_told_of():
    (line,) = remarks("team.robots.r2.radio_range_m=0.9")
    assert line.startswith("team.robots.r2.radio_range_m = 0.9: ")
    assert remarks("team.robots.r2.radio_range_m=1.0") == []


def crash(robot, tick, ticks=None):
    return {"kind": "crash", "robot": robot, "tick": tick, **({"ticks": ticks} if ticks else {})}


def test_crashes_that_leave_too_few_for_good_are_told_of_with_the_tick():
    both = [crash("r1", 9), crash("r2", 5, 3), crash("r3", 7)]
    (line,) = remarks("ticks_max=20", events=both)
    assert line.startswith("events: from tick 9 on")
    assert remarks("ticks_max=20", events=both[:2]) == []
    assert remarks("ticks_max=8", events=both) == []
    # Who comes back when the run is over does not come back.
    (line,) = remarks("ticks_max=20", events=[crash("r1", 9, 30), crash("r3", 7)])
    assert line.startswith("events: from tick 9 on")


@pytest.mark.parametrize(
    ("delay", "asked", "comes"),
    [
        ("mean_s=0.05", "0.05 s on average (constant)", "0.1 s"),
        ("model='exponential', mean_s=0.05", "0.05 s on average (exponential)", "0.116 s"),
        ("model='uniform', low_s=0.0, high_s=0.04", "0.02 s on average (uniform)", "0.1 s"),
        (
            "model='trace', values=[0.01, 0.12, 0.01, 0.01]",
            "0.0375 s on average (trace)",
            "0.125 s",
        ),
    ],
)
def test_a_delay_of_at_most_half_a_tick_is_told_what_will_come_of_it(delay, asked, comes):
    (line,) = remarks(f"channel.delay={{{delay}}}")
    assert line.startswith(f"channel.delay: {asked} is at most half a tick")
    assert f"the mean delay will be about {comes} (" in line
    assert remarks(f"channel.delay={{{delay}}}", "tick_s=0.02") == []


def test_only_delays_that_are_asked_for_and_meet_some_link_are_told_of():
    assert remarks() == remarks("channel.delay.mean_s=0.0") == []
    assert remarks("channel.delay.mean_s=0.051") == []
    assert remarks("channel.delay.mean_s=0.04", team={"positions": [[3.0, 0.0]]})[1:] == []
    links = "channel.links=[{sender='r2', delay={mean_s=0.01}}]"
    (line,) = remarks("channel.delay.mean_s=0.3", links)
    assert line.startswith("channel.links.0.delay: 0.01 s on average (constant)")


def test_the_python_api_warns_before_the_run():
    with pytest.warns(encircle.ScenarioRemark, match=NEVER) as caught:
        encircle.run({**SMALL, "team": {"robots": 2}}, link="memory")
    assert [Path(w.filename).name for w in caught] == [Path(__file__).name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        encircle.run(SMALL, link="memory")


STUDY = {"name": "few", "scenario": SMALL, "seeds": 1, "measures": ["captured"]}
ROBOTS = {"name": "robots", "key": "team.robots", "values": [2, 3, 4]}
COUNT = {"name": "count", "key": "capture.count", "values": [4, 5, 6]}
WIDE = {"capture.stop_distance_m": 1.1}
LOSS = {"name": "loss", "key": "channel.loss.rate", "values": [0.0, 0.5]}


def study(axes, **changes):
    return load_plan({**STUDY, "axes": axes, "set": {"channel.loss.model": "bernoulli", **changes}})


def test_a_study_tells_each_remark_once_and_names_its_cells():
    assert study([LOSS]).remarks() == []
    (line,) = study([ROBOTS, LOSS]).remarks()
    assert line.endswith("(at robots = 2)")
    (line,) = study([LOSS], **{"team.robots": 1}).remarks()
    assert line.endswith("(in every cell)")
    (line,) = study([{**ROBOTS, "values": [6, 8, 5]}], **{"capture.count": 5, **WIDE}).remarks()
    assert line.endswith("(in every cell)")
    (line,) = study([LOSS, COUNT], **{"team.robots": 8}).remarks()
    assert line.endswith("(at count = 6)")


def test_cells_that_are_no_block_are_named_one_by_one_and_many_of_them_counted():
    two, as_it_is = {"name": "two", "set": {"team.robots": 2}}, {"name": "same", "set": {}}
    first = {**ROBOTS, "values": [2, 4]}
    (line,) = study([first, {"name": "arm", "arms": [two, as_it_is]}]).remarks()
    assert line.endswith(
        "(at robots = 2.0, arm = two; robots = 2.0, arm = same; robots = 4.0, arm = two)"
    )
    many = [two, *[{**as_it_is, "name": f"same{k}"} for k in range(5)]]
    (line,) = study([first, {"name": "arm", "arms": many}]).remarks()
    assert line.endswith("arm = same2; and 3 more cells)")


def test_the_python_api_of_studies_warns(tmp_path):
    with pytest.warns(encircle.ScenarioRemark, match="in every cell"):
        encircle.study({**STUDY, "set": {"team.robots": 2}}, tmp_path / "s").run(workers=1)


def said(folder, *arguments):
    done = run_forked(ours(*arguments), folder)
    lines = [line for line in done.stderr.splitlines() if NEVER in line]
    return done, lines


TWO = ("--set", "team.robots=2", "--set", "ticks_max=3")


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_run_tells_on_standard_error_once_and_before_anything_else(tmp_path, link):
    (tmp_path / "s.toml").write_text("ticks_max = 3\n[team]\nrobots = 2\n", encoding="utf-8")
    done, lines = said(tmp_path, "encircle", "run", "s.toml", "--link", link, "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["robots"] == 2
    assert lines == done.stderr.splitlines()[:1]
    assert lines[0].startswith("encircle: team.robots = 2: ")


def test_study_tells_on_standard_error_once(tmp_path):
    plan = "seeds = 1\nscenario.ticks_max = 3\nscenario.team.robots = 2\n"
    (tmp_path / "s.toml").write_text(plan, encoding="utf-8")
    done, lines = said(tmp_path, "encircle", "study", "s.toml", "--json")
    assert json.loads(done.stdout)["runs"] == 1
    assert lines == done.stderr.splitlines()[:1]


def test_a_world_started_by_hand_tells_on_standard_error(tmp_path):
    (tmp_path / "s.toml").write_text("ticks_max = 3\n[team]\nrobots = 2\n", encoding="utf-8")
    place = ("--listen", "tcp/127.0.0.1:0", "--run", "few", "--join-timeout", "0.1")
    done, lines = said(tmp_path, "world", "s.toml", *place)
    assert NEVER not in done.stdout
    assert [line.split(":")[0] for line in lines] == ["world"]
    assert done.returncode == 1


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["channel.delay.mean_s=300"], "channel.delay: 300 s on average (constant) is as long as"),
        (["channel.delay.mean_s=60"], "(60 s: ticks_max = 600 ticks of 0.1 s): hardly a packet"),
        (["channel.delay.mean_s=5.1"], "more than robot.peer_age_ticks_max = 50 ticks of 0.1 s"),
        (["channel.delay.mean_s=5.0"], ""),
        (["channel.delay.mean_s=5.1", "robot.peer_age_ticks_max=51"], ""),
        (["channel.delay.mean_s=0.3"], ""),
        (['channel.delay={model="uniform", low_s=0.0, high_s=130.0}'], "65 s on average (uniform)"),
    ],
)
def test_a_delay_that_is_longer_than_the_run_or_than_robots_remember_is_questioned(changes, said):
    found = remarks("ticks_max=600", *changes)
    assert len(found) == bool(said)
    assert said in "".join(found)


def test_what_the_remark_says_of_late_packets_is_so():
    """At a delay just above the limit nobody plans with anybody, just below it all do."""
    teams = {}
    for mean_s in (0.5, 0.6):
        changes = [f"channel.delay.mean_s={mean_s}", "robot.peer_age_ticks_max=5"]
        far = [[40.0, 0.0], [-40.0, 0.0], [0.0, 40.0]]
        scenario = load({"ticks_max": 12, "team": {"positions": far}}, changes)
        collected = RunLogCollector()
        run_in_memory(build(scenario, 1), "aged", print, observer=collected)
        teams[mean_s] = collected.teams[-1]
        assert bool(remarks_on(scenario)) == (mean_s > 0.5)
    assert teams == {0.5: [3, 3, 3], 0.6: [1, 1, 1]}


class RunLogCollector:
    """With how many robots each robot plans, by tick."""

    def __init__(self):
        self.teams = []

    def decided(self, world, robots, answers):
        self.teams.append([len(answer.command.team) for answer in answers])

    def ended(self, world):
        pass


@pytest.mark.parametrize(
    ("access", "packet_s", "told"),
    [
        ("aloha", 0.01, False),  # G = 0.3: exp(-0.6) = 55 % pass
        ("aloha", 0.02, True),
        ("slotted-aloha", 0.02, False),  # exp(-0.6) again
        ("slotted-aloha", 0.04, True),
    ],
)
def test_contention_that_loses_most_of_a_teams_packets_is_told_of(access, packet_s, told):
    lines = remarks(f"channel.contention={{access='{access}', packet_s={packet_s}}}")
    assert len(lines) == told
    if told:
        assert lines[0].startswith(f"channel.contention.packet_s = {packet_s:g}: when all 4")
        # G = 3 x packet / tick.
        assert "30.1%" in lines[0]
        assert access in lines[0]
