"""The manifest of a bundle: what it is of, what made it, and the hash of every member.

All of it follows from the other members, but for which versions drew the figures and how the
recordings were sampled; whoever verifies makes it again and compares.
"""

import json
from collections.abc import Mapping
from typing import Any

from encircle.bundles.bundle_file import MANIFEST, BundleError, Members, NotABundle, sha256
from encircle.studies.plan import Plan

FORMAT, VERSION = "encircle-bundle", 1
GIVEN = ("drawn_with", "sample", "policies", "traces")
"""Keys that say what does not follow from the other members."""


def manifest(
    plan: Plan,
    code: str,
    versions: Mapping[str, str],
    members: Members,
    given: Mapping[str, Any],
) -> dict[str, Any]:
    """The manifest of members; ``given``: the keys of ``GIVEN``."""
    return {
        "format": FORMAT,
        "format_version": VERSION,
        "study": plan.name,
        "fingerprint": plan.fingerprint,
        "code": code,
        "versions": dict(versions),
        "cells": len(plan.cells),
        "seeds": len(plan.seed_list),
        "runs": plan.runs,
        **{key: given[key] for key in GIVEN},
        "members": {
            name: {"bytes": len(content), "sha256": sha256(content)}
            for name, content in sorted(members.items())
            if name != MANIFEST
        },
    }


def manifest_bytes(tree: Mapping[str, Any]) -> bytes:
    """A manifest as it stands in a bundle."""
    return (json.dumps(tree, indent=1, sort_keys=True) + "\n").encode()


def read_manifest(content: bytes) -> dict[str, Any]:
    """The manifest of a bundle; ``BundleError`` if it is of another format or has other keys."""
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{MANIFEST} cannot be read: {error}") from None
    if not isinstance(tree, dict) or tree.get("format") != FORMAT:
        raise NotABundle(f"{MANIFEST}: format must be {FORMAT!r}, so it is no bundle")
    if tree.get("format_version") != VERSION:
        found = tree.get("format_version")
        raise NotABundle(f"{MANIFEST}: format_version = {found!r}: this program reads {VERSION}")
    for key, kind in (("sample", dict), ("traces", dict), ("policies", list), ("drawn_with", dict)):
        if not isinstance(tree.get(key), kind):
            raise BundleError(f"{MANIFEST}: {key} = {tree.get(key)!r}: must be a {kind.__name__}")
    return tree
