"""Loading and checking of studies: from a shipped file, a user's file, or a mapping.

All problems are found before anything runs, and are listed together: those of the base scenario, of
the study's own keys, and of every cell, as far as the rest can be understood without the invalid
parts.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from encircle.protocol.errors import did_you_mean
from encircle.studies.plan import Plan, StudyError
from encircle.studies.plan_problems import plan_problems, problem_lines
from encircle.world.loading.files import read
from encircle.world.loading.files import shipped as shipped_scenarios
from encircle.world.loading.load import load
from encircle.world.loading.profiles import with_profile_named
from encircle.world.loading.toml_folder import toml_files
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.validation import problems_in

SHIPPED = Path(__file__).parent / "shipped"


def load_plan(
    source: str | Path | Mapping[str, Any],
    changes: Sequence[str] = (),
    seeds: int | str | None = None,
) -> Plan:
    """Load a study from a shipped name, a TOML file or a mapping, and check all its cells.

    ``changes``: ``key=value`` for the base scenario, as on the command line. ``seeds``: how
    many seeds, or which (``"1001-1200"``), instead of the study's own. Raises
    ``StudyError``, which lists every problem.
    """
    name, tree, folder = _read_source(source)
    tree.setdefault("name", name)
    if seeds is not None:
        tree["seeds"] = seeds
    of_base: list[str] = []
    try:
        if "scenario" in tree:
            tree["scenario"] = _base_scenario(tree["scenario"], folder)
    except ScenarioError as error:
        of_base = [f"scenario: {line}" for line in problem_lines(error)]
    plan, refused = _validated({**_with_absolute_files(tree, folder), "changes": tuple(changes)})
    problems = [*of_base, *refused.values()]
    if plan is not None:
        left_out = {str(path[0]) for path in refused} | ({"scenario"} if of_base else set())
        problems += plan_problems(plan, left_out)
    if plan is None or problems:
        raise StudyError(_problem_list(name, problems))
    return plan


def shipped_studies() -> dict[str, Path]:
    """The studies that come with the package: path by name."""
    return toml_files(SHIPPED)


def _validated(tree: dict[str, Any]) -> tuple[Plan | None, dict[tuple[str | int, ...], str]]:
    """The plan without its invalid parts, and the problems by their path in the tree.

    The plan is None if nothing valid is left. An invalid axis is left out alone; any other
    invalid key is left out as a whole.
    """
    try:
        return Plan.model_validate(tree), {}
    except ValidationError as error:
        refused = problems_in(error, Plan, tree)
    refused_axes = {path[1] for path in refused if path[0] == "axes" and len(path) > 1}
    keys = {path[0] for path in refused if path[0] != "axes" or len(path) == 1}
    rest = {key: value for key, value in tree.items() if key not in keys}
    if refused_axes and "axes" in rest:
        rest["axes"] = [
            axis for index, axis in enumerate(rest["axes"]) if index not in refused_axes
        ]
    try:
        return Plan.model_validate({"scenario": {}, **rest}), refused
    except ValidationError:
        return None, refused


def _base_scenario(source: Any, folder: Path) -> Any:
    """The base scenario as a tree.

    One that is written inside the study need not be complete yet.
    """
    if not isinstance(source, str):
        return source
    here = folder / source
    try:
        beside = here.is_file()
    except OSError:  # the text cannot be a file's name
        beside = False
    name = here if beside else source
    resolved = load(name).model_dump(mode="json", exclude_unset=True)
    return with_profile_named(resolved, read(name)[1])


def _with_absolute_files(tree: Any, folder: Path, key: str = "") -> Any:
    """A study's tree whose relative trace files are looked for in the study's directory."""
    if isinstance(tree, Mapping):
        return {name: _with_absolute_files(value, folder, name) for name, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_with_absolute_files(value, folder, key) for value in tree]
    is_file = isinstance(tree, str) and (key == "file" or key.endswith(".file"))
    return str(folder.resolve() / tree) if is_file else tree


def _read_source(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, Any], Path]:
    if isinstance(source, Mapping):
        return str(source.get("name", "study")), dict(source), Path()
    known = shipped_studies()
    path = known.get(str(source), Path(source))
    try:
        with open(path, "rb") as file:
            tree = tomllib.load(file)
    except (FileNotFoundError, IsADirectoryError):
        if str(source) in shipped_scenarios():
            raise _scenario_given(source) from None
        raise StudyError(
            f"study {str(source)!r} is neither a file nor one of: {', '.join(known)}"
            f"{did_you_mean(source, known)}"
        ) from None
    except ValueError as error:  # tomllib's errors, and wrong UTF-8
        raise StudyError(f"study {str(source)!r} cannot be parsed: {error}") from None
    except OSError as error:
        raise StudyError(f"study {str(source)!r} cannot be read: {error.strerror}") from None
    only_scenarios = Scenario.model_fields.keys() - Plan.model_fields.keys()
    if "scenario" not in tree and "axes" not in tree and only_scenarios & tree.keys():
        raise _scenario_given(source)
    return path.stem, tree, path.parent


def _scenario_given(source: object) -> StudyError:
    return StudyError(
        f"study {str(source)!r} is a scenario, which has no axes: to run it once, encircle run"
        f" {source}; a study names it with scenario = {str(source)!r}"
    )


def _problem_list(name: str, lines: Sequence[str]) -> str:
    many = "one problem" if len(lines) == 1 else f"{len(lines)} problems"
    return "\n".join([f"study {name!r} has {many}:", *(f"  {line}" for line in lines)])
