"""Options of every command, and for those that run one node the same as environment variables.

A container or a service manager passes settings by environment, a person by command line; the
command line wins. The variable of ``--join-timeout`` is ``ENCIRCLE_JOIN_TIMEOUT``, and so on. An
empty variable counts as absent, since that is how compose files leave things out.

The parser is the standard library's, in every command. Typer was tried: it needs pydantic to read a
text, and with that a robot started by hand takes 18 % longer to start and 9 MiB more memory.
"""

import argparse
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from encircle.protocol.errors import did_you_mean
from encircle.protocol.plugin_files import FOLDERS
from encircle.protocol.process.log import printable
from encircle.protocol.programs.option_values import yes_or_no

if TYPE_CHECKING:
    from encircle.protocol.zenoh.endpoints import Endpoints, Identity, Mode

PREFIX = "ENCIRCLE_"
GATES = ("router", "world")
EPILOG = "An environment variable in brackets stands in for an option that is left out."


class _Setting(NamedTuple):
    name: str
    variable: str
    """Empty if the environment has no say."""
    read: Callable[[str], Any]
    default: Any
    required: bool
    joins: bool
    missing: str
    """What is said when it is required and missing."""
    distinct: bool


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; ``--help`` has the rest."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {printable(message)}\n")


class Options:
    """The options of one command.

    ``program``: its name in help and errors; ``description``: what its help says first;
    ``environment``: whether each option has a variable, unless it is given one of its own.
    """

    def __init__(self, program: str, description: str, environment: bool = True) -> None:
        self._parser = _Parser(
            prog=program,
            description=description,
            epilog=EPILOG if environment else None,
            allow_abbrev=False,
        )
        self._environment = environment
        self._settings: list[_Setting] = []
        self._assignment = ""
        """The option that takes NAME=VALUE, as its help shows it; empty if there is none."""

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
        is_option = name.startswith("--")
        missing = f"{name} is missing" if is_option else f"{metavar or name} is missing ({text})"
        setting = self._keep(name, read, default, required, variable=variable, missing=missing)
        self._parser.add_argument(
            name,
            help=_help(text, setting.variable),
            metavar=metavar,
            type=read,
            # Whether it is missing is known only when the environment has been looked at.
            nargs=None if is_option else "?",
        )

    def add_names(self, name: str, text: str, *, read: Callable[[str], str], variable: str) -> None:
        """A positional argument of one or more names, each once; in its variable, apart by spaces.

        ``read``: reads one of them.
        """

        def read_all(value: str) -> list[str]:
            return [read(part) for part in re.split(r"[,\s]+", value) if part]

        missing = f"{name} is missing ({text})"
        self._keep(name, read_all, None, True, variable=variable, missing=missing, distinct=True)
        self._parser.add_argument(name, help=_help(text, variable), type=read, nargs="*")

    def add_list(
        self,
        name: str,
        text: str,
        *,
        metavar: str,
        separators: str = "",
        joins: bool = False,
    ) -> None:
        """An option that may be given several times; in its variable, apart by ``separators``.

        ``joins``: the command line adds to what the environment says instead of replacing it.
        """

        def read(value: str) -> list[str]:
            parts = (part.strip() for part in re.split(f"[{separators}]", value))
            return [part for part in parts if part]

        if "=" in metavar:
            self._assignment = f'{name} "{metavar}"'
        setting = self._keep(name, read, [], joins=joins)
        self._parser.add_argument(
            name, help=_help(text, setting.variable), metavar=metavar, action="append"
        )

    def add_flag(self, name: str, text: str) -> None:
        """An option without a value; in its variable, yes or no."""
        setting = self._keep(name, yes_or_no, False)
        self._parser.add_argument(
            name, help=_help(text, setting.variable, "=yes"), action="store_const", const=True
        )

    def add_endpoints(self) -> None:
        """The options that ``endpoints_of`` reads."""
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
            "directory with this node's certificate and key, as encircle certificates makes them",
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
        """All settings; ends the process with status 2 and one clear line if one is wrong.

        ``arguments``: by default those of this process, as is ``environment``. Ends it with status
        0 after ``--help``.
        """
        environment = os.environ if environment is None else environment
        settings, unknown = self._parser.parse_known_args(arguments)
        if unknown:
            self._refuse(unknown)
        for setting in self._settings:
            key = _key(setting.name)
            given, inherited = getattr(settings, key), self._inherited(environment, setting)
            if given is None or (setting.distinct and not given):
                given = setting.default if inherited is None else inherited
            elif setting.joins:
                given = [*(inherited or []), *given]
            if given is None and setting.required:
                way = f"give it, or set {setting.variable}" if setting.variable else "give it"
                self.error(f"{setting.missing}: {way}")
            if setting.distinct:
                self._check_distinct(given)
            setattr(settings, key, given)
        return settings

    def error(self, message: str) -> NoReturn:
        """End the process with status 2 and this message."""
        self._parser.error(message)

    def _check_distinct(self, names: Sequence[str]) -> None:
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            self.error(f"{twice} is named twice")

    def _refuse(self, unknown: Sequence[str]) -> NoReturn:
        """Name what is not known, and the option that was perhaps meant."""
        names = [setting.name for setting in self._settings if setting.name.startswith("--")]
        option = next((text for text in unknown if text.startswith("-")), None)
        hint = "" if option is None else did_you_mean(option.partition("=")[0], names)
        if option is None and self._assignment and "=" in "".join(unknown):
            # A shell takes a value apart at its spaces and, in braces, at its commas.
            hint = f" (put all of it in quotes: {self._assignment})"
        self.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")

    def _keep(
        self,
        name: str,
        read: Callable[[str], Any],
        default: Any,
        required: bool = False,
        joins: bool = False,
        variable: str = "",
        missing: str = "",
        distinct: bool = False,
    ) -> _Setting:
        variable = variable or (variable_of(name) if self._environment else "")
        given = (name, variable, read, default, required, joins, missing, distinct)
        self._settings.append(_Setting(*given))
        return self._settings[-1]

    def _inherited(self, environment: Mapping[str, str], setting: _Setting) -> Any:
        """The value that the environment has for a setting, or None."""
        value = environment.get(setting.variable, "").strip() if setting.variable else ""
        if not value:
            return None
        try:
            return setting.read(value)
        except argparse.ArgumentTypeError as error:
            self.error(f"{setting.variable}: {error}")


def without_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment for processes that get everything by their command line.

    The folders in which policies lie are no option: every process looks there for itself.
    """
    return {
        name: value
        for name, value in environment.items()
        if not name.startswith(PREFIX) or name == FOLDERS
    }


def endpoints_of(
    options: argparse.Namespace,
    connect_s_max: float,
    mode: "Mode | None" = None,
    name: str | None = None,
) -> "Endpoints":
    """What the options of ``add_endpoints`` ask for; raises ``ConfigurationError``.

    ``name``: whose certificate to show; without one, that of a viewer.
    """
    # Imported late: commands that run no node need no messages and no codec.
    from encircle.protocol.zenoh.endpoints import ConfigurationError, Endpoints

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


def identity(directory: Path | None, name: str | None) -> "Identity | None":
    """The identity of a node, or of a viewer without a name; raises ``ConfigurationError``."""
    if directory is None:
        return None
    # A node without certificates need not load a library for them.
    from encircle.protocol.zenoh.identities import identity_of, viewer_identity

    return identity_of(directory, name) if name else viewer_identity(directory)


def _help(text: str, variable: str, value: str = "") -> str:
    return f"{text} [{variable}{value}]" if variable else text


def variable_of(name: str) -> str:
    """The environment variable that stands in for an option."""
    return PREFIX + _key(name).upper()


def _key(name: str) -> str:
    return name.lstrip("-").replace("-", "_")
