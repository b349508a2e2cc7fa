"""Encircle: hunt a moving target with robots that share nothing but messages.

>>> import encircle
>>> hunt = encircle.run("sim1", link="memory")
>>> hunt.captured
True
"""

from encircle.hunts import Hunt, run
from world.scenario import Scenario, ScenarioError, load, shipped

__all__ = ["Hunt", "Scenario", "ScenarioError", "load", "run", "shipped"]
