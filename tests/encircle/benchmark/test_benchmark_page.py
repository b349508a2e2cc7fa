"""The benchmark's page: well-formed, its numbers those of the runs, its sentences within them."""

import csv
import re

import numpy as np
import pytest
from helpers_benchmark import made_outcomes
from helpers_pages import Page

from encircle.benchmark.charts import draw_scores
from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.page import SCORES_FILE, TASKS_FILE, Origin, Submission, write_page
from encircle.benchmark.score import scores, share_interval
from encircle.benchmark.sentences import (
    difference_from,
    held_out_sentence,
    held_ranks,
    own_sentences,
    percent,
    table_sentences,
)
from encircle.statistics.intervals import Interval

NAME = "Jane's <b>auction</b>"
ORIGIN = Origin("c0de", "c0de", ("encircle benchmark mine.py:mine --name Jane",))


def with_own(rate, seeds=20):
    """Outcomes of two shipped policies and one of one's own, and its held-out runs."""
    outcomes = made_outcomes([0.8, 0.2, rate], seeds, names=["good", "bad", NAME])
    held_out = made_outcomes([rate], seeds, seed=9, names=[NAME])
    return outcomes, Submission(NAME, "mine.py:mine", held_out)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Directory, parsed page and outcomes of a submission."""
    directory = tmp_path_factory.mktemp("page") / "p"
    outcomes, submission = with_own(0.5)
    path = write_page(outcomes, ORIGIN, directory, submission)
    return directory, Page(path.read_text(encoding="utf-8")), outcomes


def test_the_page_is_well_formed_and_needs_nothing_else(written):
    _directory, page, _outcomes = written
    tags = [tag for tag, _ in page.seen]
    assert tags.count("h1") == tags.count("main") == 1
    assert not {"script", "link", "iframe", "b"} & set(tags)
    assert not re.search(r"https?:|url\(|@import|javascript:| on\w+=", page.text)
    assert len(page.images) == 3
    assert all(image["alt"] for image in page.images)
    assert any(NAME in heading for heading in page.words["h1"])


def test_the_table_has_every_policy_s_score(written):
    _directory, page, outcomes = written
    head, *rows = page.tables[0]
    assert head[0] == "Policy"
    by_hand = dict(zip(outcomes.policies, outcomes.captured.mean(axis=(1, 2)), strict=True))
    assert {row[0]: float(row[1].split()[0]) for row in rows} == pytest.approx(
        {name: 100 * share for name, share in by_hand.items()}, abs=0.051
    )
    assert [row[0] for row in rows] == ["good", NAME, "bad"]


def test_the_csv_files_have_the_same_numbers(written):
    directory, _page, outcomes = written
    with open(directory / SCORES_FILE, newline="") as file:
        rows = {row["policy"]: row for row in csv.DictReader(file)}
    for score in scores(outcomes).of:
        assert float(rows[score.policy]["low"]) == pytest.approx(score.over_all.low)
        assert float(rows[score.policy]["rank_1_share"]) == pytest.approx(score.rank_shares[0])
    with open(directory / TASKS_FILE, newline="") as file:
        tasks = list(csv.DictReader(file))
    assert [float(row["bad"]) for row in tasks] == pytest.approx(outcomes.capture_shares[1])


def test_the_same_runs_give_the_same_page(written, tmp_path):
    directory, page, outcomes = written
    submission = with_own(0.5)[1]
    path = write_page(outcomes, ORIGIN, tmp_path / "again", submission)
    assert path.read_text(encoding="utf-8") == page.text
    names = sorted(path.name for path in (directory / "figures").iterdir())
    assert names == [
        f"{stem}.{kind}" for stem in ("ranks", "scores", "tasks") for kind in ("pdf", "png")
    ]


def test_a_page_of_all_policies_has_no_held_out_seeds(tmp_path):
    outcomes = made_outcomes([0.8, 0.2])
    page = Page(write_page(outcomes, ORIGIN, tmp_path / "p").read_text(encoding="utf-8"))
    assert "Public and held-out seeds" not in page.text
    assert "20 of 100 public seeds" in page.text


def test_few_seeds_are_called_a_try(written):
    assert "This is a try" in written[1].text
    assert "a try" not in "".join(table_sentences(scores(made_outcomes([0.8, 0.2], 100)), 100))


def test_failed_runs_are_told(tmp_path):
    outcomes, submission = with_own(0.5)
    path = write_page(outcomes, ORIGIN, tmp_path / "p", submission._replace(failed=7))
    assert "7 of its 240 runs failed" in path.read_text(encoding="utf-8")


def test_what_is_decided_is_said_and_what_is_not_is_undecided():
    ranked = scores(with_own(0.5, seeds=60)[0])
    sentence = own_sentences(ranked, NAME)[2]
    assert "decidedly higher than bad" in sentence
    assert "decidedly lower than good" in sentence
    assert "undecided" not in sentence
    same = made_outcomes([0.5], names=["other"])
    ticks = same.capture_ticks[[0, 0]]
    twins = Outcomes(("other", NAME), same.tasks, same.seeds, ticks, same.limit_ticks)
    sentence = own_sentences(scores(twins), NAME)[2]
    assert "undecided against other" in sentence
    assert "decidedly" not in sentence


@pytest.mark.parametrize("own", ["good", "bad", NAME])
def test_a_difference_is_the_same_from_either_side(own):
    ranked = scores(with_own(0.5)[0])
    means = {score.policy: score.over_seeds.value for score in ranked.of}
    for other in set(means) - {own}:
        one, back = difference_from(ranked, other, own), difference_from(ranked, own, other)
        assert one.mean.value == pytest.approx(means[own] - means[other])
        assert one.mean == pytest.approx((-back.mean.value, -back.mean.high, -back.mean.low))
        assert (one.better, one.p_corrected) == (back.worse, back.p_corrected)
        assert {one.verdict, back.verdict} in ({"higher", "lower"}, {"undecided"})


def test_the_held_out_score_is_called_other_only_outside_its_interval():
    near = held_out_sentence("J", Interval(0.6, 0.55, 0.65), Interval(0.58, 0.53, 0.63))
    assert "-2.0 [-9.1, +5.1] points" in near
    assert "undecided" in near
    far = held_out_sentence("J", Interval(0.8, 0.78, 0.82), Interval(0.5, 0.45, 0.55))
    assert "better on the public seeds" in far
    other = held_out_sentence("J", Interval(0.5, 0.45, 0.55), Interval(0.8, 0.78, 0.82))
    assert "worse on the public seeds" in other
    one = held_out_sentence("J", Interval(0.5), Interval(0.9))
    assert "On the held-out seed J scores 90.0 %, +40.0 points" in one
    assert "no bounds, of a single seed, and is undecided" in one


def test_of_a_single_seed_no_sentence_has_bounds_or_resamples():
    ranked = scores(with_own(0.5, seeds=1)[0])
    for lines in (own_sentences(ranked, NAME), table_sentences(ranked, 1)):
        text = " ".join(lines)
        assert "Of a single seed there are no bounds" in text
        assert "of a single seed, which leaves nothing to resample" in text
        assert not re.search(r"\[|nan|of the resamples|no bounds with", text)
    assert [held_ranks(score) for score in ranked.of] == [""] * 3


def test_the_figure_of_a_single_seed_s_scores_shows_no_intervals():
    for seeds, segments in ((1, 0), (2, 4)):
        drawn = draw_scores(scores(made_outcomes([0.8, 0.2], seeds)))
        lines = [
            line.get_xdata() for line in drawn.figure.axes[0].lines if len(line.get_xdata()) > 1
        ]
        assert sum(bool(np.isfinite(ends).all()) for ends in lines) == segments
        assert ("no intervals" in drawn.caption) is (seeds == 1)


def test_ranks_that_are_rarely_held_are_not_named():
    (score,) = scores(made_outcomes([0.5])).of
    shares = np.array([0.9, 0.06, 0.04])
    assert held_ranks(score._replace(rank_shares=shares)) == "1 (90 %), 2 (6 %)"


def test_a_share_of_a_single_seed_has_no_bounds():
    assert percent(share_interval(np.array([0.25]))) == "25.0"
