"""Options of the commands that run one node, each also as an environment variable.

A container or a service manager passes settings by environment, a person by command line; the
command line wins. The variable of ``--join-timeout`` is ``ENCIRCLE_JOIN_TIMEOUT``, and so on. An
empty variable counts as absent, since that is how compose files leave things out.

Typer reads the command line and writes the help. The environment is read here, because Typer splits
a list at spaces alone, takes a blank variable for a value, and cannot add one source to the other.
"""

import inspect
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple, NoReturn

from encircle.protocol.keys import check_name
from encircle.protocol.process.log import say_error
from encircle.protocol.zenoh.endpoints import ConfigurationError, Endpoints, Identity, Mode

PREFIX = "ENCIRCLE_"
GATES = ("router", "world")
YES, NO = ("1", "yes", "true", "on"), ("0", "no", "false", "off")
S_MAX = 86_400.0


Settings = SimpleNamespace
"""The values of all options of a command, each under its name with underscores."""


class InvalidOption(ValueError):
    """A value that an option does not take; the text says what is wrong with it."""


class _Setting(NamedTuple):
    name: str
    text: str
    variable: str
    metavar: str
    read: Callable[[str], Any]
    default: Any = None
    required: bool = False
    separators: str = ""
    joins: bool = False
    flag: bool = False


class Options:
    """The options of one command.

    ``program``: its name in help and errors; ``description``: the first sentence of its help.
    """

    def __init__(self, program: str, description: str) -> None:
        self._program = program
        self._description = description
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
        """An option ``--name``, or a positional argument if ``name`` has no dashes.

        ``read`` makes the value of its text, and raises ``InvalidOption`` if it cannot.
        """
        self._settings.append(
            _Setting(
                name,
                text,
                variable or variable_of(name),
                metavar or _key(name).upper(),
                read,
                default,
                required,
            )
        )

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
        self._settings.append(
            _Setting(
                name,
                text,
                variable_of(name),
                metavar,
                str,
                separators=separators,
                joins=joins,
            )
        )

    def add_flag(self, name: str, text: str) -> None:
        """An option without a value; in its variable, yes or no."""
        self._settings.append(
            _Setting(name, text, variable_of(name), "", _yes_or_no, default=False, flag=True)
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
    ) -> Settings:
        """All settings; ends the process with status 2 and one clear line if one is wrong.

        ``arguments``: by default those of this process, as is ``environment``. Ends it with status
        0 after ``--help``.
        """
        environment = os.environ if environment is None else environment
        given = self._command_line(arguments)
        return Settings(
            **{
                _key(setting.name): self._value(setting, given[_key(setting.name)], environment)
                for setting in self._settings
            }
        )

    def error(self, message: str) -> NoReturn:
        """End the process with status 2 and this message."""
        say_error(f"{self._program}: error: {message}")
        raise SystemExit(2)

    def _command_line(self, arguments: Sequence[str] | None) -> dict[str, Any]:
        """The texts that are given on the command line; None for what is left out."""
        # Imported late: who only starts nodes uses this module too, and reads no command line.
        import typer

        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        given: dict[str, Any] = {}

        def command(**values: Any) -> None:
            given.update(values)

        parameters = [_parameter(setting) for setting in self._settings]
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {p.name: p.annotation for p in parameters}
        app.command(
            help=self._description,
            epilog="An environment variable in brackets stands in for an option that is left out.",
            context_settings={"help_option_names": ["-h", "--help"]},
        )(command)
        try:
            typer.main.get_command(app).main(
                None if arguments is None else list(arguments),
                prog_name=self._program,
                standalone_mode=False,
            )
        except typer.TyperException as error:
            self.error(error.format_message())
        if not given:
            raise SystemExit(0)
        return given

    def _value(self, setting: _Setting, given: Any, environment: Mapping[str, str]) -> Any:
        """The value of one setting; the command line wins, or is added to the environment."""
        text = environment.get(setting.variable, "").strip()
        if setting.separators:
            inherited = re.split(f"[{setting.separators}]", text)
            values = [] if given and not setting.joins else [v.strip() for v in inherited]
            return [*filter(None, values), *(given or [])]
        if setting.flag and given:
            return True
        source = f"argument {setting.name}" if given is not None else setting.variable
        try:
            if given is not None:
                return setting.read(given)
            if text:
                return setting.read(text)
        except InvalidOption as error:
            self.error(f"{source}: {error}")
        if setting.required:
            self.error(f"{setting.name} is missing: give it, or set {setting.variable}")
        return setting.default


def _parameter(setting: _Setting) -> inspect.Parameter:
    """A parameter of a function, from which Typer makes an option or an argument."""
    import typer

    value = "=yes" if setting.flag else ""
    text = f"{setting.text} [{setting.variable}{value}]"
    positional = not setting.name.startswith("--")
    kind: Any = bool if setting.flag else list[str] if setting.separators else str
    # Whether it is missing is known only when the environment has been looked at.
    declared = (
        typer.Argument(help=text, metavar=setting.metavar or None, show_default=False)
        if positional
        else typer.Option(
            setting.name, help=text, metavar=setting.metavar or None, show_default=False
        )
    )
    return inspect.Parameter(
        _key(setting.name),
        inspect.Parameter.KEYWORD_ONLY,
        default=None,
        annotation=Annotated[kind | None, declared],
    )


def without_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment for processes that get everything by their command line."""
    return {name: value for name, value in environment.items() if not name.startswith(PREFIX)}


def endpoints_of(
    options: Settings,
    connect_s_max: float,
    mode: Mode | None = None,
    name: str | None = None,
) -> Endpoints:
    """What the options of ``add_endpoints`` ask for; raises ``ConfigurationError``.

    ``name``: whose certificate to show; without one, that of a viewer.
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
    """The identity of a node, or of a viewer without a name; raises ``ConfigurationError``."""
    if directory is None:
        return None
    # A node without certificates need not load a library for them.
    from encircle.protocol.zenoh.identities import identity_of, viewer_identity

    return identity_of(directory, name) if name else viewer_identity(directory)


def seconds(value: str) -> float:
    """A length of time of an option, in s."""
    try:
        length_s = float(value)
    except ValueError:
        length_s = math.nan
    if not 0.0 < length_s <= S_MAX:
        raise InvalidOption(f"{value!r} is not a number of seconds up to {S_MAX:g}")
    return length_s


def whole_number(value: str) -> int:
    """A whole number as an option, of either sign."""
    try:
        return int(value)
    except ValueError:
        raise InvalidOption(f"{value!r} is not a whole number") from None


def name_of(kind: str) -> Callable[[str], str]:
    """A reader of the name of a run or a robot."""

    def read(value: str) -> str:
        try:
            return check_name(kind, value)
        except ValueError as error:
            raise InvalidOption(str(error)) from None

    return read


def _yes_or_no(value: str) -> bool:
    if value.lower() not in (*YES, *NO):
        raise InvalidOption(f"{value!r} is not one of {', '.join((*YES, *NO))}")
    return value.lower() in YES


def variable_of(name: str) -> str:
    """The environment variable that stands in for an option."""
    return PREFIX + _key(name).upper()


def _key(name: str) -> str:
    return name.lstrip("-").replace("-", "_")
