"""A count in words."""

from encircle.scene.counts import counted


def test_one_is_singular_and_all_else_plural():
    assert [counted(n, "tick") for n in (0, 1, 2, 11)] == [
        "0 ticks",
        "1 tick",
        "2 ticks",
        "11 ticks",
    ]
