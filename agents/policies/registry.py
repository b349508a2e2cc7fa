"""The shipped policies by name, each imported when it is named; then plug-ins, then files."""

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any

from encircle.agents.policies.interface import Policy
from encircle.protocol.plugin_files import is_in_file, source_digest
from encircle.protocol.plugins import SHIPPED_POLICIES, STRATEGIES, PluginLoadError, Registry

REGISTRY = Registry(STRATEGIES, SHIPPED_POLICIES)
SHOWN_DIGITS = 12


def policy_named(
    name: str, parameters: Mapping[str, Any] | None = None, source: str = ""
) -> Policy:
    """The policy of that name with its own parameters set; errors as of ``Registry.named``.

    ``source``: the SHA-256 of the file that it must be in, any if empty; ``PluginLoadError`` if it
    is in another one.
    """
    if is_in_file(name):
        # Of a file there may be another version by now: it is imported anew.
        policy = REGISTRY.named(name)
        here = source_digest(policy) if source else ""
    else:
        policy, here = _installed(name)
    if source and here != source:
        raise PluginLoadError(
            f"its source here has SHA-256 {here[:SHOWN_DIGITS] or 'none'}, the world's"
            f" {source[:SHOWN_DIGITS]}: put the world's file on this host and restart this process"
        )
    return partial(policy, **parameters) if parameters else policy


@lru_cache(maxsize=64)
def _installed(name: str) -> tuple[Policy, str]:
    """The policy, which stays as it is once imported, and the digest of its source at that time."""
    policy: Policy = REGISTRY.named(name)
    return policy, "" if name in SHIPPED_POLICIES else source_digest(policy)
