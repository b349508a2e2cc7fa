"""Parameters: the paper's values by default; nonsense is refused by name, all at once."""

from dataclasses import fields
from math import inf, nan, pi

import pytest

from encircle.protocol.parameters import Parameters

NUMBERS = [f.name for f in fields(Parameters) if type(f.default) in (int, float)]
WHOLE = [f.name for f in fields(Parameters) if type(f.default) is int]
CHOSEN = [f.name for f in fields(Parameters) if type(f.default) is str]


def problems_of(values):
    with pytest.raises(ValueError, match=r".+") as caught:
        Parameters.from_mapping(values)
    return str(caught.value)


def test_defaults_are_the_papers_where_it_gives_a_value():
    p = Parameters()
    assert (p.radius_m, p.sensing_range_m, p.step_m_max) == (0.5, 6.0, 0.3)
    assert (p.ring_radius_m, p.near_factor, p.deviation_gain) == (4.0, 1.5, 2.0)
    assert (p.stop_distance_m, p.xi_weight) == (1.3, 0.05)
    assert p.xi_grid == (0, 1, 2, 3, 4, 5, 6)


def test_the_stop_distance_is_both_radii_and_a_step():
    p = Parameters()
    assert p.stop_distance_m == pytest.approx(p.radius_m + p.target_radius_m + p.step_m_max)


def test_by_default_nothing_is_done_against_bad_communication_but_what_always_was():
    p = Parameters()
    assert (p.publish, p.publish_every_ticks, p.detections) == ("always", 1, "own")
    assert (p.late_detections, p.peer_policy, p.switch_gain_m) == ("refilter", "extrapolate", 0.0)
    assert p.extrapolate_ticks_max >= 100_000, "as long as a peer may be old"


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("publish_every_ticks", 1, 100_000),
        ("publish_error_m", 0.0, 1e4),
        ("publish_age_ticks_max", 1, 100_000),
        ("relay_age_ticks_max", 1, 500),
        ("extrapolate_ticks_max", 0, 100_000),
        ("switch_gain_m", 0.0, 1e4),
    ],
)
def test_the_answers_to_bad_communication_have_ranges(name, low, high):
    for value in (low, high):
        assert getattr(Parameters.from_mapping({name: value}), name) == value
    for value in (low - 1, high + 1):
        message = problems_of({name: value})
        assert f"{name} = " in message
        assert f"from {low:g} to {high:g}" in message


@pytest.mark.parametrize(
    ("name", "choices"),
    [
        ("publish", ("always", "event")),
        ("detections", ("own", "relay", "fuse", "fuse-naive")),
        ("late_detections", ("refilter", "ignore")),
    ],
)
def test_the_answers_to_bad_communication_have_choices(name, choices):
    for choice in choices:
        assert getattr(Parameters.from_mapping({name: choice}), name) == choice
    message = problems_of({name: "sometimes"})
    assert "'sometimes'" in message
    for choice in choices:
        assert choice in message


@pytest.mark.parametrize("way", ["fuse", "fuse-naive"])
def test_who_tells_estimates_cannot_publish_on_events(way):
    message = problems_of({"detections": way, "publish": "event"})
    assert "publish = 'event': must be always" in message
    assert f"detections = {way!r}" in message
    assert Parameters.from_mapping({"detections": way}).detections == way


def test_defaults_have_no_problems_and_an_empty_mapping_gives_them():
    assert Parameters().problems() == []
    assert Parameters.from_mapping({}) == Parameters()


def test_values_are_replaced_and_given_the_type_of_the_default():
    p = Parameters.from_mapping(
        {"ring_radius_m": 5, "window_ticks": 40.0, "search": "hold", "xi_grid": [0, 2]}
    )
    assert (p.ring_radius_m, p.window_ticks, p.search, p.xi_grid) == (5.0, 40, "hold", (0.0, 2.0))
    assert type(p.ring_radius_m) is float
    assert type(p.window_ticks) is int
    assert [type(xi) for xi in p.xi_grid] == [float, float]


def test_every_problem_is_named_at_once():
    message = problems_of({"colour": 1, "size": 2, "ring_radius_m": "wide", "window_ticks": 1.5})
    for name in ("colour", "size", "ring_radius_m", "wide", "window_ticks", "1.5"):
        assert name in message


def test_every_value_out_of_range_is_named_at_once_with_the_range():
    message = problems_of({"ring_radius_m": -1.0, "enclosure_rad": 7.0, "search": "dance"})
    for text in ("ring_radius_m = -1.0", "enclosure_rad = 7.0", "search = 'dance'", "spiral"):
        assert text in message


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", ["1", None, True, [1.0], {}, b"1"], ids=repr)
def test_what_is_not_a_number_is_refused_by_name(name, value):
    assert name in problems_of({name: value})


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [nan, inf, -inf, 1e300, -1e300])
def test_what_is_not_a_sensible_number_is_refused_by_name(name, value):
    assert name in problems_of({name: value})


@pytest.mark.parametrize("name", ["ring_radius_m", "window_ticks"])
def test_a_whole_number_beyond_any_float_is_refused_by_name(name):
    # TOML allows it.
    assert name in problems_of({name: 10**400})


@pytest.mark.parametrize("name", WHOLE)
def test_a_broken_number_is_refused_where_a_whole_one_is_wanted(name):
    assert name in problems_of({name: 2.5})


@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.parametrize("value", ["", "other", None, 1, ["hold"]], ids=repr)
def test_what_is_not_one_of_the_choices_is_refused_by_name(name, value):
    assert name in problems_of({name: value})


@pytest.mark.parametrize(
    "grid",
    [
        [],
        [-1.0],
        [1.0, 0.0],
        [0.0, 0.0],
        list(range(65)),
        [nan],
        [0.0, nan],
        [inf],
        [0.0, inf],
        ["a"],
        [None],
        1.0,
        None,
        "012",
        b"\x00\x01",
        {0.0: 1.0},
        [[0.0]],
    ],
    ids=lambda grid: repr(grid)[:20],
)
def test_a_grid_that_is_not_ascending_finite_steps_is_refused_by_name(grid):
    assert "xi_grid" in problems_of({"xi_grid": grid})


def test_grids_of_one_step_and_of_64_are_taken():
    assert Parameters.from_mapping({"xi_grid": [3]}).xi_grid == (3.0,)
    assert len(Parameters.from_mapping({"xi_grid": range(64)}).xi_grid) == 64


def test_the_splines_samples_must_fit_into_the_window():
    fits = {"spline_samples": 4, "spline_spacing_ticks": 3, "window_ticks": 10}
    assert Parameters.from_mapping(fits).window_ticks == 10
    message = problems_of({**fits, "window_ticks": 9})
    assert "spline_samples = 4" in message
    assert "window_ticks = 9" in message


@pytest.mark.parametrize("value", [0.0, pi, 2 * pi])
def test_the_ends_of_a_range_belong_to_it(value):
    assert Parameters.from_mapping({"enclosure_rad": value}).enclosure_rad == value
