"""The benchmark's numbers as CSV files: a line for each policy, and one for each task."""

import csv
from pathlib import Path

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.score import Scores


def write_scores(scores: Scores, path: Path) -> None:
    """Write a line for each policy: score, bounds, ranks and the shares of all ranks."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        bounds = [
            "score",
            "low",
            "high",
            "seeds_low",
            "seeds_high",
            "time",
            "time_low",
            "time_high",
        ]
        ranks = [f"rank_{1 + rank}_share" for rank in range(len(scores.of))]
        writer.writerow(["policy", *bounds, "rank", "best", "worst", *ranks])
        for score in scores.of:
            numbers = (*score.over_all, *score.over_seeds[1:], *score.time)
            writer.writerow(
                [
                    score.policy,
                    *(f"{number:.10g}" for number in numbers),
                    score.rank,
                    score.best,
                    score.worst,
                    *(f"{share:.10g}" for share in score.rank_shares),
                ]
            )


def write_tasks(outcomes: Outcomes, path: Path) -> None:
    """Write a line for each task: the share of seeds with capture of each policy."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["task", "limit_ticks", "seeds", *outcomes.policies])
        for row, task in enumerate(outcomes.tasks):
            shares = (f"{share:.10g}" for share in outcomes.capture_shares[:, row])
            writer.writerow([task, outcomes.limit_ticks[row], len(outcomes.seeds), *shares])
