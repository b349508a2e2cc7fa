"""Estimates on the wire: what is sound, by numpy's eigenvalues; how numbers are rounded."""

from dataclasses import replace
from fractions import Fraction

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.codec import decode, decode_pose, encode
from encircle.protocol.errors import MalformedMessage
from encircle.protocol.messages import Pose
from encircle.protocol.wire.target_estimate import TargetEstimate, is_sound, rounded_covariance

RUN = "g1"
CHEAP = settings(max_examples=300, deadline=None, derandomize=True)
PLAIN = Pose("r2", 7, 7, (1.0, 2.0), (0.0, -1.5), None, "encircle", 2.0, 1)
ESTIMATE = TargetEstimate(6, 4.0, 0.5, -1.0, 2.0, 0.0025, 0.01, 1.5)
TELLING = replace(PLAIN, estimate=ESTIMATE)
sizes = st.floats(1e-9, 1e8)


@CHEAP
@given(sizes, sizes, st.floats(-1.0, 1.0))
def test_a_rounded_covariance_is_as_good_as_the_same_and_stays_positive_definite(p00, p11, r):
    covariance = (p00, r * (p00 * p11) ** 0.5, p11)
    if not is_sound(covariance):
        return
    rounded = rounded_covariance(covariance)
    assert rounded == pytest.approx(covariance, rel=1e-7)
    assert rounded_covariance(rounded) == rounded
    assert rounded[0] >= p00
    assert rounded[2] >= p11
    assert abs(rounded[1]) <= abs(covariance[1])
    a, b, c = map(Fraction, rounded)
    assert a * c > b * b
    assert is_sound(rounded)
    assert rounded[0] * rounded[2] == a * c, "products are exact"


@CHEAP
@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_sound_is_what_numpy_finds_positive_definite(p00, p01, p11):
    least = np.linalg.eigvalsh(np.array([[p00, p01], [p01, p11]]))[0]
    if abs(least) > 1e-6:
        assert is_sound((p00, p01, p11)) == (least > 0.0)


@pytest.mark.parametrize(
    "covariance",
    [
        (1e-13, 0.0, 1.0),
        (1.0, 0.0, 1e9),
        (1.0, 1.0, 1.0),
        (1.0, 1.0 - 1e-10, 1.0),
        (-1.0, 0.0, -1.0),
        (float("nan"), 0.0, 1.0),
        (1.0, float("nan"), 1.0),
    ],
)
def test_what_loses_all_digits_is_not_sound(covariance):
    assert not is_sound(covariance)


def test_an_estimate_crosses_the_wire_and_a_packet_without_one_has_the_bytes_it_always_had():
    assert decode_pose(encode(TELLING, RUN), RUN) == decode(Pose, encode(TELLING, RUN), RUN)
    back = decode_pose(encode(TELLING, RUN), RUN)
    assert back == TELLING
    assert type(back.estimate) is TargetEstimate
    assert "estimate" not in msgpack.unpackb(encode(PLAIN, RUN))
    assert decode_pose(encode(PLAIN, RUN), RUN).estimate is None


def test_an_estimate_costs_eighty_bytes_or_less():
    assert len(encode(TELLING, RUN)) - len(encode(PLAIN, RUN)) <= 80


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (0, 8, "a detection of tick 8, must be of tick 7 or earlier"),
        (5, 0.0, "must be positive definite"),
        (5, -0.0025, "must be positive definite"),
        (6, 0.1, "must be positive definite"),
        (7, 1e-14, "must be positive definite"),
        (0, -1, "estimate is"),
        (0, 6.0, "estimate is"),
        (1, float("nan"), "estimate is"),
        (3, float("inf"), "estimate is"),
        (7, 1e9, "estimate is"),
        (6, None, "estimate is"),
    ],
)
def test_an_estimate_that_cannot_be_used_is_refused_with_its_reason(place, value, words):
    body = msgpack.unpackb(encode(TELLING, RUN))
    body["estimate"][place] = value
    for decoder in (decode_pose, lambda payload, run: decode(Pose, payload, run)):
        with pytest.raises(MalformedMessage, match="Pose") as caught:
            decoder(msgpack.packb(body), RUN)
        assert words in str(caught.value)
