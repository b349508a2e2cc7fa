"""One run, round by round: what its setups say."""

from encircle.protocol.codec import decode
from encircle.protocol.messages import Setup
from encircle.protocol.plugin_files import FOLDERS
from encircle.world.arena.engine import build
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.loading.load import load

POLICY = "def decide(memory, view):\n    return memory, None\n"


def test_the_source_of_a_policy_is_that_of_the_first_setup_throughout_a_run(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    file = tmp_path / "own.py"
    file.write_text(POLICY)
    scenario = load({"team": {"robots": 3, "strategy": "own.py:decide"}})

    def sources(rounds, *robots):
        setups = [message for robot in robots for message in rounds.join(robot)]
        return {decode(Setup, payload, "run").policy_source for _, payload in setups}

    rounds = RoundEngine(build(scenario, 1), "run", print)
    first = sources(rounds, "r1")
    file.write_text(POLICY + "\n")
    assert sources(rounds, "r2") == first
    file.unlink()
    assert sources(rounds, "r3") == first
    file.write_text(POLICY + "\n")
    assert sources(RoundEngine(build(scenario, 1), "run", print), "r1") != first
