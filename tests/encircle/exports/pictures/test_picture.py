"""Pictures of scenes made by hand: what is drawn where, by the colours of pixels."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_made_scenes import made_frame, made_stage, standing_scene

from encircle.exports.pictures.arena import LANE_PX, common_circle
from encircle.exports.pictures.layout import layout_of
from encircle.exports.pictures.picture import Picture, PictureStyle
from encircle.scene.builder import Scene
from encircle.scene.frame import Belief, Event, PeerBelief
from encircle.scene.palette import DARK, ROBOTS

SIZE = (1280, 720)
ARENA = layout_of(*SIZE).arena
UNIT = layout_of(*SIZE).unit


def picture_of(scene, ticks, **style):
    return Picture(scene, PictureStyle(SIZE, theme="dark", **style)).at(ticks)


def places_of(pixels, colour):
    """(M, 2) x and y of the arena's pixels that have a colour exactly."""
    rgb = tuple(bytes.fromhex(colour[1:]))
    left, top, right, bottom = (round(edge) for edge in ARENA)
    part = pixels[top:bottom, left:right]
    rows, columns = np.nonzero((part == rgb).all(axis=2))
    return np.column_stack([columns + left + 0.5, rows + top + 0.5])


def centre_of(pixels, colour):
    return places_of(pixels, colour).mean(axis=0)


def test_a_packet_half_way_is_between_its_robots_on_its_own_lane():
    """The robots' discs say where they are; eastwards, the lane on the right is below."""
    scene = standing_scene({2: [(0, 1, 3, 0)]}, 5)
    pixels = picture_of(scene, 2.5)
    middle = (centre_of(pixels, ROBOTS[0]) + centre_of(pixels, ROBOTS[1])) / 2.0
    at = centre_of(pixels, DARK["arrived"])
    # A robot's nose, which points east, moves the centre of its colour a little.
    np.testing.assert_allclose(at - middle, (0.0, LANE_PX * UNIT), atol=4.0)


def test_a_packet_moves_from_rim_to_rim():
    scene = standing_scene({0: [(0, 1, 1, 0)]}, 5)
    at = [centre_of(picture_of(scene, t), DARK["arrived"])[0] for t in (0.1, 0.5, 0.9)]
    assert at[0] < at[1] < at[2]
    assert at[1] == pytest.approx((at[0] + at[2]) / 2.0, abs=1.0)


def test_a_lost_packet_ends_in_a_cross_that_is_gone_later():
    scene = standing_scene({0: [(0, 1, -1, 0)]}, 9)
    drawn = {t: len(places_of(picture_of(scene, t), DARK["chance"])) for t in (0.2, 0.5, 8.0)}
    assert drawn[0.2] > 0
    assert drawn[0.5] > 0
    assert drawn[8.0] == 0


def test_fates_differ_in_the_picture():
    packets = {"arrived": (0, 1, 1, 0), "late": (0, 1, 2, 0), "chance": (0, 1, -1, 0)}
    for role, packet in packets.items():
        pixels = picture_of(standing_scene({0: [packet]}, 3), 0.3)
        found = {r for r in packets if len(places_of(pixels, DARK[r]))}
        # The fourth robot's orange is that of late packets; here are two robots.
        assert found == {role}


def test_packets_can_be_left_out():
    scene = standing_scene({0: [(0, 1, 1, 0)]}, 3)
    assert len(places_of(picture_of(scene, 0.5, packets=False), DARK["arrived"])) == 0


def test_equal_moments_give_equal_pixels_and_others_do_not():
    scene = standing_scene({0: [(0, 1, 1, 0)]}, 3)
    one = picture_of(scene, 0.5)
    np.testing.assert_array_equal(one, picture_of(scene, 0.5))
    assert (one != picture_of(scene, 0.7)).any()


def test_after_the_end_stands_the_end():
    scene = standing_scene({}, 3)
    np.testing.assert_array_equal(picture_of(scene, 3.0), picture_of(scene, 99.0))


@pytest.fixture
def believing():
    """Robot r2, in the east, takes r1 to be 4 m north of where it is."""
    robots, target = ((0.0, 0.0), (12.0, 0.0)), (6.0, 5.0)
    belief = Belief(
        (12.0, 0.0), (PeerBelief(0, 0.0, 4.0, 0, True),), (6.0, 5.0, 0, 0), (0.04, 0, 0), ()
    )
    frames = [
        made_frame(t, robots, target, [(0, 1, t + 1, 0), (1, 0, -1, 0)], beliefs=(None, belief))
        for t in range(4)
    ]
    return Scene(made_stage(), tuple(frames), True)


def test_a_belief_shows_the_peer_where_it_is_taken_to_be(believing):
    """r1's ghost is filled, the truth only pale: full colour is at the believed place alone."""
    truth, belief = picture_of(believing, 0.0), picture_of(believing, 0.0, believer=1)
    really, ghost = centre_of(truth, ROBOTS[0]), centre_of(belief, ROBOTS[0])
    scale = (centre_of(truth, ROBOTS[1])[0] - really[0]) / 12.0
    assert really[1] - ghost[1] == pytest.approx(4.0 * scale, abs=4.0)
    assert ghost[0] == pytest.approx(really[0], abs=4.0)


def test_a_belief_shows_what_its_robot_is_sent_and_no_more(believing):
    belief = picture_of(believing, 0.4, believer=1)
    assert len(places_of(belief, DARK["arrived"])) > 0
    assert len(places_of(belief, DARK["chance"])) == 0


def test_of_an_unknown_belief_the_truth_is_shown_and_a_line_says_so(believing):
    truth, unknown = picture_of(believing, 0.0), picture_of(believing, 0.0, believer=0)
    np.testing.assert_allclose(centre_of(truth, ROBOTS[0]), centre_of(unknown, ROBOTS[0]), atol=5.0)
    assert (truth != unknown).any()


def test_a_target_moved_by_hand_jumps():
    places = [(6.0, 5.0), (6.0, 9.0)]
    for kind, share in (("moved", 0.0), ("contact", 0.5)):
        frames = [
            made_frame(t, ((0.0, 0.0), (12.0, 0.0)), places[t], events=(Event(kind, "", ()),) * t)
            for t in range(2)
        ]
        scene = Scene(made_stage(), tuple(frames), True)
        picture = Picture(scene, PictureStyle(SIZE, theme="dark"))
        start, between = (centre_of(picture.at(t), DARK["target"])[1] for t in (0.0, 0.5))
        end = centre_of(picture.at(1.0), DARK["target"])[1]
        assert start - between == pytest.approx(share * (start - end), abs=6.0)


def test_capture_lost_and_silent_robots_change_the_picture():
    robots, target = ((0.0, 0.0), (12.0, 0.0)), (6.0, 5.0)
    plain = made_frame(0, robots, target)
    pictures = [
        picture_of(Scene(made_stage(), (replace(plain, **changes),), True), 0.0)
        for changes in (
            {},
            {"captured": True},
            {"lost": (True, False)},
            {"silent": (True, False)},
            {"goals": ((3.0, 3.0), None)},
            {"modes": ("shrink", "search")},
        )
    ]
    assert all((picture != pictures[0]).any() for picture in pictures[1:])


def test_a_team_too_large_for_a_list_of_robots_is_drawn():
    robots = tuple((3.0 * (k % 4), 3.0 * (k // 4)) for k in range(16))
    packets = {0: [(j, k, 1, 0) for j in range(16) for k in range(16) if j != k]}
    scene = standing_scene(packets, 2, robots, (20.0, 5.0))
    assert len(places_of(picture_of(scene, 0.5), DARK["arrived"])) > 240


def test_the_common_circle_of_goals_is_that_on_which_they_were_put():
    angles = np.array([0.3, 1.9, 3.5, 5.0])
    goals = np.column_stack([4.0 + 2.5 * np.cos(angles), -3.0 + 2.5 * np.sin(angles)])
    centre, radius_m = common_circle([tuple(goal) for goal in goals.tolist()])
    assert centre == pytest.approx((4.0, -3.0))
    assert radius_m == pytest.approx(2.5)


@pytest.mark.parametrize(
    "goals",
    [
        [],
        [(0.0, 0.0), (1.0, 0.0)],
        [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)],
        [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (3.0, 2.0)],
    ],
)
def test_goals_on_no_common_circle(goals):
    assert common_circle(goals) is None
