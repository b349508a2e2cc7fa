"""The shipped policies by name, each imported when it is named; then plug-ins, then files."""

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any

from encircle.agents.policies.interface import Policy
from encircle.protocol.plugin_files import FileProblem, check_digest, is_in_file, source_digest
from encircle.protocol.plugins import SHIPPED_POLICIES, STRATEGIES, PluginLoadError, Registry

REGISTRY = Registry(STRATEGIES, SHIPPED_POLICIES)


def policy_named(
    name: str, parameters: Mapping[str, Any] | None = None, source: str = ""
) -> Policy:
    """The policy of that name with its own parameters set; errors as of ``Registry.named``.

    ``source``: the SHA-256 of the file that it must be in, any if empty; ``PluginLoadError`` if it
    is in another one.
    """
    if is_in_file(name):
        # Of a file there may be another version by now: it is imported anew.
        policy = REGISTRY.named(name, source)
    else:
        policy, here = _installed(name)
        try:
            check_digest(here, source)
        except FileProblem as error:
            raise PluginLoadError(str(error)) from None
    return partial(policy, **parameters) if parameters else policy


@lru_cache(maxsize=64)
def _installed(name: str) -> tuple[Policy, str]:
    """The policy, which stays as it is once imported, and the digest of its source at that time."""
    policy: Policy = REGISTRY.named(name)
    return policy, "" if name in SHIPPED_POLICIES else source_digest(policy)
