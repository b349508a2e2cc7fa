"""How sure robots are that share what they know of the target, and how sure they may be.

``PYTHONPATH=tests/helpers python bench/consistency.py`` makes 200 runs of robots at rest, in which
the target moves and is detected as the robots' filters have it, and everybody tells everybody what
it knows at each tick. It prints, for each way of telling, the normalised estimation error squared
(NEES), its 95 % interval for a filter that is as sure as it may be, and the error of the position.
``--figure FILE`` draws the NEES over time. Values at one tick are independent between runs, so the
mean of R of them is a chi-square variable with 4 R degrees of freedom over R.
"""

import argparse

import numpy as np
from helpers_agents import TICK_S
from helpers_fusion import ALONE, errors_of
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

from encircle.measures.belief import NEES_BAND, STATES

RUNS, ROBOTS, TICKS = 200, 4, 60
WAYS = {
    ALONE: "nothing told",
    "own": "detections told",
    "fuse": "estimates, intersected",
    "fuse-naive": "estimates, taken for independent",
}
LOSSES = (0.0, 0.8)


def main() -> None:
    """Print the table; draw the figure if asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--figure")
    arguments = parser.parse_args()
    low, high = chi2(STATES * RUNS).ppf([0.025, 0.975]) / RUNS
    table = Table(
        title=f"{RUNS} runs, {ROBOTS} robots, {TICKS} ticks; NEES of one robot, mean over runs:"
        f" {low:.2f} to {high:.2f} if consistent"
    )
    for heading in ("loss", "way", "at tick 10", "at the end", "in its band", "error, m"):
        table.add_column(heading)
    curves = {}
    for loss in LOSSES:
        for way, words in WAYS.items():
            runs = [errors_of(way, seed, ROBOTS, TICKS, loss) for seed in range(RUNS)]
            nees, squares = (np.array(part) for part in zip(*runs, strict=True))
            curves[loss, way] = np.nanmean(nees[..., 0], axis=0)
            known = nees[~np.isnan(nees)]
            band = np.mean((known >= NEES_BAND[0]) & (known <= NEES_BAND[1]))
            values = (curves[loss, way][10], curves[loss, way][-1])
            table.add_row(
                *(f"{loss:.0%}", words, *(f"{value:.2f}" for value in values)),
                *(f"{band:.0%}", f"{np.sqrt(np.nanmean(squares)):.3f}"),
            )
    Console().print(table)
    if arguments.figure:
        draw(curves, (low, high), arguments.figure)


def draw(curves: dict[tuple[float, str], np.ndarray], band: tuple[float, float], file: str) -> None:
    """NEES over time, a panel for each loss; the grey band is that of a consistent filter."""
    import matplotlib.pyplot as plt

    from encircle.figures.drawing import COLOURS, MARKERS

    figure, panels = plt.subplots(1, len(LOSSES), sharey=True, figsize=(9.0, 3.4))
    for panel, loss in zip(panels, LOSSES, strict=True):
        panel.axhspan(*band, color="0.85")
        for k, (way, words) in enumerate(WAYS.items()):
            marks = {"marker": MARKERS[k], "color": COLOURS[k], "markevery": (2 * k, 8), "ms": 5}
            panel.plot(np.arange(TICKS) * TICK_S, curves[loss, way], label=words, lw=1.2, **marks)
        panel.set(yscale="log", xlabel="time, s", title=f"{100 * loss:.0f} % loss")
    panels[0].set_ylabel("NEES, mean of 200 runs")
    panels[0].legend(fontsize="small", loc="center right")
    figure.tight_layout()
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
