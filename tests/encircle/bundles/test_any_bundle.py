"""Whatever a stranger's bundle has in it, reading it ends with findings or with one error."""

import json
import random

import pytest
from helpers_bundles import members_of, run_here, with_hashes, written
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.bundles import report_checks, reruns
from encircle.bundles.bundle_file import MANIFEST, NUMBERS, PLAN, REPORT, TABLE, BundleError
from encircle.bundles.findings import Verification
from encircle.bundles.verifying import verify

VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["../x.py:f", "inf", "os.py:system", [], {}, [[]], {"file": "/dev/zero"}]),
)


@pytest.fixture(scope="session")
def members(recorded_bundle):
    return members_of(recorded_bundle)


@pytest.fixture(autouse=True)
def nothing_is_drawn(monkeypatch, members):
    """The report is that of the unaltered bundle: what is compared with it is the stranger's."""
    report = {name: content for name, content in members.items() if name.startswith("report/")}
    monkeypatch.setattr(report_checks, "report_members", lambda _plan, _table: dict(report))
    monkeypatch.setattr(reruns.pool, "in_processes", run_here)


def outcome_of(path):
    """What verifying finds, or the error that is told in one line."""
    try:
        return verify(path, 1, 1)
    except BundleError as error:
        return str(error)


def leaves(tree, path=()):
    """The paths of all values in a tree, tables and lists too."""
    yield path
    if isinstance(tree, dict | list):
        for key in tree if isinstance(tree, dict) else range(len(tree)):
            yield from leaves(tree[key], (*path, key))


def replaced(tree, path, value):
    """A copy of a tree with one value replaced."""
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = replaced(tree[path[0]], path[1:], value)
    return copy


@settings(max_examples=60)
@given(st.sampled_from([MANIFEST, PLAN, NUMBERS]), st.integers(0, 2**32), VALUES)
def test_any_value_anywhere_in_the_trees(members, tmp_path_factory, name, draw, value):
    tree = json.loads(members[name])
    paths = list(leaves(tree))
    altered = dict(members)
    content = json.dumps(replaced(tree, paths[draw % len(paths)], value)).encode()
    altered[name] = content
    if name != MANIFEST:
        altered = with_hashes(altered)
    folder = tmp_path_factory.mktemp("any")
    assert isinstance(outcome_of(written(altered, folder / "b.zip")), Verification | str)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("name", [PLAN, TABLE, NUMBERS, REPORT, "recording", "figure"])
def test_any_bytes_anywhere_in_a_member(members, tmp_path, name, seed):
    ending = {"recording": ".mcap", "figure": ".png"}.get(name, name)
    name = next(n for n in members if n.endswith(ending))
    draw = random.Random(seed)
    content = bytearray(members[name])
    for _ in range(draw.choice([1, 3, 30])):
        at = draw.randrange(len(content))
        if draw.random() < 0.3:
            del content[at : at + draw.randrange(1, 20)]
        else:
            content[at] = draw.randrange(256)
    altered = with_hashes({**members, name: bytes(content)})
    outcome = outcome_of(written(altered, tmp_path / "b.zip"))
    # What is written in many ways, as numbers and pictures are, may still be the same.
    assert isinstance(outcome, Verification)


@pytest.mark.parametrize("seed", range(30))
def test_any_bytes_anywhere_in_the_file(members, tmp_path, seed):
    draw = random.Random(seed)
    path = written(members, tmp_path / "b.zip")
    content = bytearray(path.read_bytes())
    # Where the zip says what is in it.
    for _ in range(3):
        content[-draw.randrange(1, 1500)] = draw.randrange(256)
    path.write_bytes(content)
    assert isinstance(outcome_of(path), Verification | str)
