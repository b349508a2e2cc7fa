"""Whether a policy is a function of memory and view alone: the same questions, asked otherwise.

Whatever else has a say shows in an answer that differs when it is asked twice, after other robots
than in the hunt, in another process, or with its memory put away and fetched back in between.
"""

import os
import pickle
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, redirect_stdout
from copy import deepcopy
from itertools import groupby
from types import ModuleType
from typing import Any

from encircle.agents.policies.decision_check import validated
from encircle.agents.policies.interface import Decision, View
from encircle.check_results import CheckResult
from encircle.conformance.canonical import digest_of
from encircle.conformance.scenes import Answer, Participation, answers_by_tick, answers_of
from encircle.conformance.subject import Subject, found
from encircle.protocol.plugins import error_line
from encircle.runner.process_pool import in_order

HASH_SEED = "PYTHONHASHSEED"
HASH_SEEDS = ("1", "2", "3")
"""The order of a set of a few texts may be the same under two of them."""
NAMES_MAX = 3
PURE_ADVICE = "nothing but memory and view may have a say: no global, clock or random number"
HASHES_ADVICE = (
    "sets of texts have another order in each process: sort them; nor may a decision hang on"
    " hash(), id() or what an import has drawn"
)
INPUTS_ADVICE = {
    "memory": "return a new one, such as {**memory, 'ticks': memory['ticks'] + 1}",
    "view": "what a policy wants to remember it returns as memory",
}
Parts = Sequence[Participation]


def check_inputs(parts: Parts) -> CheckResult:
    """Whether the memory that a policy was given, and its view, were left as they were."""
    for part in parts:
        for tick, name in part.changed:
            where = f"{part.robot} at tick {tick} ({part.scene})"
            said = f"{where}: it changes the {name} that it is given"
            return CheckResult("inputs", "wrong", said, INPUTS_ADVICE[name])
    return CheckResult("inputs", "ok", "memory and view stay as they were given")


def check_twice(subject: Subject, parts: Parts) -> CheckResult:
    """Each view asked twice, with the same memory."""
    policy, asked = subject.ask, 0
    for part in parts:
        keeps = not part.changed
        memory: Any = None
        for view in part.views:
            first = policy(memory if keeps else deepcopy(memory), view)
            second = policy(memory if keeps else deepcopy(memory), view)
            asked += 1
            if difference := _difference(first, second):
                where = f"{part.place(view)}: asked twice, {difference}"
                before = globals_of(subject.module)
                policy(deepcopy(memory), view)
                names = changed(before, globals_of(subject.module))
                return CheckResult("same answer", "wrong", where, _why(names))
            memory = first[0]
    return CheckResult("same answer", "ok", f"{asked} questions asked twice, answered alike")


def check_memory(subject: Subject, parts: Parts) -> CheckResult:
    """Whether what it remembers can be pickled, and it goes on the same with what comes back."""
    bytes_max = 0

    def through_pickle(memory: Any) -> Any:
        nonlocal bytes_max
        pickled = pickle.dumps(memory)
        bytes_max = max(bytes_max, len(pickled))
        return pickle.loads(pickled)  # noqa: S301  # just made here

    for part in parts:
        try:
            answers = answers_of(subject.ask, part.views, through_pickle)
        except (pickle.PicklingError, TypeError, AttributeError, RecursionError) as error:
            if subject.place_in(error):
                raise
            return CheckResult(
                "memory",
                "wrong",
                f"what it remembers cannot be pickled: {error_line(error)}",
                "remember plain values, tuples, maps or objects of classes of your module",
            )
        if difference := first_difference(part, answers):
            return CheckResult(
                "memory",
                "wrong",
                f"{difference} once its memory was pickled and fetched back",
                "remember values, not which object they are",
            )
    said = f"can be pickled, at most {bytes_max} bytes, and comes back the same"
    return CheckResult("memory", "ok", said)


def check_order(subject: Subject, parts: Parts) -> CheckResult:
    """The robots one after the other, and the last first, instead of tick by tick."""
    before = globals_of(subject.module)
    for order in (parts, parts[::-1]):
        for part in order:
            if difference := first_difference(part, answers_of(subject.ask, part.views)):
                said = f"{difference} if the robots are asked in another order"
                names = changed(before, globals_of(subject.module))
                return CheckResult("order", "wrong", said, _why(names))
    return CheckResult("order", "ok", "the same with robots one after the other, and backwards")


def check_processes(subject: Subject, parts: Parts) -> list[CheckResult]:
    """Fresh processes, each with another seed of Python's hashes; in one the last robot first."""
    views = [[p.views for p in of_scene] for _, of_scene in groupby(parts, lambda p: p.scene)]
    for seed, backwards in (*((seed, False) for seed in HASH_SEEDS), (HASH_SEEDS[0], True)):
        task = (subject.name, dict(subject.parameters), pickle.dumps(views), backwards)
        try:
            with _hash_seed(seed):
                (answers,) = in_order(answers_in_process, [task], 1, 1, lambda _done, _all: None)
        except BrokenProcessPool:
            answers = "it ends the process"
        if isinstance(answers, str):
            said, advice = f"{answers} in a fresh process", _why(())
            return [CheckResult("fresh process", "wrong", said, advice)]
        for part, given in zip(parts, answers, strict=True):
            if not (difference := first_difference(part, given)):
                continue
            said = f"{difference} in a fresh process"
            if backwards:
                said = f"{said} that asks the last robot first"
                return [CheckResult("order", "wrong", said, _why(()))]
            return [CheckResult("fresh process", "wrong", said, HASHES_ADVICE)]
    said = f"the same in {len(HASH_SEEDS) + 1} of them, also with the last robot first"
    return [CheckResult("fresh process", "ok", said)]


def answers_in_process(
    task: tuple[str, dict[str, Any], bytes, bool],
) -> list[list[Answer]] | str:
    """What a policy answers in this process to each participation's views, or how it fails.

    The task: its name, its parameters, of each scene the views of each participation, pickled, and
    whether the last participation comes first; else they are asked tick by tick.
    """
    name, parameters, pickled, backwards = task
    function, _ = found(name)
    assert function is not None, "the parent process has found it"
    policy = Subject(name, function, parameters).ask
    views: list[list[list[View]]] = pickle.loads(pickled)  # noqa: S301  # from the parent process
    try:
        with redirect_stdout(sys.stderr):
            if not backwards:
                return answers_by_tick(policy, views)
            each = [of_part for of_scene in views for of_part in of_scene]
            return [answers_of(policy, of_part) for of_part in each[::-1]][::-1]
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return f"it raises {error_line(error)}"


def first_difference(part: Participation, answers: Sequence[Answer]) -> str:
    """Where answers are not those of the hunt, for people; empty if they are."""
    for view, recorded, answer in zip(part.views, part.answers, answers, strict=True):
        if recorded != answer:
            what = "remembers" if recorded.decision == answer.decision else "decides"
            return f"{part.place(view)}: it {what} something else"
    return ""


def globals_of(module: ModuleType | None) -> dict[str, str]:
    """What stands in a module beside its imports: its values, and what its functions keep."""
    kept = {}
    for name, value in vars(module).items() if module is not None else ():
        if name.startswith("__") or isinstance(value, ModuleType):
            continue
        if callable(value) and getattr(value, "__module__", None) == vars(module)["__name__"]:
            parts = (getattr(value, key, None) for key in ("__defaults__", "__kwdefaults__"))
            own = {k: v for k, v in vars(value).items() if not callable(v) and k[:2] != "__"}
            value = (*parts, own)
        kept[name] = digest_of(value)
    return kept


def changed(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Names of a module that stand for something else now."""
    return [name for name, value in after.items() if before.get(name) != value]


def _why(names: Sequence[str]) -> str:
    if not names:
        return PURE_ADVICE
    listed = ", ".join(names[:NAMES_MAX])
    return f"{listed} of its module changed meanwhile: what it has to remember it returns as memory"


def _difference(first: Any, second: Any) -> str:
    (memory, decision), (memory_2, decision_2) = validated(first), validated(second)
    if digest_of(decision) != digest_of(decision_2):
        fields = zip(Decision._fields, decision, decision_2, strict=True)
        name, a, b = next(f for f in fields if digest_of(f[1]) != digest_of(f[2]))
        return f"it decides {name} = {a!r}, then {b!r}"
    return "it remembers something else" if digest_of(memory) != digest_of(memory_2) else ""


@contextmanager
def _hash_seed(seed: str) -> Iterator[None]:
    """Interpreters that are started meanwhile take this for the seed of their hashes."""
    before = os.environ.get(HASH_SEED)
    os.environ[HASH_SEED] = seed
    try:
        yield
    finally:
        if before is None:
            del os.environ[HASH_SEED]
        else:
            os.environ[HASH_SEED] = before
