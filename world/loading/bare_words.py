"""Changes ``key=value`` whose tables and lists have lost the quotes around their texts.

A shell takes quotes away that it is not kept from: ``channel.loss={model='bernoulli'}`` arrives as
``channel.loss={model=bernoulli}``. That is no TOML, and so a plain text like any other.
"""

import re
import shlex
import tomllib

WORD = re.compile(r"(?<=[=,\[])(\s*)([^\W\d][\w.-]*)(?=\s*[,}\]])")
NO_TEXTS = {"true", "false", "inf", "nan"}


def quoted_change(change: str) -> str | None:
    """The change with quotes around its bare words, and around all of it, as a shell needs it.

    None if its value is neither a table nor a list, is right as it is, or would not be right then.
    """
    key, _, text = change.partition("=")
    if text.lstrip()[:1] not in ("{", "[") or _is_toml(text):
        return None
    quoted = WORD.sub(_with_quotes, text)
    if not _is_toml(quoted):
        return None
    whole = f"{key}={quoted}"
    return shlex.quote(whole) if '"' in whole else f'"{whole}"'


def _with_quotes(found: re.Match[str]) -> str:
    space, word = found.groups()
    return f"{space}{word}" if word in NO_TEXTS else f"{space}'{word}'"


def _is_toml(text: str) -> bool:
    try:
        return len(tomllib.loads(f"value = {text}")) == 1
    except tomllib.TOMLDecodeError:
        return False
