"""Messages are values; lengths are whole multiples of the quantum."""

from dataclasses import FrozenInstanceError
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.messages import QUANTUM_M, End, Setup, quantise_m

CHEAP = settings(max_examples=200, deadline=None, derandomize=True)
lengths = st.floats(-1e6, 1e6)


@CHEAP
@given(lengths)
def test_a_quantised_length_is_the_nearest_multiple_of_the_quantum(length):
    exact = Fraction(length) * 2**20
    nearest = Fraction(round(exact), 2**20)
    assert Fraction(quantise_m(length)) == nearest
    assert abs(quantise_m(length) - length) <= QUANTUM_M / 2


@CHEAP
@given(lengths)
def test_quantising_twice_changes_nothing(length):
    once = quantise_m(length)
    assert quantise_m(once) == once


@CHEAP
@given(lengths, lengths)
def test_quantising_keeps_order_and_sign(a, b):
    low, high = sorted((a, b))
    assert quantise_m(low) <= quantise_m(high)
    assert quantise_m(-a) == -quantise_m(a)


@pytest.mark.parametrize(("quanta", "expected"), [(0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0)])
def test_ties_go_to_the_even_multiple(quanta, expected):
    assert quantise_m(quanta * 2.0**-20) == expected * 2.0**-20


@CHEAP
@given(st.integers(-(2**40), 2**40), st.floats(-0.49, 0.49))
def test_noise_below_half_a_quantum_does_not_matter(quanta, noise):
    assert quantise_m((quanta + noise) * QUANTUM_M) == quanta * QUANTUM_M


def test_the_quantum_is_a_power_of_two_near_a_micron():
    assert Fraction(QUANTUM_M) == Fraction(1, 2**20)


def test_messages_cannot_be_changed_and_have_no_other_attributes():
    end = End("r1", 3, "ticks")
    with pytest.raises(FrozenInstanceError):
        end.tick = 4
    assert not hasattr(end, "__dict__")


def test_default_maps_are_not_shared():
    first, second = (Setup(robot, ("r1", "r2"), 0.1, "xi-star") for robot in ("r1", "r2"))
    assert first.parameters == {}
    assert first.parameters is not second.parameters
