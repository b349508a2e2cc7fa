"""What is drawn covers the pixels that geometry says."""

from math import pi

import numpy as np
import pytest

from encircle.exports.pictures.canvas import Canvas, rgba, shortened, text_width

WHITE, BLACK, RED = "#FFFFFF", "#000000", "#FF0000"


def shares(canvas, channel=1):
    """(height, width) how much of each pixel is covered by something dark in a channel."""
    return 1.0 - canvas.pixels()[:, :, channel] / 255.0


def test_a_disc_has_its_area_and_its_centre():
    canvas = Canvas(200, 100, WHITE)
    canvas.disc((60.0, 40.0), 25.0, fill=BLACK)
    covered = shares(canvas)
    assert covered.sum() == pytest.approx(pi * 25.0**2, rel=0.01)
    rows, columns = np.indices(covered.shape)
    assert (covered * (columns + 0.5)).sum() / covered.sum() == pytest.approx(60.0, abs=0.1)
    assert (covered * (rows + 0.5)).sum() / covered.sum() == pytest.approx(40.0, abs=0.1)


def test_a_line_has_its_length_times_its_width_and_dashes_a_share_of_that():
    for dashes, share in (((), 1.0), ((6.0, 4.0), 0.6)):
        canvas = Canvas(300, 100, WHITE)
        canvas.line([(20.0, 50.0), (270.0, 50.0)], BLACK, 4.0, dashes=dashes)
        assert shares(canvas).sum() == pytest.approx(250.0 * 4.0 * share, rel=0.06)


def test_a_polygon_and_a_rectangle_are_filled():
    canvas = Canvas(100, 100, WHITE)
    canvas.polygon([(10, 10), (50, 10), (10, 90)], fill=BLACK)
    assert shares(canvas).sum() == pytest.approx(40 * 80 / 2, rel=0.01)
    canvas.rectangle((60, 20, 90, 30), fill=RED)
    assert (canvas.pixels()[20:30, 60:90] == (255, 0, 0)).all()


def test_half_a_colour_is_half_way_to_the_ground():
    canvas = Canvas(50, 50, WHITE)
    canvas.rectangle((0, 0, 50, 50), fill=BLACK, alpha=0.5)
    assert canvas.pixels()[25, 25].tolist() == pytest.approx([127.5] * 3, abs=1.0)


def test_nothing_is_drawn_outside_of_the_clip_until_it_is_lifted():
    canvas = Canvas(100, 60, WHITE)
    canvas.clip((10, 10, 50, 50))
    canvas.rectangle((0, 0, 100, 60), fill=BLACK)
    canvas.text("words", (60, 30), 20, BLACK)
    covered = shares(canvas) > 0.5
    assert covered[10:50, 10:50].all()
    assert covered.sum() == 40 * 40
    canvas.clip(None)
    canvas.rectangle((60, 0, 70, 10), fill=BLACK)
    assert (shares(canvas)[0:10, 60:70] == 1.0).all()


@pytest.mark.parametrize(("align", "share"), [("left", 0.5), ("centre", 0.0), ("right", -0.5)])
def test_words_stand_where_they_are_aligned(align, share):
    canvas = Canvas(400, 80, WHITE)
    canvas.text("HHHHHH", (200, 40), 24, BLACK, align)
    rows, columns = np.nonzero(shares(canvas) > 0.5)
    middle = 200 + share * text_width("HHHHHH", 24)
    assert (columns.min() + columns.max() + 1) / 2 == pytest.approx(middle, abs=2.0)
    assert (rows.min() + rows.max() + 1) / 2 == pytest.approx(40.0, abs=1.5)


def test_a_halo_keeps_words_apart_from_lines():
    for halo in (False, True):
        canvas = Canvas(200, 60, WHITE)
        canvas.line([(0, 30), (200, 30)], RED, 3.0)
        canvas.text("I", (100, 30), 30, BLACK, "centre", halo=halo)
        beside = canvas.pixels()[30, 103:108].tolist()
        assert ([255, 0, 0] in beside[:2]) is not halo


def test_a_text_is_shortened_to_a_width():
    text = "a long sentence about what the radio does"
    short = shortened(text, 120.0, 14.0)
    assert short.endswith("...")
    assert text.startswith(short[:-3])
    assert text_width(short, 14.0) <= 120.0
    assert shortened(text, 1000.0, 14.0) == text
    assert shortened(text, 1.0, 14.0) == ""


def test_no_words_are_nothing():
    canvas = Canvas(50, 50, WHITE)
    canvas.text("", (25, 25), 20, BLACK)
    assert shares(canvas).sum() == 0.0
    assert text_width(" ", 20) >= 0.0


def test_colours_as_numbers():
    assert rgba("#FF8000", 0.25) == (1.0, 128 / 255, 0.0, 0.25)
