"""Each mistake that a reader makes in a policy is found, and gets an explanation."""

import multiprocessing

import pytest
from helpers_paths import ROOT

from encircle.conformance import purity, scenes
from encircle.conformance.check_policy import examined
from encircle.protocol.plugins import SHIPPED_POLICIES

HEAD = """
import random, time, uuid
from datetime import datetime
import numpy as np
from encircle import Decision
from encircle.agents.policies.paper import xi_star

_default = xi_star
"""
GOOD = """
def policy(memory, view, *, weight: float = 0.5):
    memory = memory or {"bids": {}, "ticks": 0}
    bids = dict(memory["bids"])
    for packet in view.heard:
        bid = packet.say.get("bid")
        if isinstance(bid, float):
            bids[packet.robot] = bid
    noise = np.random.default_rng([view.tick, view.own]).normal()
    decision = _default(None, view)[1]._replace(say={"bid": weight * view.tick, "at": [0.5, 1.0]})
    return {"bids": bids, "ticks": memory["ticks"] + 1, "noise": noise}, decision
"""
MUTATING = """
def policy(memory, view):
    memory = {} if memory is None else memory
    memory["ticks"] = memory.get("ticks", 0) + 1
    return memory, _default(None, view)[1]
"""
VIEW_CHANGED = """
def policy(memory, view):
    object.__setattr__(view.parameters, "xi_weight", view.parameters.xi_weight + 0.1)
    return memory, _default(None, view)[1]
"""
VIEW_ASSIGNED = """
def policy(memory, view):
    view.tick = 3
"""
GLOBAL = """
count = 0


def policy(memory, view):
    global count
    count += 1
    return memory, _default(None, view)[1]._replace(say={"count": count})
"""
FIRST_ASKED = """
first = []


def policy(memory, view):
    if memory is None:
        first.append(view.robot)
    return first[0], _default(None, view)[1]._replace(say={"first": first[0]})
"""
IN_DEFAULT = """
def policy(memory, view, *, seen=[]):
    seen.append(view.tick)
    return memory, _default(None, view)[1]._replace(say={"n": len(seen)})
"""
HASHES = """
def policy(memory, view):
    first = next(iter({"red", "green", "blue", "yellow", *view.team}))
    return memory, _default(None, view)[1]._replace(say={"first": first})
"""
IDENTITY = """
MARK = object


class Mark:
    pass


MARK = Mark()


def policy(memory, view):
    same = memory is None or memory is MARK
    return MARK, _default(None, view)[1]._replace(say={"same": same})
"""
UNPICKLABLE = """
def policy(memory, view):
    return (lambda: 1), _default(None, view)[1]
"""
DRAWS = """
def policy(memory, view):
    noise = {}
    return memory, _default(None, view)[1]
"""
FRAGILE = """
def policy(memory, view):
    total = sum(packet.say["bid"] for packet in view.heard)
    return memory, _default(None, view)[1]._replace(say={"bid": 1})
"""
TRUSTING = """
def policy(memory, view):
    total = sum(packet.say.get("bid", 0) for packet in view.heard)
    return memory, _default(None, view)[1]._replace(say={"bid": 1})
"""
POISONED = """
def policy(memory, view):
    bids = {**(memory or {}), **{packet.robot: packet.say.get("bid", 0) for packet in view.heard}}
    total = sum(bids.values())
    return bids, _default(None, view)[1]._replace(say={"bid": 1})
"""
INDEXED = """
def policy(memory, view):
    for packet in view.heard:
        view.team.index(packet.say.get("who", "r1"))
    return memory, _default(None, view)[1]._replace(say={"who": view.robot})
"""
POINTED = """
def policy(memory, view):
    steps = sum(peer.packet.xi for peer in view.peers if peer.packet)
    return memory, _default(None, view)[1]._replace(xi=1.0)
"""
ALL_HEARD = """
def policy(memory, view):
    total = sum(x for peer in view.peers for x in peer.packet.position) if view.seen == () else 0
    return memory, _default(None, view)[1]
"""
NO_TARGET = """
def policy(memory, view):
    x, y = view.target.position
    return memory, Decision("go", (x, y), (x, y))
"""
NO_MEMORY = """
def policy(memory, view):
    count = memory["count"]
    return {"count": count + 1}, _default(None, view)[1]
"""
LONELY = """
def policy(memory, view):
    nearest = min(peer.age_ticks for peer in view.peers)
    return memory, _default(None, view)[1]
"""
NOT_A_NUMBER = """
def policy(memory, view):
    return memory, Decision("go", (float("nan"), 0.0), (0.0, 0.0))
"""
LARGE = """
def policy(memory, view):
    return memory, _default(None, view)[1]._replace(say={"all": [0.1 * k for k in range(100)] * 2})
"""
GROWING = """
def policy(memory, view):
    said = {robot: [1.0] * 12 for robot in view.team}
    return memory, _default(None, view)[1]._replace(say=said)
"""
ARRAY = """
def policy(memory, view):
    return memory, _default(None, view)[1]._replace(say={"at": np.zeros(2)})
"""
ONLY_ONCE = """
asked = set()


def policy(memory, view):
    key = (view.tick, view.robot, view.position, view.heard)
    if view.tick > 5:
        if key in asked:
            raise KeyError("asked before")
        asked.add(key)
    return memory, _default(None, view)[1]
"""
RAISES_ELSEWHERE = """
import multiprocessing


def policy(memory, view):
    if multiprocessing.parent_process() is not None:
        raise LookupError("not at home")
    return memory, _default(None, view)[1]
"""
ENDS_ELSEWHERE = RAISES_ELSEWHERE.replace(
    'raise LookupError("not at home")', "multiprocessing.process.os._exit(3)"
)
ENDLESS = """
def policy(memory, view):
    while True:
        pass
"""


def returning(text):
    return f"\ndef policy(memory, view):\n    return {text}\n"


def drawing(text):
    return DRAWS.replace("{}", text)


OF_A_TARGET = """
def policy(memory, view):
    return memory, (0.5 * view.step_m_max, 0.0)
"""
EXIT = ("decisions", "raises SystemExit: enough", "view.peers")
OWN_ERROR = """
class Own(BaseException):
    pass


def policy(memory, view):
    raise Own("mine")
"""
MISTAKES = {
    "decision alone": (
        returning("_default(None, view)[1]"),
        "decisions",
        "answers",
        "Decision alone",
    ),
    "nothing returned": (returning("None"), "decisions", "answers None", "without a return"),
    "exit": ('\ndef policy(memory, view):\n    raise SystemExit("enough")\n', *EXIT),
    "error of its own": (OWN_ERROR, "decisions", "raises Own: mine", "view.peers"),
    "swapped": (
        returning("_default(None, view)[::-1]"),
        "decisions",
        "answers",
        "memory comes first",
    ),
    "not a number": (NOT_A_NUMBER, "decisions", "step = (nan, 0.0)", "(x, y) in m"),
    "too large": (LARGE, "decisions", "at most 1024 bytes", "say less"),
    "too large in a large team": (GROWING, "decisions", "(large team)", "say less"),
    "array said": (ARRAY, "decisions", "say.at"[:3], "arrays as lists"),
    "endless": (ENDLESS, "decisions", "no answer after", "limit"),
    "view assigned": (
        VIEW_ASSIGNED,
        "decisions",
        "AttributeError",
        "make new values",
    ),
    "no target": (NO_TARGET, "no target", "line 11", "view.search"),
    "no memory": (NO_MEMORY, "decisions", "line 11", "memory is None at first"),
    "of a target": (OF_A_TARGET, "decisions", "'step_m_max'", "looks like a target behaviour"),
    "lonely": (LONELY, "decisions", "min() arg", "view.peers may be empty"),
    "memory changed": (MUTATING, "inputs", "changes the memory", "{**memory"),
    "view changed": (VIEW_CHANGED, "inputs", "changes the view", "returns as memory"),
    "global": (GLOBAL, "same answer", "asked twice", "count of its module"),
    "default argument": (IN_DEFAULT, "same answer", "asked twice", "policy of its module"),
    "first asked": (FIRST_ASKED, "order", "the last robot first", "no global"),
    "hashes": (HASHES, "fresh process", "decides something else", "sort them"),
    "identity": (IDENTITY, "memory", "decides something else once its memory", "not which object"),
    "unpicklable": (UNPICKLABLE, "memory", "cannot be pickled", "plain values"),
    "clock": (drawing("time.time()"), "outside", "time.time (my_robots.py, line 11)", "view.tick"),
    "now": (
        drawing("datetime.now()"),
        "outside",
        "datetime.now (my_robots.py, line 11)",
        "view.tick",
    ),
    "random": (
        drawing("random.random()"),
        "outside",
        "generator (my_robots.py, line 11)",
        "default_rng",
    ),
    "randint": (
        drawing("random.randint(1, 6)"),
        "outside",
        "generator (my_robots.py, line 11)",
        "default_rng",
    ),
    "numpy": (
        drawing("np.random.normal()"),
        "outside",
        "generator (my_robots.py, line 11)",
        "default_rng",
    ),
    "unseeded": (
        drawing("np.random.default_rng()"),
        "outside",
        "os.urandom (my_robots.py, line 11)",
        "",
    ),
    "unseeded too": (
        drawing("random.Random()"),
        "outside",
        "from outside (my_robots.py, line 11)",
        "",
    ),
    "uuid": (
        drawing("uuid.uuid4()"),
        "outside",
        "os.urandom (my_robots.py, line 11)",
        "default_rng",
    ),
    "file": (
        drawing("open(__file__).close()"),
        "outside",
        "opens a file (my_robots.py, line 11)",
        "",
    ),
    "socket": (
        drawing("__import__('socket').socket().close()"),
        "outside",
        "opens a socket",
        "say",
    ),
    "sleep": (drawing("time.sleep(0)"), "outside", "time.sleep (my_robots.py, line 11)", "tick"),
    "environment": (drawing("__import__('os').environ.get('HOME')"), "outside", "environment", ""),
    "only once": (ONLY_ONCE, "same answer", "asked again, it raises KeyError", "no global"),
    "raises elsewhere": (
        RAISES_ELSEWHERE,
        "fresh process",
        "LookupError: not at home",
        "no global",
    ),
    "ends elsewhere": (ENDS_ELSEWHERE, "fresh process", "it ends the process", "no global"),
    "fragile": (FRAGILE, "strangers", "KeyError: 'bid' (my_robots.py, line 11)", ".get()"),
    "trusting": (TRUSTING, "strangers", "TypeError", ".get()"),
    "poisoned": (POISONED, "strangers", "TypeError", ".get()"),
    "indexed": (INDEXED, "strangers", "ValueError", ".get()"),
    "intents": (POINTED, "strangers", "TypeError", "any mode, xi and point"),
    "all heard": (ALL_HEARD, "strangers", "AttributeError", "peer.packet is None"),
}


@pytest.fixture
def fresh_workers(monkeypatch):
    """Workers of pools are interpreters of their own, as outside tests: each has its own hashes."""
    monkeypatch.setattr("encircle.runner.process_pool.get_context", multiprocessing.get_context)


@pytest.fixture
def results_of(tmp_path, fresh_workers, monkeypatch):
    """What the checks say of a policy in a file."""
    monkeypatch.chdir(tmp_path)

    def results(text, *own):
        (tmp_path / "my_robots.py").write_text(HEAD + text)
        return list(examined("my_robots.py:policy", own))

    return results


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_found_and_explained(mistake, results_of, monkeypatch):
    text, check, said, advice = MISTAKES[mistake]
    monkeypatch.setattr(scenes, "ANSWER_S_MAX", 2.0)
    if check not in ("fresh process", "order"):
        # Processes take longer than all the rest.
        monkeypatch.setattr(purity, "check_processes", lambda _subject, _parts: [])
    wrong = {result.check: result for result in results_of(text) if result.level == "wrong"}
    assert check in wrong
    assert said in wrong[check].said
    assert advice in wrong[check].advice


def test_a_policy_without_mistakes_passes(results_of):
    results = results_of(GOOD, "weight=0.25")
    assert [result for result in results if result.level == "wrong"] == []


def test_the_example_of_the_page_passes(tmp_path, fresh_workers, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "policies.md").read_text()
    (tmp_path / "my_robots.py").write_text(page.split("```python\n")[1].split("```")[0])
    results = list(examined("my_robots.py:head_for_it", ["share=0.5"]))
    assert [result for result in results if result.level == "wrong"] == []


@pytest.mark.parametrize("name", SHIPPED_POLICIES)
def test_every_shipped_policy_passes(name, fresh_workers, monkeypatch):
    # This process has a seed of its own.
    monkeypatch.setattr(purity, "HASH_SEEDS", ("1",))
    results = list(examined(name))
    assert [result for result in results if result.level == "wrong"] == []


def test_a_decision_that_hides_in_a_rare_branch_is_still_seen_by_its_scene(results_of):
    text = GOOD.replace(
        "noise = ", "early = view.tick >= 15 and len(view.team) == 10 and 1 / 0\n    noise = "
    )
    wrongs = [result for result in results_of(text) if result.level == "wrong"]
    assert [wrong.check for wrong in wrongs] == ["decisions"], wrongs

    assert "(large team): it raises ZeroDivisionError" in wrongs[0].said
