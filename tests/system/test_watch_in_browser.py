"""A hunt that goes on, in a real browser: along with it, loaded anew, closed, stopped, captured."""

import json
import os
import signal

import pytest
from helpers_browser import SeenPage, running_browser
from helpers_commands import ours
from helpers_hosts import NodeProcess
from helpers_hunt import ENDLESS

import encircle

pytestmark = pytest.mark.browser

LOSSY = "channel.loss={model='bernoulli', rate=0.5}"
BY_LINK = pytest.mark.parametrize("link", ["memory", "zenoh"])


@pytest.fixture(scope="module")
def browser():
    with running_browser() as running:
        yield running


class Shown:
    """``encircle run --watch`` as a process, and the address of its page."""

    def __init__(self, folder, *words):
        words = ("run", *words, "--watch", "--no-browser", "--out", str(folder / "run"), "--json")
        self.node = NodeProcess(ours("encircle", *words), folder / "log", {})
        self.node.wait_until(lambda n: "the page is at" in n.said)
        lines = self.node.said.splitlines()
        self.address = next(line for line in lines if "the page is at" in line).split()[-1]


@pytest.fixture
def shown(tmp_path):
    started = []

    def start(*words):
        started.append(Shown(tmp_path, *words))
        return started[-1]

    yield start
    for one in started:
        one.node.kill()


@BY_LINK
def test_a_hunt_is_followed_whatever_pages_do_until_it_is_stopped(browser, shown, tmp_path, link):
    scenario = tmp_path / "endless.json"
    scenario.write_text(json.dumps(ENDLESS | {"channel": {"loss": {"model": "none"}}}))
    run = shown(str(scenario), "--link", link, "--pace", "4")
    seen = SeenPage(browser).open(run.address)
    seen.until("encircle.state().following && encircle.state().last_tick >= 5")
    assert seen.text("#outcome") == "hunting"
    other = SeenPage(browser).open(run.address)
    other.until("encircle.state().following && encircle.state().last_tick >= 8")
    other.context.close()
    before = seen.state()["last_tick"]
    seen.page.reload()
    seen.until(f"encircle.state().following && encircle.state().last_tick > {before}")
    assert seen.state()["notice"] is None
    os.kill(run.node.pid, signal.SIGINT)
    assert run.node.end() == 1
    seen.until("encircle.state().connection === 'lost'")
    assert seen.do("seek(3)").state()["tick"] == 3, "what came stays"
    hosts = {url.split("/")[2] for url in seen.requests if "://" in url}
    assert hosts == {run.address.split("/")[2]}
    seen.context.close()


@BY_LINK
def test_a_hunt_that_is_over_is_seen_to_its_capture(browser, shown, link):
    run = shown("sim1", "--set", LOSSY, "--link", link, "--pace", "10", "--watch-end", "closed")
    seen = SeenPage(browser).open(run.address)
    seen.until("!encircle.state().following && encircle.state().live")
    seen.press("End").until("encircle.state().captured")
    assert "captured at" in seen.text("#outcome")
    # What r2 believes is not what is: half of all packets are lost.
    errors_m = seen.do("seek(15)").do("select('r2')").state()["belief"]
    assert errors_m
    assert seen.complaints == []
    seen.context.close()
    assert run.node.end() == 0, run.node.said
    same = encircle.run("sim1", link="memory", overrides=[LOSSY])
    assert run.node.printed()["digest"] == same.digest
