"""Recorded traces in a bundle, and that no other file is opened for a plan."""

import json
import os

import pytest
from helpers_bundles import TREE, members_of, packed, study_of, verified, with_hashes, written

from encircle.bundles.bundle_file import MANIFEST, PLAN, BundleError
from encircle.bundles.bundle_plan import read_plan


@pytest.fixture(scope="session")
def traced_bundle(tmp_path_factory):
    """A study of two traces, whose files are then taken away."""
    folder = tmp_path_factory.mktemp("traced")
    files = [folder / "good.csv", folder / "bad.csv"]
    for k, file in enumerate(files):
        file.write_text("lost\n" + "0\n" * 5 + f"{k}\n" * 5)
    tree = {
        **TREE,
        "name": "traced",
        "seeds": 2,
        "set": {**TREE["set"], "channel.loss.model": "trace"},
        "axes": [{"name": "file", "key": "channel.loss.file", "values": [*map(str, files)]}],
    }
    del tree["compare"]
    bundle = packed(study_of(folder, tree), folder / "traced.zip")
    for file in files:
        file.unlink()
    return bundle


def test_traces_are_taken_from_the_bundle(traced_bundle, monkeypatch):
    members = members_of(traced_bundle)
    assert sum(name.startswith("traces/") for name in members) == 2
    found = verified(traced_bundle, monkeypatch, None)
    assert found.differences == []
    assert found.numbers["rows"]["rerun"] == 4


def test_a_trace_that_was_altered_and_covered_up_gives_other_runs(
    traced_bundle, monkeypatch, tmp_path
):
    members = members_of(traced_bundle)
    name = next(n for n in members if n.startswith("traces/") and b"1" in members[n])
    members[name] = members[name].replace(b"1", b"0")
    found = verified(written(with_hashes(members), tmp_path / "b.zip"), monkeypatch, None)
    assert {one.what for one in found.differences} >= {"traces", "fingerprint", "digest"}


def test_a_plan_opens_no_file_of_the_readers(traced_bundle, monkeypatch, tmp_path):
    """One that nobody writes to would never end."""
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    members = members_of(traced_bundle)
    tree = json.loads(members[PLAN])
    tree["axes"][0]["values"][0] = str(pipe)
    members[PLAN] = json.dumps(tree).encode()
    with pytest.raises(BundleError, match="is not in the bundle"):
        read_plan(members[PLAN], {})
    found = verified(written(with_hashes(members), tmp_path / "b.zip"), monkeypatch)
    assert any("is not in the bundle" in one.given for one in found.differences)


@pytest.mark.parametrize("member", ["plan.json", "traces/0123456789abcdef.csv", 3])
def test_a_trace_is_a_member_for_traces(traced_bundle, monkeypatch, tmp_path, member):
    members = members_of(traced_bundle)
    tree = json.loads(members[MANIFEST])
    tree["traces"] = dict.fromkeys(tree["traces"], member)
    members[MANIFEST] = json.dumps(tree).encode()
    found = verified(written(members, tmp_path / "b.zip"), monkeypatch)
    assert any("traces" in one.given for one in found.differences)


def test_a_scenario_is_a_table_and_not_the_name_of_a_file(traced_bundle):
    tree = json.loads(members_of(traced_bundle)[PLAN])
    with pytest.raises(BundleError, match="scenario = 'sim1': must be a table"):
        read_plan(json.dumps({**tree, "scenario": "sim1"}).encode(), {})


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"seeds": 10**6}, "a bundle can have"),
        (
            {
                "axes": [
                    {
                        "name": "a",
                        "key": "ticks_max",
                        "range": {"first": 1, "last": 2, "count": 10**6},
                    }
                ]
            },
            "axes",
        ),
        ({"seeds": 0}, "seeds"),
        ({"more": 1}, "more"),
        ({"compare": "nothing"}, "compare"),
        ({"set": {"ticks_max": -1}}, "ticks_max"),
    ],
)
def test_what_no_plan_can_be_is_refused(traced_bundle, change, match):
    tree = json.loads(members_of(traced_bundle)[PLAN])
    with pytest.raises(BundleError, match=match):
        read_plan(json.dumps({**tree, "axes": [], **change}).encode(), {})
