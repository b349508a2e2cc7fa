"""The health check: whether a node can be found, not whether its process exists."""

import pytest
from helpers_waiting import LONGEST_S, until

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.programs.alive import main
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.session import open_session
from encircle.runner.launch import free_endpoint

QUICK = ("--check-timeout", "1")
PATIENT = ("--check-timeout", f"{LONGEST_S}")


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.setenv("ENCIRCLE_RUN", "t")
    return monkeypatch


@pytest.fixture
def router():
    endpoint = free_endpoint()
    with open_session(Endpoints(listen=(endpoint,), mode="router")):
        yield endpoint


def test_a_router_is_there_or_not(router, capsys):
    assert main(["router", "--connect", router, *PATIENT]) == 0
    assert capsys.readouterr().out == f"alive: router at {router}: there\n"
    nowhere = free_endpoint()
    assert main(["router", "--connect", nowhere, *QUICK]) == 1
    assert capsys.readouterr().out.startswith(f"alive: cannot connect to {nowhere}: ")


def test_what_listens_is_asked_where_it_listens(router, environment):
    environment.setenv("ENCIRCLE_LISTEN", router.replace("127.0.0.1", "0.0.0.0"))
    assert main(["router", *PATIENT]) == 0


@pytest.mark.parametrize("directly", [False, True])
def test_world_and_robots_are_found_by_their_tokens(router, environment, directly):
    """Through a router or from the world itself; each run and each robot by itself."""
    endpoint = free_endpoint() if directly else router
    environment.setenv("ENCIRCLE_CONNECT", endpoint)
    world = ZenohConnection(
        Endpoints(listen=(endpoint,)) if directly else Endpoints(connect=(router,)), "t/w"
    )
    robot = ZenohConnection(Endpoints(connect=(endpoint,)), "t/r")
    try:
        assert main(["world", *QUICK]) == 1
        assert main(["robot", "--robot", "r1", *QUICK]) == 1
        world.declare_alive(world_key("t", "alive"))
        robot.declare_alive(robot_key("t", "r1", "alive"))
        # The next look has to find what was declared before: a round trip later it is there.
        until(lambda: main(["world", *PATIENT]) == 0, "the world's token")
        until(lambda: main(["robot", "--robot", "r1", *PATIENT]) == 0, "the robot's token")
        assert main(["robot", "--robot", "r2", *QUICK]) == 1
        assert main(["world", "--run", "another", *QUICK]) == 1
    finally:
        robot.close()
        world.close()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["weather"], "'weather' is not one of router, world, robot"),
        ([], "WHAT is missing"),
        (["robot", "--connect", "tcp/127.0.0.1:1"], "set ENCIRCLE_ROBOT"),
        (["router"], "neither an endpoint"),
        (["router", "--connect", "there"], "connect = 'there': must be"),
    ],
)
def test_bad_usage_is_status_2(capsys, arguments, said):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]


def test_a_run_must_be_named(environment, capsys):
    environment.delenv("ENCIRCLE_RUN")
    with pytest.raises(SystemExit):
        main(["world", "--connect", "tcp/127.0.0.1:1"])
    assert "set ENCIRCLE_RUN" in capsys.readouterr().err
