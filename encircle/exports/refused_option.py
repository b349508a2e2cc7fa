"""That an option of a format cannot be: what a format raises, and the command line tells of."""

from encircle.world.recording.run_directory import RunDirectoryError


class OptionRefused(RunDirectoryError):
    """An option of a format that cannot be: its name and value, what is wrong, and what can be.

    The message has all three; ``option`` is the name of the keyword alone, ``problem`` the rest.
    """

    def __init__(self, option: str, value: object, problem: str) -> None:
        super().__init__(f"{option} {value}: {problem}")
        self.option, self.problem = option, problem
