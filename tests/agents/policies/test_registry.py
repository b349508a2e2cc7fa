"""Policies by name: a source that changes after it was imported."""

import hashlib

import helpers_plugins as plugins
import pytest

from encircle.agents.policies.registry import policy_named
from encircle.protocol.plugins import PluginLoadError


def test_what_was_imported_counts_not_what_its_file_has_become(tmp_path, monkeypatch):
    plugins.put_there(tmp_path, {}, ["strategies changing = changing_policy:decide"])
    plugins.make_importable(tmp_path, monkeypatch)
    file = tmp_path / "changing_policy.py"
    digests = []
    for text in ("older", "newer"):
        file.write_text(f"def decide(memory, view):\n    return {text!r}, None\n")
        digests.append(hashlib.sha256(file.read_bytes()).hexdigest())
        if text == "older":
            assert policy_named("changing", None, digests[0])(None, None)[0] == text
    older, newer = digests
    # This process still has the older one.
    assert policy_named("changing", None, older)(None, None)[0] == "older"
    with pytest.raises(PluginLoadError, match=f"SHA-256 {older[:12]}, the world's {newer[:12]}"):
        policy_named("changing", None, newer)
    plugins.forget(tmp_path)
