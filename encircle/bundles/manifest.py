"""The manifest of a bundle: what it is of, what made it, and the hash of every member.

All of it follows from the other members, but for which versions drew the figures and how the
recordings were sampled; whoever verifies makes it again and compares.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from encircle.bundles.bundle_file import MANIFEST, BundleError, Members, NotABundle, sha256
from encircle.strict_json import strict_json
from encircle.studies.plan import Plan

FORMAT, VERSION = "encircle-bundle", 1
DRAWN_WITH = ("matplotlib", "numpy")
VERSION_TEXT = re.compile(r"[0-9A-Za-z.+!_-]{1,40}", re.ASCII)
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
        tree = strict_json(content)
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{MANIFEST} cannot be read: {error}") from None
    if not isinstance(tree, dict) or tree.get("format") != FORMAT:
        raise NotABundle(f"{MANIFEST}: format must be {FORMAT!r}, so it is no bundle")
    found = tree.get("format_version")
    if type(found) is not int or found != VERSION:
        raise NotABundle(f"{MANIFEST}: format_version = {found!r}: this program reads {VERSION}")
    for key, kind in (("sample", dict), ("traces", dict), ("policies", list), ("drawn_with", dict)):
        if not isinstance(tree.get(key), kind):
            raise BundleError(f"{MANIFEST}: {key} = {tree.get(key)!r}: must be a {kind.__name__}")
    drawn_with = tree["drawn_with"]
    if set(drawn_with) != set(DRAWN_WITH) or not all(map(_is_version, drawn_with.values())):
        raise BundleError(
            f"{MANIFEST}: drawn_with = {drawn_with!r:.200}: must be the versions of"
            f" {' and '.join(DRAWN_WITH)}"
        )
    return tree


def _is_version(value: Any) -> bool:
    return isinstance(value, str) and VERSION_TEXT.fullmatch(value) is not None
