"""Options by command line and by environment, and which of them wins."""

import argparse

import pytest

from encircle.network.certificates import make_certificates
from encircle.protocol.programs.option_values import name_of, seconds, whole_number
from encircle.protocol.programs.options import (
    Options,
    endpoints_of,
    without_settings,
)
from encircle.protocol.zenoh.access_control import identity_in
from encircle.protocol.zenoh.endpoints import ConfigurationError, Endpoints

CERTIFICATES = "ENCIRCLE_CERTIFICATES"


@pytest.fixture
def options():
    made = Options("encircle thing", "Do a thing.")
    made.add("id", "who", variable="ENCIRCLE_ROBOT", read=name_of("robot"), required=True)
    made.add("--run", "which", read=name_of("run"), required=True)
    made.add("--join-timeout", "how long", read=seconds, default=30.0)
    made.add("--seed", "what chance", read=whole_number)
    made.add_list("--set", "what else", metavar="KEY=VALUE", separators=r";\n", joins=True)
    made.add_flag("--stay", "whether to stay")
    made.add_endpoints()
    return made


ALL = {
    "ENCIRCLE_ROBOT": "r2",
    "ENCIRCLE_RUN": "demo",
    "ENCIRCLE_JOIN_TIMEOUT": "2.5",
    "ENCIRCLE_SEED": "-7",
    "ENCIRCLE_SET": "a=1; b={c=2, d=3}\n e=4",
    "ENCIRCLE_STAY": "yes",
    "ENCIRCLE_CONNECT": "tcp/127.0.0.1:1, tcp/127.0.0.1:2",
    "ENCIRCLE_LISTEN": "tcp/127.0.0.1:3 tcp/127.0.0.1:4",
    "ENCIRCLE_WITHOUT_AUTHENTICATION": "true",
}


def test_everything_can_come_from_the_environment(options):
    found = options.parse([], ALL)
    assert (found.id, found.run, found.join_timeout, found.seed) == ("r2", "demo", 2.5, -7)
    assert found.set == ["a=1", "b={c=2, d=3}", "e=4"]
    assert found.stay is True
    assert endpoints_of(found, 5.0) == Endpoints(
        ("tcp/127.0.0.1:3", "tcp/127.0.0.1:4"),
        ("tcp/127.0.0.1:1", "tcp/127.0.0.1:2"),
        without_authentication=True,
        connect_s_max=5.0,
    )


def test_the_command_line_wins(options):
    line = ["r9", "--run", "other", "--join-timeout", "9", "--connect", "tcp/127.0.0.1:9"]
    found = options.parse([*line, "--set", "e=5"], ALL)
    assert (found.id, found.run, found.join_timeout, found.seed) == ("r9", "other", 9.0, -7)
    assert found.connect == ["tcp/127.0.0.1:9"]
    # Changes of a scenario are made one after the other: the last one counts.
    assert found.set == ["a=1", "b={c=2, d=3}", "e=4", "e=5"]


def test_an_empty_variable_is_an_absent_one(options):
    found = options.parse(["r1", "--run", "demo"], dict.fromkeys(ALL, " "))
    assert (found.join_timeout, found.seed, found.stay) == (30.0, None, False)
    assert found.set == found.connect == found.listen == []


@pytest.mark.parametrize(
    ("arguments", "environment", "said"),
    [
        ([], {"ENCIRCLE_RUN": "demo"}, "id is missing (who): give it, or set ENCIRCLE_ROBOT"),
        (["r1"], {}, "--run is missing: give it, or set ENCIRCLE_RUN"),
        (["r1"], {"ENCIRCLE_RUN": "a/b"}, "ENCIRCLE_RUN: run 'a/b' is not a valid name"),
        (["r1", "--run", "a/b"], {}, "argument --run: run 'a/b' is not a valid name"),
        ([], ALL | {"ENCIRCLE_SEED": "1.5"}, "ENCIRCLE_SEED: '1.5' is not a whole number"),
        (["--seed", "x"], ALL, "argument --seed: 'x' is not a whole number"),
        ([], ALL | {"ENCIRCLE_JOIN_TIMEOUT": "soon"}, "ENCIRCLE_JOIN_TIMEOUT: 'soon' is not a"),
        (["--join-timeout", "0"], ALL, "'0' is not a number of seconds up to 86400"),
        (["--join-timeout", "nan"], ALL, "'nan' is not a number of seconds"),
        ([], ALL | {"ENCIRCLE_STAY": "maybe"}, "ENCIRCLE_STAY: 'maybe' is not one of 1, yes,"),
        (["--join-timeot", "3"], ALL, "--join-timeot (did you mean '--join-timeout'?)"),
        (["--stay=yes", "x"], ALL, "argument --stay: ignored explicit argument 'yes'"),
        (["r1", "r2"], ALL, "unrecognized arguments: r2\n"),
        # As a shell leaves a={b=1, c=2} and {a.b=1,a.c=2} without quotes.
        (
            ["r1", "--set", "a={b=1,", "c=2}"],
            ALL,
            'c=2} (put all of it in quotes: --set "KEY=VALUE")',
        ),
        (["r1", "--set", "a.b=1", "a.c=2"], ALL, "a.c=2 (put all of it in quotes: --set"),
        (["--joint", "3"], ALL, "unrecognized arguments: --joint"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(options, capsys, arguments, environment, said):
    with pytest.raises(SystemExit) as ended:
        options.parse(arguments, environment)
    assert ended.value.code == 2
    (last,) = capsys.readouterr().err.splitlines(keepends=True)
    assert last.startswith("encircle thing: error: ")
    assert said in last


def test_the_help_names_every_variable(options, capsys):
    with pytest.raises(SystemExit):
        options.parse(["--help"])
    said = capsys.readouterr().out
    assert all(variable in said for variable in ALL)


def test_processes_that_get_all_by_command_line_inherit_no_option_but_where_policies_lie():
    others = {"HOME": "/tmp", "ENCIRCLE_POLICIES": "/robots"}
    assert without_settings(ALL | others) == others


def test_certificates_are_those_of_the_node_or_of_a_viewer(options, tmp_path):
    lab = make_certificates(tmp_path / "lab", 2).directory
    found = options.parse(["r1", "--run", "demo", "--connect", "tls/h:1"], {CERTIFICATES: str(lab)})
    assert endpoints_of(found, 1.0, name="r2").identity == identity_in(lab, "r2")
    assert endpoints_of(found, 1.0).identity == identity_in(lab, "viewer")
    listening = argparse.Namespace(**vars(found) | {"listen": ["tls/127.0.0.1:0"]})
    assert endpoints_of(listening, 1.0, name="world").identity == identity_in(lab, "world")
    with pytest.raises(ConfigurationError, match="only router and world listen, and r1 connects"):
        endpoints_of(listening, 1.0, name="r1")
    with pytest.raises(ConfigurationError, match=r"r3\.pem: No such file"):
        endpoints_of(found, 1.0, name="r3")
    found = options.parse(["r1", "--run", "demo", "--connect", "tcp/h:1"], {CERTIFICATES: " "})
    assert endpoints_of(found, 1.0, name="r2").identity is None
