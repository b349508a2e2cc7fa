"""What is raised for a scenario that cannot be run."""


class ScenarioError(ValueError):
    """A scenario that cannot be run; the message lists every problem, one per line."""
