"""The palette: every cause of loss has a look of its own, and all can be told from the ground."""

from helpers_contrast import contrast

from encircle.figures.drawing import COLOURS
from encircle.scene.palette import (
    ARRIVED,
    LATE,
    LOST,
    ROBOTS,
    THEMES,
    css_variables,
    robot_colour,
)
from encircle.world.channel.loss_causes import CAUSES


def test_every_cause_of_loss_has_a_style_and_no_two_fates_look_alike():
    assert sorted(LOST) == sorted(CAUSES.values())
    looks = [(style.role, style.shape) for style in (ARRIVED, LATE, *LOST.values())]
    assert len(set(looks)) == len(looks)


def test_both_themes_have_the_same_roles_and_every_style_has_one():
    assert set(THEMES["light"]) == set(THEMES["dark"])
    assert {style.role for style in (ARRIVED, LATE, *LOST.values())} <= set(THEMES["dark"])


def test_what_is_drawn_stands_out_from_the_ground():
    """WCAG 2.2: 4.5 to 1 for text, 3 to 1 for graphics; orange and sky blue have outlines."""
    for colours in THEMES.values():
        for text in ("ink", "muted"):
            for ground in ("background", "panel"):
                assert contrast(colours[text], colours[ground]) >= 4.5
        for role in ("arrived", "chance", "signal", "cut", "crowd", "ring", "target"):
            assert contrast(colours[role], colours["background"]) >= 3.0


def test_robots_have_the_colours_of_the_figures():
    assert ROBOTS == COLOURS
    assert robot_colour(0) == robot_colour(6) == COLOURS[0]


def test_css_names_every_colour():
    assert "--ink: #1B1F24;" in css_variables("light")
    assert "--robot-5: #56B4E9;" in css_variables("dark")
