"""The lock-step table against a model that knows only who still owes a pose or a command.

The model of a robot is the set of answers it owes, None if it is not of the run now; it shares no
phase names with the code. A command alone settles both, so it is legal where both are owed.
"""

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from encircle.protocol.errors import OutOfTurn
from encircle.protocol.lockstep import TABLE, LockStep, Move, Phase

PATHS = {
    Phase.ABSENT: (),
    Phase.IDLE: (Move.JOIN,),
    Phase.ASKED: (Move.JOIN, Move.ASK),
    Phase.POSED: (Move.JOIN, Move.ASK, Move.POSE),
    Phase.COMMANDED: (Move.JOIN, Move.ASK, Move.COMMAND),
    Phase.LEFT: (Move.JOIN, Move.LEAVE),
}
LEGAL = {
    "absent": {"join": "idle"},
    "idle": {"ask": "asked", "leave": "left"},
    "asked": {
        "pose": "posed",
        "command": "commanded",
        "command alone": "idle",
        "leave": "left",
    },
    "posed": {"command": "idle", "leave": "left"},
    "commanded": {"pose": "idle", "leave": "left"},
    "left": {"join": "idle"},
}


def table_in(phase):
    table = LockStep(["r1", "r2"])
    for move in PATHS[phase]:
        table.move("r1", move)
    assert table.in_phase(phase) == (("r1", "r2") if phase is Phase.ABSENT else ("r1",))
    return table


@pytest.mark.parametrize("move", Move, ids=lambda move: move.value)
@pytest.mark.parametrize("phase", Phase, ids=lambda phase: phase.value)
def test_every_move_in_every_phase_is_as_the_table_says(phase, move):
    table = table_in(phase)
    after = LEGAL[phase.value].get(move.value)
    if after is not None:
        assert table.move("r1", move) is Phase(after)
        assert "r1" in table.in_phase(Phase(after))
        return
    with pytest.raises(OutOfTurn, match=f"{move.value} of r1 .*{phase.value}"):
        table.move("r1", move)
    assert "r1" in table.in_phase(phase), "a refused move changes nothing"


def test_the_published_table_is_the_one_above():
    published = {(phase.value, move.value): after.value for (phase, move), after in TABLE.items()}
    assert published == {
        (phase, move): after for phase, moves in LEGAL.items() for move, after in moves.items()
    }


def test_an_unknown_robot_is_out_of_turn_and_the_team_is_named():
    with pytest.raises(OutOfTurn, match=r"'r9'.*r1, r2"):
        LockStep(["r1", "r2"]).move("r9", Move.JOIN)


@pytest.mark.parametrize("tick", [-1, 0, 4, 6])
def test_an_answer_for_another_tick_is_out_of_turn_and_changes_nothing(tick):
    table = LockStep(["r1"])
    table.move("r1", Move.JOIN)
    table.ask_all(5)
    with pytest.raises(OutOfTurn, match=f"tick {tick}, this is tick 5"):
        table.move("r1", Move.POSE, tick)
    assert table.in_phase(Phase.ASKED) == ("r1",)
    assert table.move("r1", Move.POSE, 5) is Phase.POSED


def test_a_round_of_commands_alone_is_complete_and_takes_no_poses_after():
    table = LockStep(["r1", "r2"])
    for robot in ("r1", "r2"):
        table.move(robot, Move.JOIN)
    table.ask_all(0)
    table.move("r2", Move.COMMAND_ALONE, 0)
    assert table.waiting() == ("r1",)
    table.move("r1", Move.POSE, 0)
    with pytest.raises(OutOfTurn, match="command alone of r1 at tick 0: it is posed"):
        table.move("r1", Move.COMMAND_ALONE, 0)
    table.move("r1", Move.COMMAND, 0)
    assert table.complete
    with pytest.raises(OutOfTurn, match="pose of r2 at tick 0: it is idle"):
        table.move("r2", Move.POSE, 0)
    assert table.ask_all(1) == ("r1", "r2")


def test_asking_before_everyone_answered_is_our_own_mistake():
    table = LockStep(["r1"])
    table.move("r1", Move.JOIN)
    table.ask_all(0)
    with pytest.raises(AssertionError, match="r1"):
        table.ask_all(1)


def test_robots_are_listed_in_robot_order_whatever_the_order_of_joining():
    table = LockStep(["r2", "r10", "r1"])
    for robot in ("r1", "r2", "r10"):
        table.move(robot, Move.JOIN)
    assert table.ask_all(0) == table.waiting() == ("r2", "r10", "r1")


class AgainstTheModel(RuleBasedStateMachine):
    """Random moves on the table and on a model: who owes which answers."""

    robots = ("r1", "r2", "r3")

    def __init__(self):
        super().__init__()
        self.table = LockStep(self.robots)
        self.tick = -1
        self.absent = set(self.robots)
        self.owed = {}

    def expect(self, legal, robot, move, tick=None):
        if legal:
            self.table.move(robot, move, tick)
        else:
            with pytest.raises(OutOfTurn):
                self.table.move(robot, move, tick)
        return legal

    @rule(robot=st.sampled_from((*robots, "r9")))
    def join(self, robot):
        if self.expect(robot in self.absent, robot, Move.JOIN):
            self.absent.remove(robot)
            self.owed[robot] = set()

    @rule(
        robot=st.sampled_from((*robots, "r9")),
        move=st.sampled_from((Move.POSE, Move.COMMAND)),
        late=st.sampled_from((0, 0, 0, 1, -1)),
    )
    def answer(self, robot, move, late):
        legal = late == 0 and move in self.owed.get(robot, ())
        if self.expect(legal, robot, move, self.tick + late):
            self.owed[robot].remove(move)

    @rule(robot=st.sampled_from((*robots, "r9")), late=st.sampled_from((0, 0, 0, 1, -1)))
    def answer_with_a_command_alone(self, robot, late):
        owed = self.owed.get(robot)
        legal = late == 0 and owed == {Move.POSE, Move.COMMAND}
        if self.expect(legal, robot, Move.COMMAND_ALONE, self.tick + late):
            owed.clear()

    @rule(robot=st.sampled_from((*robots, "r9")))
    def leave(self, robot):
        if self.expect(robot in self.owed, robot, Move.LEAVE):
            del self.owed[robot]
            self.absent.add(robot)

    @precondition(lambda self: not any(self.owed.values()))
    @rule()
    def ask(self):
        self.tick += 1
        asked = self.table.ask_all(self.tick)
        assert asked == tuple(robot for robot in self.robots if robot in self.owed)
        for robot in asked:
            self.owed[robot] = {Move.POSE, Move.COMMAND}

    @invariant()
    def the_round_is_complete_when_nobody_owes_anything(self):
        waiting = tuple(robot for robot in self.robots if self.owed.get(robot))
        assert self.table.waiting() == waiting
        assert self.table.complete == (not waiting)
        assert self.table.tick == self.tick


TestAgainstTheModel = AgainstTheModel.TestCase
TestAgainstTheModel.settings = settings(
    max_examples=60, stateful_step_count=40, deadline=None, derandomize=True
)
