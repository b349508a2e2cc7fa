"""The robot: it estimates, predicts, encircles, shrinks and avoids on what it has heard.

``brain`` is a pure function from state and observation to state and action; ``core`` speaks the
protocol around it without I/O; ``robot`` is the asyncio process. ``python -m encircle.agents ID
--connect E --run R`` starts one.
"""

if __name__ != "encircle.agents":
    raise ImportError("the package is imported as encircle.agents, not as agents", name=__name__)
