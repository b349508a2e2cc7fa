"""Public and held-out seeds: fixed, disjoint, and following from version and name alone."""

import hashlib

import pytest

from encircle.benchmark.seeds import (
    HELD_OUT_MIN,
    SEEDS,
    checked_name,
    held_out_seeds,
    public_seeds,
)
from encircle.studies.plan_files import load_plan


def test_the_public_seeds_are_those_of_the_shipped_study():
    assert public_seeds() == load_plan("benchmark").seed_list
    assert len(public_seeds()) == SEEDS == 100
    assert public_seeds(7) == public_seeds()[:7]


def test_held_out_seeds_are_hashes_of_version_and_name():
    text = b"encircle benchmark 1\nJane's auction\n0"
    first = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "big") % 2**63
    assert held_out_seeds(1, "Jane's auction")[0] == first


def test_held_out_seeds_of_one_name_are_always_the_same():
    # Golden: a submission made today must be verified by every later release.
    assert held_out_seeds(1, "Jane's auction", 2) == held_out_seeds(1, "Jane's auction")[:2]
    golden = (7_979_822_455_019_465_499, 6_726_636_577_675_010_386)
    assert held_out_seeds(1, "Jane's auction", 2) == golden


def test_no_seed_is_both_and_none_is_drawn_twice():
    names = [f"name {k}" for k in range(50)]
    drawn = [seed for name in names for seed in held_out_seeds(1, name)]
    assert len(set(drawn)) == len(drawn) == 50 * SEEDS
    assert all(HELD_OUT_MIN <= seed < 2**63 for seed in drawn)
    assert set(drawn).isdisjoint(public_seeds())


def test_another_version_has_other_held_out_seeds():
    assert set(held_out_seeds(1, "x")).isdisjoint(held_out_seeds(2, "x"))


def test_spaces_in_a_name_do_not_draw_other_seeds():
    assert checked_name("  Jane's \t auction\n") == "Jane's auction"


@pytest.mark.parametrize("name", ["", "  ", "x" * 61, "a\x1b[31mb", "a\u202eb"])
def test_a_name_that_cannot_head_a_page_is_refused(name):
    with pytest.raises(ValueError, match="must be 1 to 60 characters"):
        checked_name(name)
