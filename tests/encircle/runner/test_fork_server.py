"""Nodes forked from one process: as if started by hand each, and gone with their starter."""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from helpers_waiting import communicated, until

import encircle
from encircle.doctor.network import is_encircle_command
from encircle.runner import nodes
from encircle.runner.fork_server import set_command_line
from encircle.runner.launch import free_endpoint
from encircle.runner.nodes import ForkServer, NodesLost

NOBODY = ("r1", "--run", "none", "--join-timeout", "3600", "--connect")


@pytest.fixture
def server():
    made = ForkServer(os.environ)
    yield made
    made.close()


@pytest.fixture
def output(tmp_path):
    with open(tmp_path / "output", "w+b", buffering=0) as file:
        yield file


def started(server, output, *arguments, program="encircle.agents", **more):
    streams = (output.fileno(),) * 3
    return server.start(program, arguments, streams, dict(os.environ), **more).result()


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def environment_of(pid: int) -> dict[str, str]:
    words = Path(f"/proc/{pid}/environ").read_text().split("\0")
    return dict(word.split("=", 1) for word in words if "=" in word)


def test_one_that_was_asked_for_no_node_is_ended_before_it_has_imported_anything(server):
    server.close()
    assert server._process.poll() == -signal.SIGKILL


def test_a_node_has_a_session_a_folder_and_a_command_line_of_its_own(server, output, tmp_path):
    node = started(server, output, *NOBODY, free_endpoint(), folder=tmp_path)
    words = Path(f"/proc/{node.pid}/cmdline")
    until(lambda: b"agents" in words.read_bytes(), "its command line")
    assert os.getsid(node.pid) == node.pid
    assert Path(f"/proc/{node.pid}/cwd").readlink() == tmp_path
    command = words.read_text().rstrip("\0").split("\0")
    assert command[:5] == [sys.executable, "-m", "encircle.agents", "r1", "--run"]
    assert is_encircle_command(command)
    assert node.poll() is None


def test_the_fork_server_has_one_thread_and_one_thread_of_its_libraries(server, output):
    started(server, output, "r1")
    pid = server._process.pid
    assert len(list(Path(f"/proc/{pid}/task").iterdir())) == 1
    assert environment_of(pid)["OMP_NUM_THREADS"] == "1"
    assert is_encircle_command(Path(f"/proc/{pid}/cmdline").read_text().rstrip("\0").split("\0"))


def test_an_exit_status_is_that_of_the_program_and_an_error_is_told(server, output, tmp_path):
    node = started(server, output, "r1")
    until(lambda: node.returncode is not None, "its end")
    assert node.returncode == 2
    assert "--run is missing" in (tmp_path / "output").read_text()


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGKILL, -9), (signal.SIGTERM, 1), (signal.SIGINT, 1)]
)
def test_a_signal_ends_a_node_as_one_that_was_started_by_hand(
    server, output, tmp_path, number, status
):
    node = started(server, output, *NOBODY, free_endpoint())
    node.send_signal(number)
    until(lambda: node.returncode is not None, "its end")
    assert node.returncode == status
    said = (tmp_path / "output").read_text()
    assert ("stopped by" in said) == (number != signal.SIGKILL)


def test_a_signal_to_a_node_that_has_ended_goes_to_nobody(server, output):
    node = started(server, output, "r1")
    until(lambda: node.returncode is not None, "its end")
    node.kill()
    assert node.returncode == 2


def test_a_fork_server_that_is_killed_takes_its_nodes_along(server, output):
    node = started(server, output, *NOBODY, free_endpoint())
    os.kill(server._process.pid, signal.SIGKILL)
    until(lambda: not alive(node.pid), "the node's end")
    assert node.wait() == -signal.SIGKILL
    until(lambda: server.lost, "the loss to be noticed")
    with pytest.raises(NodesLost, match="is gone"):
        started(server, output, "r1")


def test_a_new_one_is_started_when_one_was_lost():
    first = nodes.fork_server()
    assert nodes.fork_server() is first
    os.kill(first._process.pid, signal.SIGKILL)
    until(lambda: first.lost, "the loss to be noticed")
    assert encircle.run("sim2", overrides=["ticks_max=3"]).result.ticks == 3


def test_modules_that_lie_elsewhere_have_a_server_that_finds_them(tmp_path):
    here = nodes.fork_server()
    there = nodes.fork_server(os.environ | {"PYTHONPATH": str(tmp_path)})
    assert there is not here
    assert nodes.fork_server(os.environ | {"PYTHONPATH": str(tmp_path)}) is there
    assert nodes.fork_server() is here


def test_a_fork_server_ends_with_a_starter_that_is_killed():
    script = (
        "import time; from encircle.runner.nodes import fork_server;"
        "print(fork_server()._process.pid, flush=True); time.sleep(3600)"
    )
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as starter:
        assert starter.stdout is not None
        pid = int(starter.stdout.readline())
        assert alive(pid)
        starter.kill()
        communicated(starter)
    until(lambda: not alive(pid), "the fork server's end")


def test_a_script_without_a_guard_runs_once(tmp_path):
    """``multiprocessing``'s fork server would run it again in each node."""
    script = tmp_path / "script.py"
    script.write_text(
        "import json, encircle\n"
        "hunt = encircle.run('sim2', overrides=['ticks_max=3'])\n"
        "print(json.dumps([hunt.result.ticks, hunt.processes]))\n"
    )
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE) as process:
        printed, _ = communicated(process)
    assert process.returncode == 0
    assert json.loads(printed) == [3, 4]


def test_settings_in_the_environment_are_not_for_nodes(monkeypatch):
    monkeypatch.setenv("ENCIRCLE_ROBOT", "r9")
    monkeypatch.setenv("ENCIRCLE_RUN", "another")
    pids = {}
    encircle.run(
        "sim2", overrides=["ticks_max=3"], progress=lambda r: pids.update(r.get("started", {}))
    )
    assert set(pids) == {"world", "r1", "r2", "r3"}


def test_where_processes_keep_no_command_line_nothing_happens(tmp_path):
    set_command_line(["python"], tmp_path)
    (tmp_path / "stat").write_text("1 (x) " + "0 " * 50)
    set_command_line(["python"], tmp_path)


def test_to_close_it_ends_its_nodes(server, output):
    node = started(server, output, *NOBODY, free_endpoint())
    server.close()
    assert node.poll() == -signal.SIGKILL
    until(lambda: not alive(node.pid), "the node's end")


def test_a_node_that_is_abandoned_before_it_is_there_is_ended(server, output):
    streams = (output.fileno(),) * 3
    start = server.start("encircle.agents", [*NOBODY, free_endpoint()], streams, dict(os.environ))
    nodes.abandon(start)
    assert start.result().wait() == -signal.SIGKILL


def test_a_process_that_cannot_be_made_is_one_line_and_the_others_go_on(tmp_path):
    """``fork`` fails once, as it does where too many processes are there already."""
    fails = (
        "import errno, os\nfork, calls = os.fork, []\n"
        "def once():\n"
        "    calls.append(0)\n"
        "    if len(calls) == 2:\n"
        "        raise BlockingIOError(errno.EAGAIN, 'Resource temporarily unavailable')\n"
        "    return fork()\n"
        "os.fork = once\n"
    )
    server = ForkServer(os.environ, boot=fails + nodes.BOOT)
    try:
        with open(tmp_path / "output", "w+b", buffering=0) as output:
            first = started(server, output, *NOBODY, free_endpoint())
            with pytest.raises(NodesLost, match="no process can be made: Resource temporarily"):
                started(server, output, *NOBODY, free_endpoint())
            third = started(server, output, *NOBODY, free_endpoint())
            assert (first.poll(), third.poll()) == (None, None)
    finally:
        server.close()


def test_a_program_whose_directory_is_gone_starts_nodes_in_that_of_the_fork_server(
    server, output, tmp_path, monkeypatch
):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    node = started(server, output, *NOBODY, free_endpoint())
    its, servers = (Path(f"/proc/{pid}/cwd").readlink() for pid in (node.pid, server._process.pid))
    assert its == servers


def test_ctrl_c_and_the_join_limit_hold_while_the_fork_server_is_busy(monkeypatch):
    busy = ForkServer(os.environ)
    os.kill(busy._process.pid, signal.SIGSTOP)
    monkeypatch.setattr("encircle.runner.launch.fork_server", lambda _environment: busy)
    try:
        with pytest.raises(encircle.RunFailed, match=r"the process of world was not there within"):
            encircle.run("sim1", timeouts=encircle.Timeouts(join_s_max=0.5))
        before = signal.getsignal(signal.SIGINT)

        def interrupt_when_caught() -> None:
            until(lambda: signal.getsignal(signal.SIGINT) is not before, "signals to be caught")
            os.kill(os.getpid(), signal.SIGINT)

        interrupt = threading.Thread(target=interrupt_when_caught)
        interrupt.start()
        with pytest.raises(encircle.RunFailed, match="stopped by SIGINT before the run began"):
            encircle.run("sim1")
        interrupt.join()
    finally:
        os.kill(busy._process.pid, signal.SIGKILL)
        busy.close()
