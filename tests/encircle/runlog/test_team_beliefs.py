"""Believed positions of a whole run against what one robot at one tick plans with, to the bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from encircle.agents.teamwork.peers import planning_team
from encircle.protocol.parameters import Parameters
from encircle.runlog import team_beliefs
from encircle.runlog.team_beliefs import believed_positions

numbers = st.floats(-1e6, 1e6)


@st.composite
def beliefs(draw):
    """Peer tables, own positions, size of the team; some robots are lost, some peers unknown."""
    count, ticks = draw(st.integers(1, 4)), draw(st.integers(0, 6))
    peers = st.none() | st.tuples(st.integers(0, ticks), numbers, numbers, numbers, numbers)
    tables, positions = [], []
    for _ in range(ticks * count):
        is_lost = draw(st.booleans()) and draw(st.booleans())
        tables.append(None if is_lost else tuple(draw(peers) for _ in range(count)))
        positions.append(None if is_lost else (draw(numbers), draw(numbers)))
    return tables, positions, count


def one_by_one(tables, positions, count, parameters):
    believed = np.full((len(tables) // count, count, count, 2), np.nan)
    for row, (table, position) in enumerate(zip(tables, positions, strict=True)):
        tick, own = divmod(row, count)
        if table is not None:
            team = planning_team(table, own, position, tick, parameters)
            believed[tick, own, list(team.members)] = team.positions
    return believed


@pytest.mark.parametrize("values_max", [1, team_beliefs.VALUES_MAX])
@given(
    case=beliefs(),
    policy=st.sampled_from(["hold", "extrapolate"]),
    age=st.integers(1, 5),
    trusted=st.integers(0, 5),
)
def test_a_whole_run_at_once_is_as_one_robot_at_a_time(values_max, case, policy, age, trusted):
    parameters = Parameters.from_mapping(
        {"peer_policy": policy, "peer_age_ticks_max": age, "extrapolate_ticks_max": trusted}
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(team_beliefs, "VALUES_MAX", values_max)
        at_once = believed_positions(*case, parameters)
    singly = one_by_one(*case, parameters)
    np.testing.assert_array_equal(at_once, singly)
    there = ~np.isnan(singly)
    np.testing.assert_array_equal(np.signbit(at_once[there]), np.signbit(singly[there]))
