"""What is pale behind a belief is still to be seen, on a light ground and on a dark one."""

import numpy as np
import pytest
from helpers_contrast import contrast
from helpers_scene import hunted

from encircle.exports.pictures.arena import ArenaPainter
from encircle.exports.pictures.picture import Picture, PictureStyle
from encircle.scene.builder import scene_of_recording
from encircle.scene.palette import ROBOTS, THEMES
from encircle.world.loading.load import load

SIZE = (1280, 720)
CONTRAST_MIN = {"light": 1.3, "dark": 1.7}
"""Of a trail; on white, orange and sky blue have no more than 2.3 even where they are not pale."""


@pytest.fixture(scope="module")
def scene():
    return scene_of_recording(hunted(load({"team": {"robots": 6}, "ticks_max": 12}))[0])


def strongest(pixels, ground, colour):
    """Of pixels (M, 3) the one that has most of a colour, among those between it and the ground."""
    low, high = (np.array([*bytes.fromhex(c[1:])], float) for c in (ground, colour))
    way = high - low
    shares = (pixels - low) @ way / (way @ way)
    off = np.abs(pixels - low - shares[:, None] * way).max(axis=1)
    between = pixels[off < 4.0]
    red, green, blue = between[shares[off < 4.0].argmax()]
    return f"#{red:02X}{green:02X}{blue:02X}"


def drawn_by(monkeypatch, name, draw, ground):
    """(M, 3) the pixels in which a part of the arena stands on the bare ground."""
    whole = draw()
    with monkeypatch.context() as patch:
        patch.setattr(ArenaPainter, name, lambda *_: None)
        without = draw()
    is_bare = (without == (*bytes.fromhex(ground[1:]),)).all(axis=2)
    return whole[is_bare & (whole != without).any(axis=2)]


@pytest.mark.parametrize("theme", THEMES)
def test_trails_behind_a_belief_stand_out(theme, scene, monkeypatch):
    ground = THEMES[theme]["background"]
    picture = Picture(scene, PictureStyle(SIZE, theme, believer=1))
    pixels = drawn_by(monkeypatch, "trails", lambda: picture.at(12.0), ground)
    for colour in (*ROBOTS, THEMES[theme]["target"]):
        shown = strongest(pixels, ground, colour)
        assert contrast(shown, ground) >= CONTRAST_MIN[theme], (colour, shown)


@pytest.mark.parametrize("theme", THEMES)
def test_what_is_pale_is_paler_than_what_is_believed(theme, scene, monkeypatch):
    ground = THEMES[theme]["background"]
    for believer, most in ((None, 1.0), (1, 0.8)):
        picture = Picture(scene, PictureStyle(SIZE, theme, believer=believer))
        pixels = drawn_by(monkeypatch, "trails", lambda p=picture: p.at(12.0), ground)
        for colour in ROBOTS:
            shown = contrast(strongest(pixels, ground, colour), ground)
            assert shown <= most * contrast(colour, ground)
