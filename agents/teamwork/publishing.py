"""When to publish: at every n-th tick, or only when silence would mislead the peers.

The second is send-on-delta: a sender keeps a model of what its receivers conclude from its packets
alone, and sends when the truth is farther than a given error from that. Receivers here conclude two
things: where the sender is (``encircle.agents.teamwork.peers``: the last position, held or moved on
by the velocity sent with it) and where the target is (``encircle.agents.estimation.kalman``: the
constant-velocity prediction from the detections sent). Both are computed as the receivers do it. So
if packets arrive at once, and a receiver knows nothing else, its error is never larger than that
while it receives nothing.

Left out: packets are not acknowledged, so after a loss only the age of the last packet brings the
next one. That the target is out of sight again is no event, since no receiver's picture depends on
it. Detections by others are relayed with the next packet, and cause none. A detection at a tick
without a packet serves this robot alone: it is not sent later. Nor is what a policy says at such a
tick, whatever it is: it is no event.
"""

from math import dist
from typing import NamedTuple

from encircle.agents.estimation.kalman import Estimate, next_estimate
from encircle.agents.teamwork.peers import Peer, believed_positions, incorporate
from encircle.protocol.messages import QUANTUM_M, Point, Pose
from encircle.protocol.parameters import Parameters


class ReceiverModel(NamedTuple):
    """What a peer knows that has received all of this robot's packets and nothing else.

    ``sender``: about this robot, by its last packet; ``detecting``: whether that packet carried a
    detection; ``target``: its estimate of the target; ``detected_tick``: newest tick of a detection
    in it.
    """

    sender: Peer
    detecting: bool
    target: Estimate | None
    detected_tick: int


def should_publish(
    receiver_model: ReceiverModel | None,
    tick: int,
    position: Point,
    detection: Point | None,
    tick_s: float,
    parameters: Parameters,
) -> bool:
    """Whether to publish at a tick.

    ``receiver_model``: as of the tick before, None if nothing was published.
    """
    if tick % parameters.publish_every_ticks:
        return False
    if parameters.publish == "always" or receiver_model is None:
        return True
    if tick - receiver_model.sender[0] >= parameters.publish_age_ticks_max:
        return True
    # Whole quanta travel, so an error of one is none.
    error_m = parameters.publish_error_m + QUANTUM_M
    if dist(position, believed_positions((receiver_model.sender,), tick, parameters)[0]) > error_m:
        return True
    if detection is None:
        return False
    target = _target_at_receivers(receiver_model, tick, parameters)
    if target is None or not receiver_model.detecting:
        return True
    return dist(detection, (target.x + tick_s * target.vx, target.y + tick_s * target.vy)) > error_m


def next_receiver_model(
    receiver_model: ReceiverModel | None,
    pose: Pose | None,
    tick: int,
    tick_s: float,
    parameters: Parameters,
) -> ReceiverModel | None:
    """The model when a tick is over; ``pose``: the packet sent at it, if any."""
    if parameters.publish == "always":
        return None
    target = _target_at_receivers(receiver_model, tick, parameters)
    if pose is None or pose.detection is None:
        target = next_estimate(target, (), tick_s, parameters)
        detected_tick = receiver_model.detected_tick if receiver_model else -1
    else:
        target = next_estimate(target, ((tick, 0, *pose.detection),), tick_s, parameters)
        detected_tick = tick
    if pose is None:
        return receiver_model and receiver_model._replace(target=target)
    sender = incorporate((None,), ((0, pose),), (), tick, tick_s)[0]
    assert sender is not None, "a packet shows where its sender is"
    return ReceiverModel(sender, pose.detection is not None, target, detected_tick)


def _target_at_receivers(
    receiver_model: ReceiverModel | None, tick: int, parameters: Parameters
) -> Estimate | None:
    """The peer's estimate, unless it has given the target up for lost by now."""
    if (
        receiver_model is None
        or receiver_model.detected_tick < tick - parameters.track_age_ticks_max
    ):
        return None
    return receiver_model.target
