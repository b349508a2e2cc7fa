"""The results of ``encircle doctor`` in situations that the tests create. About 15 s altogether."""

import json
import os
import resource
import shutil
import socket
import tempfile
import threading
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import NamedTuple

import msgpack
import pytest
from helpers_security import Lab
from helpers_security import free_endpoint as free
from helpers_waiting import LONGEST_S, until
from packaging.specifiers import SpecifierSet

from encircle.check_results import CheckResult
from encircle.doctor import doctor
from encircle.doctor import machine as checkup
from encircle.doctor import network as checkup_network
from encircle.doctor import run as checkup_run
from encircle.protocol import VERSION
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.mailbox import now_us
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.node_info import ROUTER_KEY, info_replier
from encircle.protocol.zenoh.queries import serve_queries
from encircle.protocol.zenoh.session import open_session
from encircle.runner.launch import free_endpoint

MIB = 1024 * 1024


def levels(findings, check):
    return [finding.level for finding in findings if finding.check == check]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


class Examined(NamedTuple):
    status: int
    well: bool
    findings: list[CheckResult]

    def of(self, check):
        return [finding for finding in self.findings if finding.check == check]

    def said(self, check, level):
        return " | ".join(f.said for f in self.of(check) if f.level == level)


@pytest.fixture
def examine(capsys):
    def run(*arguments, check_s=LONGEST_S):
        status = doctor.main([*arguments, "--json", "--check-timeout", f"{check_s}"])
        printed = json.loads(capsys.readouterr().out)
        findings = [CheckResult(**finding) for finding in printed["findings"]]
        assert printed["well"] == (status == 0)
        assert status == any(finding.level == "wrong" for finding in findings)
        assert all(finding.advice for finding in findings if finding.level != "ok")
        return Examined(status, printed["well"], findings)

    return run


# This machine


def test_without_options_it_examines_this_machine(examine):
    result = examine()
    assert {finding.check for finding in result.findings} >= {
        *("versions", "memory", "cores", "temporary files", "recordings"),
    }
    assert f"wire version {VERSION}" in result.said("versions", "ok")
    assert not Path("runs").exists()


def test_as_text_it_says_what_to_do_and_the_verdict(capsys, monkeypatch):
    gone = CheckResult("memory", "wrong", "none is left", "buy some")
    monkeypatch.setattr(doctor, "check_machine", lambda *_: [gone])
    assert doctor.main([]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "wrong  memory: none is left",
        "       -> buy some",
        "1 thing is wrong",
    ]


@pytest.mark.parametrize("bounds", [">=1.10,<2", ">=1.1", "<2.0", "==1.10.0", ">1.9,<=1.10", ""])
@pytest.mark.parametrize("there", ["1.9", "1.10", "1.10.2", "2", "2.0.1", "1.1.0", "0.99.9"])
def test_versions_are_compared_as_packaging_does(there, bounds):
    assert checkup.within_bounds(there, bounds) == SpecifierSet(bounds).contains(there)


def test_packages_that_lack_or_are_too_old_are_named(tmp_path, monkeypatch):
    about = tmp_path / "fake-1.0.dist-info" / "METADATA"
    about.parent.mkdir()
    about.write_text(
        "Metadata-Version: 2.1\nName: fake\nVersion: 1.0\nRequires-Python: >=9\n"
        "Requires-Dist: numpy>=99\nRequires-Dist: msgpack<99,>=0\nRequires-Dist: nowhere\n"
        'Requires-Dist: elsewhere>=1; extra == "more"\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    result = checkup.check_packages("fake")
    assert [(finding.level, finding.advice) for finding in result] == [
        ("ok", ""),
        ("wrong", "make an environment with a newer Python"),
        ("wrong", "pip install 'numpy>=99'"),
        ("wrong", "pip install nowhere"),
        ("note", "pip install 'fake[more]'"),
    ]
    assert "msgpack" in result[0].said
    assert "numpy" not in result[0].said
    assert [f.level for f in checkup.check_packages("not-there-at-all")] == ["wrong"]


def test_an_image_for_nodes_is_well_without_what_draws(monkeypatch):
    def version(name: str) -> str:
        if name in ("matplotlib", "rich"):
            raise PackageNotFoundError(name)
        return installed(name)

    installed = checkup.version
    monkeypatch.setattr(checkup, "version", version)
    results = checkup.check_packages()
    assert "wrong" not in {result.level for result in results}
    notes = [result.said for result in results if result.level == "note"]
    assert len(notes) == 1
    assert notes[0].endswith("; no node needs it")
    assert all(name in notes[0] for name in ("matplotlib", "rich"))


def written(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


V1 = "memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"


@pytest.mark.parametrize(
    ("files", "level", "free_mib"),
    [
        ({}, "ok", 4000),
        ({"memory.max": "max\n", "memory.current": "5\n"}, "ok", 4000),
        ({"memory.max": f"{900 * MIB}\n", "memory.current": f"{100 * MIB}\n"}, "ok", 800),
        ({"memory.max": f"{200 * MIB}\n", "memory.current": f"{100 * MIB}\n"}, "wrong", 100),
        ({V1[0]: f"{64 * MIB}\n", V1[1]: "0\n"}, "wrong", 64),
        ({V1[0]: "9223372036854771712\n", V1[1]: "0\n"}, "ok", 4000),
    ],
)
def test_memory_is_the_containers_where_it_has_a_limit(tmp_path, files, level, free_mib):
    written(tmp_path, files)
    (tmp_path / "meminfo").write_text(f"MemTotal: 9 kB\nMemAvailable:   {4000 * 1024} kB\n")
    result = checkup.check_memory(tmp_path, tmp_path / "meminfo")
    assert (result.level, result.said.split()[0]) == (level, str(free_mib))


def test_a_share_of_a_core_and_few_files_are_noticed(tmp_path, monkeypatch):
    written(tmp_path, {"cpu.max": "20000 100000\n"})
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (64, 64))
    result = checkup.check_cores_and_files(tmp_path)
    assert [(finding.check, finding.level) for finding in result] == [
        ("cores", "note"),
        ("files", "wrong"),
    ]
    assert "0.2" in result[0].said


def test_a_machine_without_limits_has_its_cores(tmp_path):
    written(tmp_path, {"cpu.max": "max 100000\n"})
    (cores, *_) = checkup.check_cores_and_files(tmp_path)
    assert cores.said == str(len(os.sched_getaffinity(0)))


def test_no_temporary_directory_is_wrong(tmp_path, monkeypatch):
    assert checkup.check_temporary_directory().level == "ok"
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    assert checkup.check_temporary_directory().level == "wrong"


@pytest.mark.parametrize("place", ["file/runs", "file", "/proc/runs"])
@pytest.mark.parametrize(("named", "level"), [(True, "wrong"), (False, "note")])
def test_a_runs_directory_that_cannot_be_is_wrong_if_it_was_named(tmp_path, place, named, level):
    (tmp_path / "file").write_text("")
    assert checkup.check_runs_directory(tmp_path / place, named).level == level


def test_a_runs_directory_is_not_made_and_its_disk_must_have_room(tmp_path, monkeypatch):
    assert checkup.check_runs_directory(tmp_path / "a" / "b", True).level == "ok"
    assert list(tmp_path.iterdir()) == []
    full = shutil.disk_usage(tmp_path)._replace(free=MIB)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: full)
    assert checkup.check_runs_directory(tmp_path, True).level == "wrong"


def test_a_clock_that_nothing_keeps_is_worth_a_note(monkeypatch):
    for synchronised, expected in ((True, ["ok"]), (False, ["note"]), (None, [])):
        monkeypatch.setattr(
            checkup, "is_synchronised", lambda synchronised=synchronised: synchronised
        )
        assert [finding.level for finding in checkup.check_clock_service()] == expected


# Ports and endpoints


@pytest.mark.parametrize(
    ("command", "ours"),
    [
        ("/opt/encircle/.venv/bin/encircle router --listen tcp/127.0.0.1:7447", True),
        ("/opt/encircle/.venv/bin/python /opt/encircle/.venv/bin/encircle world sim1", True),
        ("python3 -m encircle.protocol.programs.router --listen tcp/127.0.0.1:7447", True),
        ("python3 -m encircle.world sim1", True),
        ("/opt/encircle/.venv/bin/python -m http.server", False),
        ("/home/encircle/bin/zenohd -l tcp/127.0.0.1:7447", False),
        ("", False),
    ],
)
def test_a_process_is_ours_by_its_program_and_not_by_where_it_is(command, ours):
    assert checkup_network.is_encircle_command(command.split()) == ours


def test_a_port_is_free_or_it_is_said_who_has_it(examine):
    endpoint = free_endpoint()
    assert examine("--listen", endpoint).said("ports", "ok") == f"{endpoint} is free to listen on"
    with socket.create_server(("127.0.0.1", int(endpoint.rpartition(":")[2]))):
        result = examine("--listen", endpoint, check_s=1.0)
    assert result.status == 1
    assert f"{endpoint} is in use by PID {os.getpid()}: " in result.said("ports", "wrong")
    # The process on the port is not one of Encircle's.
    assert "cannot connect" in result.said("session", "wrong")


@pytest.mark.parametrize(
    ("endpoint", "message"),
    [
        ("tcp/192.0.2.1:0", "Cannot assign requested address"),
        ("udp/192.0.2.1:0", "Cannot assign requested address"),
        ("tcp/nowhere.invalid:1", "cannot be listened on"),
    ],
)
def test_an_address_that_is_not_here_cannot_be_listened_on(endpoint, message):
    (result,) = checkup_network.check_listening(endpoint)
    assert (result.level, message in result.said) == ("wrong", True)


def test_listening_beyond_this_machine_is_judged(examine):
    wide = free_endpoint().replace("127.0.0.1", "0.0.0.0")
    assert levels(examine("--listen", wide).findings, "access") == ["wrong"]
    result = examine("--listen", wide, "--without-authentication")
    assert levels(result.findings, "access") == ["note"]


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (ConnectionRefusedError(111, ""), "nothing listens there"),
        (TimeoutError(), "no answer at all"),
        (socket.gaierror(-2, "unknown"), "no address is known for 'there'"),
        (OSError(101, ""), "there is no way to that address"),
        (OSError(113, ""), "there is no way to that address"),
        (OSError(5, ""), "see that host and port are right"),
    ],
)
def test_whatever_keeps_an_endpoint_from_answering_has_its_advice(monkeypatch, error, advice):
    def fails(*_, **__):
        raise error

    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: [(0, 0, 0, "", ("", 0))])
    monkeypatch.setattr(socket, "create_connection", fails)
    (result,) = checkup_network.check_connecting("tcp/there:1", 1.0)
    assert result.level == "wrong"
    assert result.advice.startswith(advice)


def test_nothing_there_is_said_and_no_session_tried(examine):
    endpoint = free_endpoint()
    result = examine("--connect", endpoint, "--run", "t")
    assert f"{endpoint} cannot be reached: Connection refused" == result.said("endpoints", "wrong")
    assert result.of("session") == result.of("run") == []


def test_a_step_that_never_ends_is_given_up(examine, monkeypatch):
    ended = []
    monkeypatch.setattr(os, "_exit", ended.append)
    monkeypatch.setattr(doctor, "check_connecting", lambda *_: threading.Event().wait())
    result = examine("--connect", "tcp/127.0.0.1:1", check_s=2.0)
    assert "no end after 4 s" in result.said("endpoints", "wrong")
    assert ended == [1]


def test_what_a_step_raises_comes_through():
    with pytest.raises(ZeroDivisionError):
        doctor.with_timeout(5.0, lambda: [1 // 0])


# Who is there


@pytest.fixture
def router():
    endpoint = free_endpoint()
    with open_session(Endpoints(listen=(endpoint,), mode="router")) as session:
        subscription = serve_queries(session, ROUTER_KEY, info_replier("router", now_us))
        yield endpoint
        del subscription


@pytest.fixture
def node(router):
    """Simulate a node of a run: its liveliness token, and its answer to queries, if any."""
    links = []

    def appear(name, run="t", reply=None, answers=True):
        link = ZenohConnection(Endpoints(connect=(router,)), f"{run}/{name}")
        links.append(link)
        key = world_key(run, "about") if name == "world" else robot_key(run, name, "about")
        if answers:
            link.kept = serve_queries(link.session, key, reply or info_replier(name, now_us))
        alive = world_key(run, "alive") if name == "world" else robot_key(run, name, "alive")
        link.declare_alive(alive)
        return link

    yield appear
    for link in links:
        link.close()


def settled(examine, router, *arguments):
    """The results once all tokens have reached the router."""
    return examined(examine, "--connect", router, *arguments)


def examined(examine, *arguments, holds=lambda result: result.status == 0):
    """The results once a condition holds for them."""

    def looked():
        result = examine(*arguments)
        return result if holds(result) else None

    return until(looked, "what was declared to be found")


def test_all_is_well_with_a_run_that_is_whole(examine, router, node):
    for name in ("r2", "world", "r1"):
        node(name)
    result = settled(examine, router, "--run", "t")
    assert result.status == 0
    assert result.said("run", "ok") == "run t: world, r1, r2"
    for name in ("router", "world", "r1", "r2"):
        assert f"{name}: wire version {VERSION}" in result.said("versions", "ok")
    clocks = [f.said.split() for f in result.of("clock") if "this one" in f.said]
    assert [words[0] for words in clocks] == ["router's", "world's", "r1's", "r2's"]
    # Both read the same clock, so the estimate may be wrong by its error bound at most.
    for words in clocks:
        assert float(words[2]) <= float(words[words.index("within") + 1])


def test_without_a_runs_name_all_runs_are_listed(examine, router, node):
    nothing = examine("--connect", router)
    assert "no run is under way" in nothing.said("run", "note")
    node("world", run="one")
    node("r1", run="two")
    result = examined(examine, "--connect", router, holds=lambda result: len(result.of("run")) == 2)
    assert result.said("run", "ok") == "run one: world | run two: r1"


def test_who_is_missing_is_named(examine, router, node):
    result = examine("--connect", router, "--run", "t")
    assert "run t has no world there" in result.said("run", "wrong")
    node("world")
    settled(examine, router, "--run", "t")
    node("r1")
    node("r3")
    queried = settled(examine, router, "--run", "t", "--robot", "r3")
    assert queried.status == 0
    result = examine("--connect", router, "--run", "t")
    assert result.said("run", "wrong") == "run t has no r2 there"
    result = examine("--connect", router, "--run", "t", "--robot", "r4")
    assert result.said("run", "wrong") == "run t has no r4 there"


@pytest.mark.parametrize(("ahead_s", "level"), [(0.2, "note"), (-0.2, "note"), (7.0, "wrong")])
def test_a_clock_that_is_off_is_found_to_be(examine, router, node, ahead_s, level):
    node("world", reply=info_replier("world", lambda: now_us() + int(ahead_s * 1e6)))

    def of_world(result):
        return [f for f in result.of("clock") if f.said.startswith("world's")]

    offsets = of_world(examined(examine, "--connect", router, "--run", "t", holds=of_world))
    ((_, _, message, _),) = offsets
    assert offsets[0].level == level
    words = message.split()
    estimate_s = float(words[2]) * (1 if "ahead" in message else -1)
    assert abs(estimate_s - ahead_s) <= float(words[words.index("within") + 1])


def test_parties_of_another_version_and_of_none_are_told_apart(examine, router, node):
    old = {"v": 2, "party": "r1", "versions": {}, "received_us": 0, "sent_us": 0}
    node("world")
    node("r1", reply=lambda: msgpack.packb(old))
    node("r2", reply=lambda: b"what?")
    node("r3", answers=False)
    talker = node("r4", answers=False)
    stop = threading.Event()

    def talk():
        while not stop.wait(0.02):
            talker.send(robot_key("t", "r4", "command"), msgpack.packb({"v": 1}))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        whole = "run t: world, r1, r2, r3, r4"
        result = examined(
            examine,
            *("--connect", router, "--run", "t"),
            holds=lambda result: result.said("run", "ok") == whole,
        )
    finally:
        stop.set()
        thread.join()
    assert f"r1 speaks version 2 of the wire, this is {VERSION}" in result.said("versions", "wrong")
    assert "r4 speaks version 1 of the wire" in result.said("versions", "wrong")
    assert "r2 answers something else" in result.said("versions", "note")
    assert "r3 says nothing of itself" in result.said("versions", "note")


def test_a_router_of_other_make_is_only_noted(examine):
    endpoint = free_endpoint()
    with open_session(Endpoints(listen=(endpoint,), mode="router")):
        result = examine("--connect", endpoint)
    assert result.status == 0


def test_what_answers_but_is_no_zenoh_is_said(examine):
    with socket.create_server(("127.0.0.1", 0)) as server:
        result = examine("--connect", f"tcp/127.0.0.1:{server.getsockname()[1]}", check_s=1.0)
    assert [f.level for f in result.of("endpoints")] == ["ok"]
    assert "cannot connect" in result.said("session", "wrong")


def test_asking_comes_to_an_end(examine, router, node, monkeypatch):
    node("world")
    settled(examine, router, "--run", "t")
    monkeypatch.setattr(doctor, "ASKING_S_MAX", 0.0)
    result = examine("--connect", router, "--run", "t")
    assert "were not asked" in result.said("versions", "note")


# With certificates


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("doctor"))


def test_certificates_let_it_ask_who_they_are(examine, lab, tmp_path):
    endpoint = free("tls")
    gate = Endpoints(listen=(endpoint,), mode="router", identity=lab.identity("router"))
    world = Endpoints(connect=(endpoint,), identity=lab.identity("world"))
    with open_session(gate) as session:
        subscription = serve_queries(session, ROUTER_KEY, info_replier("router", now_us))
        link = ZenohConnection(world, robot_key("t", "*", "*"))
        try:
            link.answer_info_queries(world_key("t", "about"), "world")
            link.declare_alive(world_key("t", "alive"))
            secured = ("--connect", endpoint, "--certificates", str(lab.directory), "--run", "t")
            result = examined(examine, *secured)
            assert result.said("run", "ok") == "run t: world"
            for name in ("router", "world"):
                assert f"{name}: wire version {VERSION}" in result.said("versions", "ok")
            stranger = examine("--connect", endpoint.replace("tls/", "tcp/"), check_s=1.0)
            assert "cannot connect" in stranger.said("session", "wrong")
        finally:
            link.close()
        del subscription
    result = examine("--connect", endpoint, "--certificates", str(tmp_path))
    assert result.said("certificates", "wrong").startswith(f"certificates = {tmp_path}")


def test_certificates_are_checked_without_a_network_as_well(examine, lab, tmp_path):
    result = examine("--certificates", str(tmp_path / "none"))
    assert result.status == 1
    assert result.said("certificates", "wrong").startswith(f"certificates = {tmp_path}")
    usable = examine("--certificates", str(lab.directory))
    assert "can be used" in usable.said("certificates", "ok")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--robot", "r1"], "its --run is missing"),
        (["--run", "t"], "where? Give --connect"),
        (["--connect", "there"], "connect = 'there': must be"),
        (["--run", "a/b"], "not a valid name"),
        (["--zenoh-config", "nowhere.json5"], "No such file"),
    ],
)
def test_bad_usage_is_status_2(capsys, arguments, message):
    with pytest.raises(SystemExit) as ended:
        doctor.main(arguments)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_robots_are_listed_in_their_order():
    keys = {robot_key("t", f"r{k}", "alive") for k in (10, 2, 1)} | {world_key("t", "alive")}
    assert checkup_run._nodes_by_run(keys) == {"t": ["world", "r1", "r2", "r10"]}
