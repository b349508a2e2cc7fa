"""What came of the benchmark's runs, as arrays over policies, tasks and seeds.

All policies have the same tasks and seeds, which are therefore resampled together. A run that does
not capture, or that fails, counts as no capture, and its time as the whole limit of its task.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Outcomes:
    """Runs of P policies on T tasks with S common seeds.

    ``capture_ticks``: (P, T, S) the tick of the capture, 0 if there was none. ``limit_ticks``:
    (T,) the length of a run without capture.
    """

    policies: tuple[str, ...]
    tasks: tuple[str, ...]
    seeds: tuple[int, ...]
    capture_ticks: NDArray[np.int64]
    limit_ticks: NDArray[np.int64]

    def __post_init__(self) -> None:
        shape = (len(self.policies), len(self.tasks), len(self.seeds))
        assert self.capture_ticks.shape == shape, (self.capture_ticks.shape, shape)
        assert self.limit_ticks.shape == (len(self.tasks),)

    @cached_property
    def captured(self) -> NDArray[np.bool_]:
        """(P, T, S) whether the target was captured."""
        return np.asarray(self.capture_ticks > 0)

    @cached_property
    def time_shares(self) -> Floats:
        """(P, T, S) the time to capture as a share of the task's limit, 1 without capture."""
        shares = self.capture_ticks / self.limit_ticks[:, None]
        return np.asarray(np.where(self.captured, shares, 1.0))

    @property
    def capture_shares(self) -> Floats:
        """(P, T) the share of seeds in which the target was captured."""
        return np.asarray(self.captured.mean(axis=2))

    def with_seeds(self, seeds: Sequence[int]) -> "Outcomes":
        """The same with some of the seeds, in the order given."""
        index = [self.seeds.index(seed) for seed in seeds]
        return Outcomes(
            self.policies,
            self.tasks,
            tuple(seeds),
            self.capture_ticks[:, :, index],
            self.limit_ticks,
        )

    def beside(self, others: "Outcomes") -> "Outcomes":
        """These policies, and then others on the same tasks, with the seeds that both have."""
        assert self.tasks == others.tasks
        assert not set(self.policies) & set(others.policies)
        assert (self.limit_ticks == others.limit_ticks).all()
        seeds = [seed for seed in self.seeds if seed in set(others.seeds)]
        ticks = [each.with_seeds(seeds).capture_ticks for each in (self, others)]
        return Outcomes(
            (*self.policies, *others.policies),
            self.tasks,
            tuple(seeds),
            np.concatenate(ticks),
            self.limit_ticks,
        )
