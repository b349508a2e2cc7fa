"""The paper's five simulations: run, drawn, and compared with what the paper says of them.

Each simulation gets findings: what the paper claims, and whether it is so here, with the numbers.
They are computed from the recording's truth, and they are reported as they come: a claim that does
not hold is reported as not holding. The paper leaves starts and the target's behaviour open, so
these are runs of its method in scenarios of ours, not of the paper's own.
"""

import json
import textwrap
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, hypot, remainder, tau
from pathlib import Path
from typing import Any

import numpy as np

from encircle.execution_times import (
    JITTER_M,
    NOISE_M_STD,
    POLICIES,
    STAR,
    X_OF_R3_M,
    Estimate,
    ExecutionTimes,
    capture_rates,
    execution_times,
)
from encircle.figures import TimeCurve, draw_execution_times, draw_snapshots, draw_trajectories
from encircle.hunts import run
from encircle.replaying import Recording, read_recording
from encircle.tracks import Tracks, estimates_agree, points_shared, tracks_of
from protocol.codec import decode
from protocol.messages import Observation
from world.run_directory import create, versions

RANDOM_STARTS = 200
TURN_TICKS = 5
TURN_DEG_MIN = 20.0
RIGHT_DEG_MAX = 45.0
CAUGHT_UP_M = 0.5
COLUMNS = 98
