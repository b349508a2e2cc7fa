"""The report of a study: its HTML, its numbers against the table, hostile names, edge cases."""

import base64
import csv
import json
import re
from contextlib import closing

import numpy as np
import pytest
from helpers_pages import Page
from helpers_studies import (
    ARMS,
    LOSS,
    MEASURED,
    VERSIONS,
    Truth,
    filled,
    loss_only,
    never,
    study_plan,
)
from scipy import stats

from encircle.studies.charts.charts import Chart
from encircle.studies.report import report
from encircle.studies.report.report import write_report
from encircle.studies.report.sentences import settings_text, summary_sentences, verdict_text
from encircle.studies.report.setup_text import seeds_text, setup_rows
from encircle.studies.summary import summarise

STRATEGIES = ["xi-star", "xi-0"]
LINES = {"axes": [LOSS], "strategies": STRATEGIES, "seeds": 12}
COMMAND = "encircle study loss --set 'team.strategy=\"xi-0\"' --seeds 12"
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


@pytest.fixture
def quick(monkeypatch):
    """Replace figures by a single pixel, because most tests here do not look at them."""

    def write(_summary, directory):
        path = directory / "pixel.png"
        path.write_bytes(PIXEL)
        return (Chart(path, "A <caption>.", 'An "alt" text.', True),)

    monkeypatch.setattr(report, "write_charts", write)


def written(directory, truth=loss_only, date="", **changes):
    """The page of a simulated study, its summary and its rows."""
    plan = study_plan(**changes)
    with closing(filled(plan, directory, truth)) as table:
        summary = summarise(plan, table)
        path = write_report(plan, table, directory, COMMAND, summary=summary, date=date)
        return Page(path.read_text(encoding="utf-8")), summary, table.read().to_pandas()


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """Directory of a study of packet loss and two strategies, and what ``written`` returns."""
    directory = tmp_path_factory.mktemp("lines") / "t"
    expected = {"title": "On loss", "question": "How much loss?", "tolerated_rate": 0.6}
    return directory, *written(directory, **expected, **LINES)


def test_the_page_is_well_formed_and_needs_nothing_else(lines):
    directory, page, _summary, _rows = lines
    tags = [tag for tag, _ in page.seen]
    assert tags.count("h1") == tags.count("main") == tags.count("title") == 1
    assert not {"script", "link", "iframe", "object", "base"} & set(tags)
    assert not re.search(r"https?:|url\(|@import|javascript:| on\w+=", page.text)
    assert ("html", {"lang": "en"}) in page.seen
    assert all(given.get("scope") in ("row", "col") for tag, given in page.seen if tag == "th")
    names = [path.name for path in sorted((directory / "figures").glob("*.png"))]
    assert len(page.images) == len(names) == 5
    inside = set()
    for image in page.images:
        assert len(image["alt"]) > 20
        head, _, coded = image["src"].partition(",")
        assert head == "data:image/png;base64"
        inside.add(base64.b64decode(coded, validate=True))
        assert int(image["width"]) > 500
    assert inside == {(directory / "figures" / name).read_bytes() for name in names}
    assert [text.split(".")[0] for text in page.words["figcaption"]] == [
        f"Figure {k}" for k in range(1, 6)
    ]


def test_the_same_table_gives_the_same_page_and_a_date_only_if_given(tmp_path, quick):
    tree = {"axes": [LOSS], "seeds": 3}
    pages = [written(tmp_path / name, **tree)[0].text for name in ("a", "b")]
    assert pages[0] == pages[1]
    dated = written(tmp_path / "c", date="7 May 2031", **tree)[0]
    assert dated.words["p"][0].endswith(" 7 May 2031")
    assert dated.text.replace(" 7 May 2031", "") == pages[0]


def test_findings_question_and_command_stand_on_the_page(lines):
    _directory, page, summary, _rows = lines
    assert page.words["h1"] == page.words["title"] == ["On loss"]
    assert "How much loss?" in page.words["p"]
    first, along, overall = summary_sentences(summary)
    assert {first, along} <= set(page.words["li"])
    assert page.words["h3"] == ["xi-0 against xi-star"]
    assert overall.endswith(settings_text(summary.plan, summary.comparisons))
    assert settings_text(summary.plan, summary.comparisons) in page.words["p"]
    assert COMMAND in page.words["pre"]
    expected = (
        "5 comparisons and 1 averaged over settings, each of capture rate, order and mean time,"
    )
    assert any(
        f"{expected} are 18 tests: their p are corrected" in text for text in page.words["p"]
    )
    plan = summary.plan
    assert ["Fingerprint of the configuration", plan.fingerprint] in page.table("What was run")
    assert ["Digest of the code", "c0de"] in page.table("What was run")
    shown = ", ".join(f"{name} {version}" for name, version in VERSIONS.items())
    assert ["Versions", shown] in page.table("What was run")


def test_each_comparison_is_a_heading_with_a_row_for_each_setting(lines):
    _directory, page, summary, rows = lines
    head, average, *body = page.table("xi-0 against xi-star")
    assert (head[0], head[-1]) == ("packet loss (%)", "What is decided")
    assert average[0] == "all 5, averaged"
    pairs = rows.pivot(index="seed", columns=["loss", "strategy"], values=["captured", "ticks"])
    for line, loss, one in zip(body, LOSS["values"], summary.comparisons, strict=True):
        captured, ticks = pairs["captured"][loss], pairs["ticks"][loss]
        points = 100 * (captured["xi-0"] - captured["xi-star"]).mean()
        seconds = 0.1 * (ticks["xi-0"] - ticks["xi-star"]).mean()
        assert line[0] == f"{100 * loss:g}"
        assert line[1].split()[0] == f"{points:+z.0f}"
        assert line[5].split()[0] == f"{seconds:+z.1f}"
        assert line[-1] == verdict_text(one)


def test_without_settings_each_level_is_a_row(tmp_path, quick):
    page, summary, _rows = written(tmp_path / "t", axes=[ARMS], compare="radio", seeds=3)
    names = [arm["name"] for arm in ARMS["arms"]]
    assert page.words["h3"] == [f"radio against {names[0]}"]
    _head, *body = page.table("radio against")
    assert [line[0] for line in body] == names[1:]
    assert len(summary_sentences(summary)) == 1 + len(body)


def test_many_findings_are_folded_but_all_there(tmp_path, quick):
    many = {"name": "arm", "arms": [{"name": f"a{k}", "set": {}} for k in range(12)]}
    tree = {"axes": [many, LOSS], "compare": "arm", "seeds": 2}
    page, summary, _rows = written(tmp_path / "t", **tree)
    assert page.words["h3"] == [f"a{k} against a0" for k in range(1, 12)]
    assert "3 more comparisons" in page.words["summary"]
    # The range of rates, the tolerated levels along the only axis, and the comparisons.
    assert len(summary_sentences(summary)) == 1 + 1 + 11
    long = {**LOSS, "values": [0.01 * k for k in range(17)]}
    tree = {"axes": [long], "strategies": STRATEGIES, "seeds": 2}
    page, summary, _rows = written(tmp_path / "l", **tree)
    assert "xi-0 against xi-star: 18 rows" in page.words["summary"]
    assert len(page.table("xi-0 against xi-star")) == 1 + 18


def test_there_is_no_effect_size_where_all_runs_of_an_arm_are_censored(tmp_path, quick):
    def truth(levels):
        return never(levels) if levels["strategy"] == "xi-0" else Truth(6.0)

    page, summary, _rows = written(tmp_path / "t", truth, strategies=STRATEGIES, seeds=12)
    (one,) = summary.comparisons
    assert one.time_s.mean.value > 0.0
    assert np.isnan(one.time_s.effect_size.value)
    assert not any("d_z" in sentence for sentence in summary_sentences(summary))
    head, line = page.table("Comparisons")
    assert line[head.index("d_z")] == "\N{EN DASH}"


def test_cells_have_the_tables_numbers(lines):
    directory, page, summary, rows = lines
    head, *body = page.table("Cells")
    assert head[:4] == ["packet loss (%)", "strategy", "Runs", "Captured"]
    assert len(body) == 10
    for line, cell in zip(body, range(10), strict=True):
        runs = rows[rows["cell"] == cell]
        captured, seconds = int(runs["captured"].sum()), 0.1 * runs["ticks"]
        low, high = stats.binomtest(captured, 12).proportion_ci(method="wilson")
        assert line[:4] == [f"{20 * (cell // 2)}", STRATEGIES[cell % 2], "12", f"{captured}"]
        assert line[4] == f"{captured / 0.12:.1f} [{100 * low:.1f}, {100 * high:.1f}]"
        assert line[5].split(" ")[0] == f"{seconds.mean():.2f}"
        expected = np.sort(seconds)[5] if captured >= 6 else None
        assert line[6] == ("\N{EN DASH}" if expected is None else f"{expected:.2f}")
    with open(directory / "summary.csv", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [float(line["capture_rate"]) for line in lines] == pytest.approx(
        [cell.rate.value for cell in summary.cells]
    )


def test_comparisons_have_the_tables_numbers(lines):
    _directory, page, summary, rows = lines
    head, *body = page.table("Comparisons with strategy xi-star, which is subtracted, on 12")
    assert head[:2] == ["strategy", "packet loss (%)"]
    for index, line in enumerate(body):
        base, other = (
            rows[rows["cell"] == 2 * index + k].sort_values("seed").reset_index() for k in (0, 1)
        )
        assert line[:2] == ["xi-0", f"{20 * index}"]
        change = 100 * (other["captured"] - base["captured"]).mean()
        assert float(line[2].split(" ")[0]) == pytest.approx(change, abs=0.05 + 1e-9)
        won = int((other["captured"] > base["captured"]).sum())
        lost = int((other["captured"] < base["captured"]).sum())
        assert line[3] == f"{won} / {lost}"
        p = stats.binomtest(won, won + lost).pvalue if won + lost else 1.0
        assert line[5] == f"{summary.comparisons[index].rate.p_corrected:.3f} ({p:.3f})"
        late, base_late = (x["ticks"] + 1000 * (1 - x["captured"]) for x in (other, base))
        assert line[6] == f"{(late > base_late).sum()} / {(late < base_late).sum()}"
        seconds = 0.1 * (other["ticks"] - base["ticks"])
        assert float(line[9].split(" ")[0]) == pytest.approx(seconds.mean(), abs=0.005 + 1e-9)
        assert float(line[10].split(" ")[0]) == pytest.approx(
            seconds.mean() / seconds.std(ddof=1), abs=0.005 + 1e-9
        )
    assert len(body) == 5


def test_tolerances_are_in_the_unit_of_the_axis(lines):
    _directory, page, summary, _rows = lines
    _head, *body = page.table(
        "Up to which level the capture rate stays at or above 60 %, or from which on"
    )
    assert [line[:2] for line in body] == [
        ["packet loss (%)", f"strategy {name}"] for name in STRATEGIES
    ]
    for line, one in zip(body, summary.tolerances, strict=True):
        if one.level.value < 0.8:
            assert float(line[2]) == pytest.approx(100 * one.level.value, rel=5e-3)
        assert line[3].startswith("[")


def test_levels_that_are_never_or_always_reached_are_told_in_words(tmp_path, quick):
    page, _summary, _rows = written(tmp_path / "n", never, axes=[LOSS], seeds=4)
    level, interval = page.table("Up to which")[1][2:]
    assert level == "none (below from 0 on)"
    assert interval.startswith("[below 0, ")
    page, _summary, _rows = written(
        tmp_path / "a", lambda _levels: Truth(0.3), axes=[LOSS], seeds=4
    )
    level, interval = page.table("Up to which")[1][2:]
    assert level == "80, the last"
    assert interval.endswith("beyond 80]")


def test_every_measure_is_there_with_its_unit_and_its_mean(lines, tmp_path, quick):
    _directory, page, _summary, rows = lines
    assert "age_ticks_mean (tick)" in page.words["summary"]
    head, *body = page.table("age_ticks_mean")
    assert head == ["packet loss (%)", "strategy", "Mean (tick)"]
    for cell, line in enumerate(body):
        mean = rows[rows["cell"] == cell]["age_ticks_mean"].mean()
        assert line[2].split(" ")[0] == f"{mean:.4g}"
    few, _summary, rows = written(tmp_path / "f", axes=[ARMS], seeds=3)
    head, *body = few.table("Means over runs")
    assert head == ["Measure", "Unit", *(f"radio {arm['name']}" for arm in ARMS["arms"])]
    assert [line[0].split(":")[0] for line in body] == [*MEASURED, "delay_s_mean"]


def test_hostile_names_are_shown_and_do_nothing(tmp_path, quick):
    names = ["<script>alert(1)</script>", '"><img src=x onerror=y>', "a & b", "$x^2", "_under"]
    page, _summary, _rows = written(
        tmp_path / "t",
        title="<script>alert(2)</script>",
        question="Is 1 < 2 && 'so'?",
        name="</title><b>",
        axes=[
            {
                "name": "arm",
                "label": "<i>arm</i>",
                "unit": '"%',
                "arms": [{"name": name, "set": {}} for name in names],
            }
        ],
        compare="arm",
        seeds=2,
    )
    assert not {"script", "b", "i"} & {tag for tag, _ in page.seen}
    assert page.words["h1"] == ["<script>alert(2)</script>"]
    assert "Is 1 < 2 && 'so'?" in page.words["p"]
    assert [line[0] for line in page.table("Cells")[1:]] == names
    assert all(image["src"].startswith("data:image/png;base64,") for image in page.images)


def test_a_single_run_has_a_whole_report(tmp_path, quick):
    page, _summary, rows = written(tmp_path / "t", seeds=1)
    head, line = page.table("Cells")
    assert head[0] == "Cell"
    assert line[1:3] == ["1", f"{int(rows['captured'][0])}"]
    assert line[4] == f"{0.1 * rows['ticks'][0]:.2f}"
    assert "Comparisons" not in "".join(page.words["caption"])
    assert "comparison" not in page.text
    assert "nan" not in re.sub(r"base64,[^\"]*", "", page.text)


@pytest.mark.parametrize("truth", [never, lambda _levels: Truth(0.1)])
def test_alike_ends_give_a_whole_report(tmp_path, quick, truth):
    page, summary, _rows = written(tmp_path / "t", truth, **LINES)
    rate = 100.0 * summary.cells[0].rate.value
    assert {line[4].split(" ")[0] for line in page.table("Cells")[1:]} == {f"{rate:.1f}"}
    assert not re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", page.text))


def test_long_tables_are_cut_and_say_so(tmp_path, quick, monkeypatch):
    monkeypatch.setattr("encircle.studies.report.result_tables.ROWS_MAX", 3)
    monkeypatch.setattr("encircle.studies.report.result_tables.MEASURED_ROWS_MAX", 2)
    page, _summary, _rows = written(tmp_path / "t", **LINES)
    assert len(page.table("Cells")) == 4
    assert any(c.endswith("; the first 3 of 10, all in summary.csv") for c in page.words["caption"])
    assert len(page.table("age_ticks_mean")) == 3


def test_the_set_up_is_told_in_words_and_in_full(lines):
    _directory, page, summary, _rows = lines
    expected = {
        line[0]: line[1] for line in page.table("The scenario, all axes at their first level")
    }
    assert expected["Robots' bodies"] == "radius 0.5 m; at most 0.3 m per tick (3 m/s); holonomic"
    assert expected["Strategy"] == "xi-star [varied: strategy]"
    assert expected["Radio"] == "loss bernoulli; no delay [varied: packet loss]"
    assert expected["Time"] == "ticks of 0.1 s, at most 300 ticks (30 s)"
    assert expected["Seeds"] == "12, from 1 to 12, the same in every cell"
    assert page.table("What is varied")[1:] == [
        ["packet loss (%)", "channel.loss.rate", "0, 20, 40, 60, 80"],
        ["strategy", "team.strategy", "xi-star, xi-0"],
    ]
    tree = json.loads(page.words["pre"][0])
    assert tree["channel"]["loss"]["model"] == "bernoulli"
    assert tree["ticks_max"] == summary.plan.scenario_of(0).ticks_max


def test_the_set_up_tells_of_any_radio_and_event():
    plan = study_plan(
        seeds=1,
        set={
            "channel.loss.model": "gilbert-elliott",
            "channel.loss.good_to_bad": 0.25,
            "channel.order": "kept",
            "events": [{"kind": "silence", "tick": 3, "ticks": 4, "robot": "r1"}],
            "team.motion": "unicycle",
            "robot.publish_every_ticks": 2,
        },
    )
    expected = dict(setup_rows(plan))
    assert expected["Radio"] == "loss gilbert-elliott, good_to_bad = 0.25; no delay; order kept"
    assert expected["Events"] == "silence, tick = 3, ticks = 4, robot = r1"
    assert "unicycle, turning by at most 0.524 rad per tick" in expected["Robots' bodies"]
    assert expected["Robots' parameters"] == "publish_every_ticks = 2"


@pytest.mark.parametrize(
    ("changes", "radio"),
    [
        (
            {"channel.loss": {"model": "path-loss", "range_m": 9.0, "shadowing_db": 6.0}},
            "loss path-loss, range_m = 9, shadowing_db = 6; no delay",
        ),
        (
            {"channel.contention": {"access": "slotted-aloha", "packet_s": 0.01}},
            "no loss; no delay; contention access = slotted-aloha, packet_s = 0.01",
        ),
        (
            {"channel.profile": "4g"},
            "loss burst, rate = 0.0022, burst_packets = 4.7; delay lognormal, mean_s = 0.118,"
            " std_s = 0.0082",
        ),
    ],
)
def test_the_set_up_tells_of_signals_contention_and_profiles(changes, radio):
    assert dict(setup_rows(study_plan(seeds=1, set=changes)))["Radio"] == radio


SLOW_R3 = "team.robots.r3.step_m_max"


def test_the_set_up_tells_which_robots_differ_and_in_what():
    changes = {
        "team.robots": 4,
        SLOW_R3: 0.15,
        "team.robots.r3.radio_range_m": 4.0,
        "team.robots.r1.strategy": "pursuit",
        "team.robots.r2": {"sensing_range_m": 2.0, "loss_rate": 0.25},
        "sensing.localisation_noise_m_std": 0.1,
        "sensing.localisation_drift_m_per_sqrt_s": 0.05,
    }
    scenario = {"ticks_max": 5, "team": {"robots": 4}}
    rows = dict(setup_rows(study_plan(seeds=1, scenario=scenario, axes=[], set=changes)))
    assert rows["Robots"].startswith("4; ")
    assert rows["Strategy"] == "xi-star, but pursuit for r1"
    assert "at most 0.3 m per tick (3 m/s), but 0.15 m for r3; holon" in rows["Robots' bodies"]
    assert rows["Robots' sensors"] == (
        "range 6 m, but 2 m for r2, 24 rays, own position with noise 0.1 m and drift 0.05 m/sqrt(s)"
    )
    assert rows["Radio"].endswith("; loss of 0.25 by r2's radio, range 4 m for r3")


def test_an_axis_over_one_robot_is_named_where_the_set_up_tells_of_that_robot():
    axes = [
        {"name": "slow", "key": SLOW_R3, "values": [0.3, 0.1]},
        {"name": "near", "key": "team.robots.r3.radio_range_m", "values": [9.0, 3.0]},
        {"name": "policy", "key": "team.robots.r1.strategy", "values": ["xi-0", "pursuit"]},
    ]
    rows = dict(setup_rows(study_plan(seeds=1, axes=axes)))
    varied = {name: text.partition(" [varied: ")[2] for name, text in rows.items()}
    assert {name: text for name, text in varied.items() if text} == {
        "Strategy": "policy]",
        "Robots' bodies": "slow]",
        "Radio": "near]",
    }


def test_arms_tell_what_they_set():
    plan = study_plan(axes=[ARMS], seeds=1)
    rows = report.axis_rows(plan, plan)
    assert rows[0][1] == "ticks_max"
    assert rows[0][2].startswith("independent losses: ticks_max = 300; bursts of")


@pytest.mark.parametrize(
    ("seeds", "text"),
    [((5,), "1: 5"), ((1, 2, 3), "3, from 1 to 3"), ((1, 3, 9), "3: 1, 3, 9")],
)
def test_seeds_in_words(seeds, text):
    assert seeds_text(seeds) == text


def test_a_table_with_runs_missing_is_not_reported(tmp_path, quick):
    plan = study_plan(seeds=2)
    with closing(filled(plan, tmp_path / "t")) as table:
        table.done[0, 1] = False
        with pytest.raises(AssertionError, match="1 runs are missing"):
            write_report(plan, table, tmp_path / "t", COMMAND)
