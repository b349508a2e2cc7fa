"""What may be said of the benchmark's numbers, in sentences and in the cells of tables.

No sentence says more than its interval. A difference is called higher or lower only if it is
decided (``comparisons.Difference.verdict``); otherwise it is undecided, never absent.
"""

import shlex
from collections.abc import Sequence

import numpy as np

from encircle.benchmark.score import Score, Scores, independent_difference
from encircle.benchmark.seeds import SEEDS
from encircle.statistics.comparisons import Difference, Verdict
from encircle.statistics.intervals import Interval

RANKS_NAMED_MAX = 3
RANK_SHARE_NAMED_MIN = 0.05


def percent(interval: Interval) -> str:
    """A share as ``55.1 [50.2, 60.0]``, in percent."""
    value, low, high = (100.0 * bound for bound in interval)
    return f"{value:.1f}" if np.isnan(low) else f"{value:.1f} [{low:.1f}, {high:.1f}]"


def points(interval: Interval) -> str:
    """A difference of shares as ``+5.1 [+0.2, +10.0]``, in percentage points."""
    value, low, high = (100.0 * bound + 0.0 for bound in interval)
    return f"{value:+.1f}" if np.isnan(low) else f"{value:+.1f} [{low:+.1f}, {high:+.1f}]"


def open_ranks(score: Score) -> str:
    """The ranks that the decided differences leave open: ``2`` or ``2 to 4``."""
    if score.best == score.worst:
        return str(score.best)
    return f"{score.best} to {score.worst}"


def held_ranks(score: Score) -> str:
    """The ranks held most often in the resamples: ``1 (93 %), 2 (7 %)``; empty of one seed."""
    if not score.is_bounded:
        return ""
    order = np.argsort(-score.rank_shares, kind="stable")[:RANKS_NAMED_MAX]
    named = [
        f"{1 + rank} ({100.0 * score.rank_shares[rank]:.0f} %)"
        for k, rank in enumerate(order.tolist())
        if k == 0 or score.rank_shares[rank] >= RANK_SHARE_NAMED_MIN
    ]
    return ", ".join(named)


def p_text(p: float) -> str:
    """A p for a table."""
    return "" if np.isnan(p) else "< 0.001" if p < 0.001 else f"{p:.3f}"


def verdict_text(difference: Difference) -> str:
    """``higher``, ``lower``, ``undecided``, or that all pairs are equal."""
    if difference.verdict is Verdict.UNDECIDED and difference.ties == difference.pairs:
        return "undecided: equal in every seed"
    return str(difference.verdict)


def table_sentences(scores: Scores, seeds: int) -> list[str]:
    """What the table of all policies lets one say."""
    first = scores.of[0]
    lines = [
        f"{first.policy} has the highest score, {_score_and_bounds(first)}. The decided differences"
        f" leave rank {open_ranks(first)} open to it."
    ]
    if len(scores.of) > 1:
        lines += [_stability(first), _decided(scores)]
    if seeds < SEEDS:
        lines.append(
            f"This is a try: {seeds} of the {SEEDS} public seeds. Scores of benchmarks are made of"
            " all."
        )
    return lines


def try_sentence(seeds: int) -> str:
    """What is said of a submission with fewer seeds of each kind than the benchmark has."""
    return f"This is a try with few seeds, {seeds} of each: scores to publish are made of {SEEDS}."


def not_rerun_sentence(file: str, brings_policies: bool) -> str:
    """That the rows of a bundle are taken as they are, and which command tells more.

    ``file``: as it is named to the reader. ``brings_policies``: whether it holds code of its own.
    """
    read_first = " Read the policies in it first." if brings_policies else ""
    return (
        f"The rows of {file} were not run again here: {verify_command(file, brings_policies)} does"
        f" that for some of them, with --all for all.{read_first} Until then score and policy are"
        " what the bundle says."
    )


def verify_command(file: str, brings_policies: bool) -> str:
    """The command that runs rows of a bundle again."""
    return shlex.join(["encircle", "verify", file, *["--run-policies"] * brings_policies])


def own_sentences(scores: Scores, own: str) -> list[str]:
    """What may be said of one policy among the others."""
    (score,) = [score for score in scores.of if score.policy == own]
    others = [other.policy for other in scores.of if other.policy != own]
    verdicts: dict[Verdict, list[str]] = {verdict: [] for verdict in Verdict}
    for other in others:
        verdicts[difference_from(scores, other, own).verdict].append(other)
    said = [
        f"{word} {_listed(verdicts[verdict])}"
        for verdict, word in (
            (Verdict.HIGHER, "decidedly higher than"),
            (Verdict.LOWER, "decidedly lower than"),
            (Verdict.UNDECIDED, "undecided against"),
        )
        if verdicts[verdict]
    ]
    equal = [one.policy for one in scores.of if one.rank == score.rank and one.policy != own]
    shared = f", shared with {_listed(equal)}" if equal else ""
    return [
        f"On the public {_seeds(score.is_bounded)} {own} scores {_score_and_bounds(score)}.",
        f"It holds rank {score.rank} of {len(scores.of)}{shared}; the decided differences leave"
        f" rank {open_ranks(score)} open.",
        f"Seed by seed on these tasks its score is {'; '.join(said)}.",
        _stability(score),
    ]


def held_out_sentence(own: str, public: Interval, held_out: Interval) -> str:
    """The score on the held-out seeds beside that on the public ones; neither has bounds of one."""
    change = independent_difference(public, held_out)
    if np.isnan(change.low):
        said = "which has no bounds, of a single seed, and is undecided"
    elif change.low <= 0.0 <= change.high:
        said = "which is undecided"
    elif change.value < 0.0:
        said = "so it does better on the public seeds than on seeds that nobody chose"
    else:
        said = "so it does worse on the public seeds than on seeds that nobody chose"
    return (
        f"On the held-out {_seeds(not np.isnan(held_out.low))} {own} scores {percent(held_out)} %,"
        f" {points(change)} points from its score on the public"
        f" {_seeds(not np.isnan(public.low))}, {said}."
    )


def difference_from(scores: Scores, other: str, own: str) -> Difference:
    """The score of ``own`` minus that of ``other``, whichever stands first."""
    names = [score.policy for score in scores.of]
    if names.index(other) < names.index(own):
        return scores.pair(other, own)
    turned = scores.pair(own, other)
    mean, effect = (
        Interval(-one.value, -one.high, -one.low) for one in (turned.mean, turned.effect_size)
    )
    return turned._replace(mean=mean, effect_size=effect, better=turned.worse, worse=turned.better)


def _stability(score: Score) -> str:
    if not score.is_bounded:
        return (
            f"How sure the rank of {score.policy} is cannot be told of a single seed, which leaves"
            " nothing to resample."
        )
    rank = int(score.rank_shares.argmax())
    share = 100.0 * float(score.rank_shares[rank])
    return (
        f"{score.policy} holds rank {1 + rank} in {share:.0f} % of the resamples of seeds and"
        " tasks, no other rank more often."
    )


def _decided(scores: Scores) -> str:
    decided = sum(pair.difference.verdict is not Verdict.UNDECIDED for pair in scores.pairs)
    neighbours = [
        (a.policy, b.policy)
        for a, b in zip(scores.of, scores.of[1:], strict=False)
        if scores.pair(a.policy, b.policy).verdict is Verdict.UNDECIDED
    ]
    text = (
        f"Of {len(scores.pairs)} pairs of policies {decided} are decided, compared within seeds on"
        " these tasks"
    )
    if not neighbours:
        return f"{text}, and with them the whole order."
    pairs = _listed([f"{a} and {b}" for a, b in neighbours])
    return f"{text}. The order of these neighbours is undecided: {pairs}."


def _score_and_bounds(score: Score) -> str:
    """A score in words: ``55.1 %``, its bounds over seeds, and those over tasks too."""
    value, low, high = (100.0 * bound for bound in score.over_all)
    if not score.is_bounded:
        return (
            f"{value:.1f} %. Of a single seed there are no bounds, neither for other seeds on these"
            " tasks nor for other tasks"
        )
    _, seeds_low, seeds_high = (100.0 * bound for bound in score.over_seeds)
    return (
        f"{value:.1f} %: [{seeds_low:.1f}, {seeds_high:.1f}] % for other seeds on these tasks,"
        f" [{low:.1f}, {high:.1f}] % for other seeds and other tasks of this kind"
    )


def _seeds(several: bool) -> str:
    return "seeds" if several else "seed"


def _listed(names: Sequence[str]) -> str:
    return "; ".join(names) if any(" and " in name for name in names) else ", ".join(names)
