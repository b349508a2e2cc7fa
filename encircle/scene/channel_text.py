"""What a scenario's radio does, in short sentences for the margin of a picture."""

from encircle.scene.field_text import ITEMS_MAX, items_text, value_text
from encircle.world.channel.delay_means import mean_s
from encircle.world.scenario.channel_model import LinkOverride
from encircle.world.scenario.delay_models import ConstantDelay, Delay
from encircle.world.scenario.loss_models import (
    BernoulliLoss,
    BurstLoss,
    GilbertElliottLoss,
    Loss,
    NoLoss,
)
from encircle.world.scenario.model import Scenario


def channel_sentences(scenario: Scenario) -> tuple[str, ...]:
    """One sentence each on loss, delay, and whatever else the radio does; events are not in it."""
    channel = scenario.channel
    sentences = [loss_text(channel.loss), delay_text(channel.delay)]
    if channel.duplication.rate:
        sentences.append(f"{_percent(channel.duplication.rate)} of packets arrive twice")
    if channel.rate_limit is not None:
        sentences.append(f"rate limit: {value_text(channel.rate_limit)}")
    if channel.contention is not None:
        sentences.append(f"contention: {value_text(channel.contention)}")
    if channel.order == "kept":
        sentences.append("packets keep their order")
    sentences += _few([_link_text(link) for link in channel.links])
    sentences += _few([text for robot in scenario.ids for text in _radio_texts(scenario, robot)])
    if scenario.is_direct:
        sentences.append("robots hear each other directly")
    return tuple(sentences)


def loss_text(loss: Loss) -> str:
    """What a loss model does, as in ``loss 60 % (bernoulli)``."""
    match loss:
        case NoLoss():
            return "no loss"
        case BernoulliLoss():
            return f"loss {_percent(loss.rate)} (bernoulli)"
        case BurstLoss():
            return f"loss {_percent(loss.rate)} in bursts of {loss.burst_packets:g} packets (burst)"
        case GilbertElliottLoss() if loss.good_to_bad + loss.bad_to_good > 0.0:
            bad = loss.good_to_bad / (loss.good_to_bad + loss.bad_to_good)
            rate = bad * loss.loss_bad + (1.0 - bad) * loss.loss_good
            return f"loss {_percent(rate)} in bursts (gilbert-elliott)"
    return f"loss: {value_text(loss)}"


def delay_text(delay: Delay) -> str:
    """What a delay model does, as in ``delay 300 ms on average (gamma, std_s = 0.2)``."""
    if delay == ConstantDelay():
        return "no delay"
    if isinstance(delay, ConstantDelay):
        return f"delay {delay.mean_s * 1e3:.4g} ms (constant)"
    rest = {
        name: getattr(delay, name)
        for name in type(delay).model_fields
        if name not in ("model", "mean_s")
    }
    of_trace = delay.model == "trace"
    details = delay.model if of_trace else f"{delay.model}, {items_text(rest)}" if rest else None
    return f"delay {mean_s(delay) * 1e3:.4g} ms on average ({details or delay.model})"


def _link_text(link: LinkOverride) -> str:
    ends = f"{link.sender or 'any'} to {link.receiver or 'any'}"
    texts = [loss_text(link.loss)] if link.loss is not None else []
    texts += [delay_text(link.delay)] if link.delay is not None else []
    return f"{ends}: {', '.join(texts) or 'as the others'}"


def _radio_texts(scenario: Scenario, robot: str) -> list[str]:
    own = scenario.override_of(robot)
    texts = []
    if own.radio_range_m is not None:
        texts.append(f"{robot}'s radio reaches {own.radio_range_m:g} m")
    if own.loss_rate:
        texts.append(f"{robot}'s radio loses {_percent(own.loss_rate)}")
    return texts


def _few(texts: list[str]) -> list[str]:
    left_out = len(texts) - ITEMS_MAX
    return texts if left_out <= 0 else [*texts[:ITEMS_MAX], f"and {left_out} more"]


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
