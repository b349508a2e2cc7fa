"""Studies that are executed: every way gives the same table, and no interruption loses a run."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from helpers_cluster import Cluster
from helpers_commands import command
from helpers_waiting import LONGEST_S, TIMEOUTS, ample_s, communicated, ended, until

import encircle
from encircle.runner.launch import free_endpoint
from encircle.studies import workers
from encircle.studies.workers import StudyFailed

LONG_TICKS = 60


def tree(ticks=12, seeds=3, rates=(0.0, 0.6)):
    """A study of few runs with a given number of ticks; the target stays out of reach."""
    return {
        "name": "tested",
        "scenario": "sim1",
        "seeds": seeds,
        "strategies": ["xi-star", "pursuit"],
        "set": {
            "ticks_max": ticks,
            "sensing.noise_m_std": 0.02,
            "target.position": [0.5, 0.5],
            "channel.loss.model": "bernoulli",
            "channel.delay": {"model": "gamma", "mean_s": 0.2, "std_s": 0.1},
        },
        "axes": [{"name": "loss", "key": "channel.loss.rate", "values": list(rates)}],
    }


def rows(study, **how):
    """The results of the runs, without their duration."""
    study.run(**how)
    return study.table().drop(columns=["wall_s"])


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return rows(encircle.study(tree(), tmp_path_factory.mktemp("reference") / "t"), workers=1)


LONG_STUDY = f"""
scenario = "sim1"
seeds = 10
set = {{ ticks_max = {LONG_TICKS}, "channel.loss.model" = "bernoulli" }}
axes = [{{ name = "loss", key = "channel.loss.rate", values = [0.9, 1.0] }}]
strategies = ["pursuit", "xi-3"]
"""


@pytest.fixture
def written(tmp_path):
    """A study that takes some seconds, as a file, and a directory for it."""
    path = tmp_path / "long.toml"
    path.write_text(LONG_STUDY)
    return path, tmp_path / "out"


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    """The results of the same study if it is never interrupted."""
    path = tmp_path_factory.mktemp("unbroken") / "long.toml"
    path.write_text(LONG_STUDY)
    return rows(encircle.study(path, path.with_name("out")))


def started(path, out, *options):
    return subprocess.Popen(
        [sys.executable, "-m", "encircle", "study", str(path), "--out", str(out), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finished(process):
    out, err = communicated(process)
    return process.returncode, out, err


def children(pid):
    results = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(path.read_text().rsplit(")", 1)[1].split()[1]) == pid:
                results.append(int(path.parent.name))
        except (OSError, IndexError):
            continue
    return results


def gone(pids):
    return not any(Path(f"/proc/{pid}").exists() for pid in pids)


def parts(out):
    return list((out / "parts").glob("*.parquet"))


def check_whole(path, out, unbroken):
    """Complete the study; every run must be there once, as in a study without interruption."""
    assert rows(encircle.study(path, out)).equals(unbroken)


def test_the_table_has_every_cell_and_seed_once(reference):
    keys = list(zip(reference.loss, reference.strategy, reference.seed, strict=True))
    assert keys == [
        (rate, strategy, seed)
        for rate in (0.0, 0.6)
        for strategy in ("xi-star", "pursuit")
        for seed in (1, 2, 3)
    ]
    assert reference.digest.nunique() == len(reference)
    assert json.loads(reference.versions[0])["numpy"]


def test_a_row_is_what_a_single_hunt_gives(reference):
    hunt = encircle.run(encircle.study(tree()).plan.scenario_of(3), seed=2, link="memory")
    row = reference[(reference.cell == 3) & (reference.seed == 2)].iloc[0]
    assert row.digest == hunt.digest
    assert (bool(row.captured), row.ticks) == (hunt.captured, hunt.result.ticks)
    sent, lost = hunt.result.packets_sent, sum(hunt.result.packets_lost.values())
    assert row.messages_sent == sent / 3  # one message has three receivers
    assert row.delivery_ratio == pytest.approx(1 - lost / sent)


def test_two_workers_give_the_same_table(tmp_path, reference):
    assert rows(encircle.study(tree(), tmp_path / "t"), workers=2).equals(reference)


def test_robot_processes_over_zenoh_give_the_same_table(tmp_path, reference):
    assert rows(encircle.study(tree(), tmp_path / "t"), link="zenoh").equals(reference)


def test_what_is_there_is_not_run_again(tmp_path):
    first = encircle.study(tree(seeds=2), tmp_path / "t")
    progress_calls = []
    assert first.run(progress=lambda done, runs: progress_calls.append((done, runs))) == 8
    assert progress_calls[0] == (0, 8)
    assert progress_calls[-1] == (8, 8)
    assert first.run() == 0
    assert encircle.study(tree(seeds=3), tmp_path / "t").run() == 4


def test_nothing_is_written_before_it_runs(tmp_path):
    encircle.study(tree(), tmp_path / "t")
    assert not (tmp_path / "t").exists()


def test_killed_with_sigkill_it_goes_on_where_it_was(written, unbroken):
    path, out = written
    process = started(path, out, "--workers", "2")
    until(lambda: parts(out), "the first runs")
    workers_of_it = children(process.pid)
    process.kill()
    finished(process)
    assert workers_of_it
    until(lambda: gone(workers_of_it), "the workers' end")
    assert not (out / "table.parquet").exists()
    check_whole(path, out, unbroken)


def test_ctrl_c_ends_it_with_a_line_and_keeps_what_is_done(written, unbroken):
    path, out = written
    process = started(path, out, "--workers", "1")
    until(lambda: parts(out), "the first runs")
    workers_of_it = children(process.pid)
    # The study must not end before this process continues, however late that is.
    for worker in workers_of_it:
        os.kill(worker, signal.SIGSTOP)
    process.send_signal(signal.SIGINT)
    for worker in workers_of_it:
        os.kill(worker, signal.SIGCONT)
    status, message, error = finished(process)
    assert status == 1
    assert message == ""
    assert "the study stopped: stopped by SIGINT" in error
    assert "the same command goes on from here" in error.replace("\n", " ")
    assert "Traceback" not in error
    until(lambda: gone(workers_of_it), "the workers' end")
    check_whole(path, out, unbroken)


def test_a_worker_that_dies_ends_it_with_a_line(written, unbroken):
    path, out = written
    process = started(path, out, "--workers", "2")
    until(lambda: parts(out), "the first runs")
    ours = [
        pid
        for pid in children(process.pid)
        if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    os.kill(ours[0], signal.SIGKILL)
    status, _, error = finished(process)
    assert status == 1
    assert "a worker process died" in error
    assert "Traceback" not in error
    check_whole(path, out, unbroken)


def test_robots_are_kept_from_run_to_run_and_ended(tmp_path, monkeypatch):
    from encircle.studies import session

    saved = []
    end = session.Session.__exit__

    def noted(self, *error):
        saved.append({name: p.pid for name, p in self._processes.items()})
        end(self, *error)

    monkeypatch.setattr(session.Session, "__exit__", noted)
    assert encircle.study(tree(ticks=5), tmp_path / "t").run(link="zenoh") == 12
    assert [sorted(pids) for pids in saved] == [["r1", "r2", "r3", "r4"]]
    assert gone(saved[0].values())


def test_teams_of_several_sizes_share_the_robot_processes(tmp_path):
    sizes = {
        "name": "sizes",
        "scenario": {"ticks_max": 5, "team": {"robots": 2}},
        "seeds": 1,
        "axes": [{"name": "robots", "key": "team.robots", "values": [3, 2]}],
    }
    over_zenoh = rows(encircle.study(sizes, tmp_path / "z"), link="zenoh")
    assert over_zenoh.equals(rows(encircle.study(sizes, tmp_path / "m"), workers=1))


def test_a_study_varies_one_robot_of_a_team_that_is_given_as_a_number(tmp_path):
    study = {
        "name": "weak",
        "scenario": {"ticks_max": 8, "team": {"robots": 3}},
        "seeds": 2,
        "measures": ["path_m_mean"],
    }
    axis = {"name": "r3", "key": "team.robots.r3.step_m_max", "values": [0.3, 0.05]}
    mixed = rows(encircle.study({**study, "axes": [axis]}, tmp_path / "m"), workers=1)
    assert rows(encircle.study({**study, "axes": [axis]}, tmp_path / "z"), link="zenoh").equals(
        mixed
    )
    as_the_team, slow = (mixed[mixed.r3 == level].path_m_mean.to_numpy() for level in (0.3, 0.05))
    plain = rows(encircle.study(study, tmp_path / "p"), workers=1).path_m_mean.to_numpy()
    assert as_the_team.tolist() == plain.tolist()
    assert (slow < as_the_team).all()


def test_a_robot_that_dies_ends_it_with_a_line(tmp_path):
    from encircle.studies.session import Session
    from encircle.world.arena.engine import build

    plan = encircle.study(tree(ticks=2000)).plan
    with Session(("r1", "r2", "r3", "r4")) as session:
        session._processes["r3"].kill()
        with pytest.raises(StudyFailed, match="robot r3 is gone"):
            session.hunt(build(plan.scenario_of(3), 1))
        processes = list(session._processes.values())
    assert all(p.poll() is not None for p in processes)


def test_a_frozen_robot_ends_it_with_a_line(tmp_path):
    from encircle.studies.session import Session
    from encircle.world.arena.engine import build

    plan = encircle.study(tree(ticks=2000)).plan
    answer_s = ample_s()
    timeouts = replace(TIMEOUTS, answer_s_max=answer_s)
    with Session(("r1", "r2", "r3", "r4"), timeouts) as session:
        session._processes["r2"].send_signal(signal.SIGSTOP)
        with pytest.raises(StudyFailed, match=f"no answer from r2 for {answer_s:g} s|r2 is gone"):
            session.hunt(build(plan.scenario_of(3), 1))
        processes = list(session._processes.values())
    assert all(p.poll() is not None for p in processes)


def test_an_observation_that_is_lost_is_asked_again(monkeypatch):
    from encircle.studies import session
    from encircle.world.arena.engine import build

    lost = []

    class Lossy(session.ZenohConnection):
        def send(self, key, payload):
            if key.endswith("r2/observation") and not lost:
                lost.append(key)
            else:
                super().send(key, payload)

    monkeypatch.setattr(session, "ZenohConnection", Lossy)
    plan = encircle.study(tree(ticks=5)).plan
    with session.Session(("r1", "r2", "r3", "r4")) as made:
        log, _ = made.hunt(build(plan.scenario_of(3), 1))
    assert len(lost) == 1
    assert log.ticks == 5


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "CONNECT_S_MAX", LONGEST_S)
    monkeypatch.setattr(workers, "WORKERLESS_S_MAX", LONGEST_S)
    results = Cluster(tmp_path / "dask")
    yield results
    results.end()


def test_a_cluster_gives_the_same_table_though_a_worker_is_killed(
    tmp_path, cluster, written, unbroken
):
    path, _ = written
    first, _ = cluster.add_worker(), cluster.add_worker()
    study = encircle.study(path, tmp_path / "t")

    def kill_one(done, runs):
        if 0 < done < runs and first.poll() is None:
            first.kill()

    study.run(cluster=cluster.address, progress=kill_one)
    assert ended(first) == -signal.SIGKILL
    assert rows(study).equals(unbroken)


def test_no_scheduler_no_study(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "CONNECT_S_MAX", 1.0)
    address = free_endpoint().replace("tcp/", "tcp://")
    with pytest.raises(StudyFailed, match=f"no dask scheduler at {address}"):
        encircle.study(tree(), tmp_path / "t").run(cluster=address)


def test_a_cluster_without_workers_does_not_hang(tmp_path, cluster, monkeypatch):
    monkeypatch.setattr(workers, "WORKERLESS_S_MAX", 1.0)
    monkeypatch.setattr(workers, "POLL_S", 0.2)
    with pytest.raises(StudyFailed, match="has had no worker for 1 s"):
        encircle.study(tree(), tmp_path / "t").run(cluster=cluster.address)


def test_a_worker_with_other_code_is_refused():
    class Finished:
        def result(self):
            return "0ther", []

    with pytest.raises(StudyFailed, match="runs code 0ther, this is 0urs"):
        workers._result(Finished(), "0urs")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing"], "study 'nothing' is neither a file nor one of"),
        (["loss", "--set", "channel.los.rate=1"], "channel.los = {'rate': 1}: unknown key"),
        (["loss", "--link", "telepathy"], "'telepathy' is not one of zenoh, memory"),
        (["loss", "--seeds", "0"], "argument --seeds: '0' is not a whole number of at least 1"),
        (["loss", "--cluster", "x", "--link", "zenoh"], "goes neither with --link zenoh"),
    ],
)
def test_bad_usage_is_one_clear_error_and_writes_nothing(tmp_path, words, message):
    out = tmp_path / "t"
    done = command("study", words[0], "--out", str(out), *words[1:], folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert message in " ".join(done.stderr.replace("│", " ").split())
    assert "Traceback" not in done.stderr
    assert not out.exists()
