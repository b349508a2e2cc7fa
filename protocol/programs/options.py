"""Options of the commands that run one party, each also as an environment variable.

A container or a service manager passes settings by environment, a person by command line; the
command line wins. The variable of ``--join-timeout`` is ``ENCIRCLE_JOIN_TIMEOUT``, and so on. An
empty variable counts as absent, since that is how compose files leave things out.
"""

import argparse
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from encircle.protocol.keys import check_name
from encircle.protocol.process.log import printable
from encircle.protocol.zenoh.endpoints import ConfigurationError, Endpoints, Identity, Mode

PREFIX = "ENCIRCLE_"
GATES = ("router", "world")
YES, NO = ("1", "yes", "true", "on"), ("0", "no", "false", "off")
S_MAX = 86_400.0


class _Setting(NamedTuple):
    name: str
    variable: str
    read: Callable[[str], Any]
    default: Any
    required: bool
    joins: bool


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; ``--help`` has the rest."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {printable(message)}\n")


class Options:
    """The options of one command."""

    def __init__(self, program: str, description: str) -> None:
        self._parser = _Parser(
            prog=program,
            description=description,
            epilog="An environment variable in brackets stands in for an option that is left out.",
            allow_abbrev=False,
        )
        self._settings: list[_Setting] = []

    def add(
        self,
        name: str,
        text: str,
        *,
        read: Callable[[str], Any] = str,
        default: Any = None,
        required: bool = False,
        variable: str = "",
        metavar: str | None = None,
    ) -> None:
        """An option ``--name``, or a positional argument if ``name`` has no dashes."""
        variable = variable or variable_of(name)
        self._parser.add_argument(
            name,
            help=f"{text} [{variable}]",
            metavar=metavar,
            type=read,
            # Whether it is missing is known only when the environment has been looked at.
            nargs=None if name.startswith("--") else "?",
        )
        self._keep(_Setting(name, variable, read, default, required, joins=False))

    def add_list(
        self,
        name: str,
        text: str,
        *,
        metavar: str,
        separators: str,
        joins: bool = False,
    ) -> None:
        """An option that may be given several times; in its variable, apart by ``separators``.

        ``joins``: the command line adds to what the environment says instead of replacing it.
        """
        self._parser.add_argument(
            name, help=f"{text} [{variable_of(name)}]", metavar=metavar, action="append"
        )

        def read(value: str) -> list[str]:
            parts = (part.strip() for part in re.split(f"[{separators}]", value))
            return [part for part in parts if part]

        self._keep(_Setting(name, variable_of(name), read, [], False, joins))

    def add_flag(self, name: str, text: str) -> None:
        """An option without a value; in its variable, yes or no."""
        help_text = f"{text} [{variable_of(name)}=yes]"
        self._parser.add_argument(name, help=help_text, action="store_const", const=True)
        self._keep(_Setting(name, variable_of(name), _yes_or_no, False, False, joins=False))

    def add_endpoints(self) -> None:
        """The options of ``access``."""
        self.add_list(
            "--connect",
            "connect to this endpoint, as tcp/127.0.0.1:7447; may be repeated",
            metavar="ENDPOINT",
            separators=r",\s",
        )
        self.add_list(
            "--listen",
            "listen on this endpoint; may be repeated",
            metavar="ENDPOINT",
            separators=r",\s",
        )
        self.add(
            "--certificates",
            "directory with this party's certificate and key, as encircle certificates makes them",
            read=Path,
            metavar="DIR",
        )
        self.add(
            "--zenoh-config",
            "a Zenoh configuration file, for all that the options here leave open",
            read=Path,
            metavar="FILE",
        )
        self.add_flag(
            "--without-authentication",
            "allow listening beyond this machine although nothing tells who connects",
        )

    def parse(
        self, arguments: Sequence[str] | None, environment: Mapping[str, str] | None = None
    ) -> argparse.Namespace:
        """All settings; ends the process with status 2 and one clear line if one is wrong."""
        environment = os.environ if environment is None else environment
        found = self._parser.parse_args(arguments)
        for setting in self._settings:
            key = _key(setting.name)
            given, value = getattr(found, key), self._from(environment, setting)
            if given is None:
                given = setting.default if value is None else value
            elif setting.joins:
                given = [*(value or []), *given]
            if given is None and setting.required:
                self.error(f"{setting.name} is missing: give it, or set {setting.variable}")
            setattr(found, key, given)
        return found

    def error(self, message: str) -> NoReturn:
        """End the process with status 2 and this message."""
        self._parser.error(message)

    def _keep(self, setting: _Setting) -> None:
        self._settings.append(setting)

    def _from(self, environment: Mapping[str, str], setting: _Setting) -> Any:
        value = environment.get(setting.variable, "").strip()
        if not value:
            return None
        try:
            return setting.read(value)
        except argparse.ArgumentTypeError as error:
            self.error(f"{setting.variable}: {error}")


def without_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment for processes that are told everything by their command line."""
    return {name: value for name, value in environment.items() if not name.startswith(PREFIX)}


def endpoints_of(
    options: argparse.Namespace,
    connect_s_max: float,
    mode: Mode | None = None,
    name: str | None = None,
) -> Endpoints:
    """What the options of ``add_endpoints`` say; raises ``ConfigurationError``.

    ``name``: whose certificate to show; without one, that of an onlooker.
    """
    if options.certificates and options.listen and name not in (None, *GATES):
        raise ConfigurationError(
            f"listen = {options.listen[0]}: with certificates only {' and '.join(GATES)} listen,"
            f" and {name} connects to them"
        )
    return Endpoints(
        tuple(options.listen),
        tuple(options.connect),
        mode,
        options.zenoh_config,
        options.without_authentication,
        connect_s_max,
        identity(options.certificates, name),
    )


def identity(directory: Path | None, name: str | None) -> Identity | None:
    """The identity of a party, or of an onlooker without a name; raises ``ConfigurationError``."""
    if directory is None:
        return None
    # A party without certificates need not load a library for them.
    from encircle.protocol.zenoh.identities import identity_of, viewer_identity

    return identity_of(directory, name) if name else viewer_identity(directory)


def seconds(value: str) -> float:
    """A length of time of an option, in s."""
    try:
        found = float(value)
    except ValueError:
        found = math.nan
    if not 0.0 < found <= S_MAX:
        raise argparse.ArgumentTypeError(f"{value!r} is not a number of seconds up to {S_MAX:g}")
    return found


def whole_number(value: str) -> int:
    """A whole number as an option, of either sign."""
    try:
        return int(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{value!r} is not a whole number") from None


def name_of(kind: str) -> Callable[[str], str]:
    """A reader of the name of a run or a robot."""

    def read(value: str) -> str:
        try:
            return check_name(kind, value)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


def _yes_or_no(value: str) -> bool:
    if value.lower() not in (*YES, *NO):
        raise argparse.ArgumentTypeError(f"{value!r} is not one of {', '.join((*YES, *NO))}")
    return value.lower() in YES


def variable_of(name: str) -> str:
    """The environment variable that stands in for an option."""
    return PREFIX + _key(name).upper()


def _key(name: str) -> str:
    return name.lstrip("-").replace("-", "_")
