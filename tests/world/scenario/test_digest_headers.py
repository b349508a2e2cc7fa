"""What a run's digest begins with is, byte for byte, what it was in version 0.1.0.

``tests/data/digest_headers_0_1_0.json`` was written by that version, before each model of loss and
delay had keys of its own: every model, with keys at their defaults and with others, for all links
and for some. Scenarios that it wrote out in full have the keys of all models in each table.
"""

import json
from pathlib import Path

import pytest

from encircle.world.loading.load import load
from encircle.world.scenario.delay_models import DELAY_MODELS
from encircle.world.scenario.loss_models import LOSS_MODELS
from encircle.world.scenario.model import digest_header

DATA = Path(__file__).parents[2] / "data"
CASES = json.loads((DATA / "digest_headers_0_1_0.json").read_text(encoding="utf-8"))
SEED = 7
FORMER_KEYS = {
    "loss": {
        "rate": 0.0,
        "good_to_bad": 0.0,
        "bad_to_good": 1.0,
        "loss_good": 0.0,
        "loss_bad": 1.0,
        "burst_packets": None,
        "midpoint_m": None,
        "width_m": None,
        "cutoff_m": None,
        "mode": "repeat",
        "values": None,
        "links": [],
    },
    "delay": {
        "mean_s": 0.0,
        "std_s": 0.0,
        "low_s": 0.0,
        "high_s": 0.0,
        "mode": "repeat",
        "values": None,
        "links": [],
    },
}


def loaded(case):
    return load(case.get("scenario", {"team": {"robots": 4}, "channel": case.get("channel")}))


@pytest.mark.parametrize(
    "case", CASES, ids=lambda case: str(case.get("scenario", case.get("channel")))
)
def test_the_header_is_what_it_was(case):
    assert digest_header(loaded(case), SEED) == case["header"]


def test_every_model_of_that_version_is_among_the_cases():
    for sort, models in (("loss", LOSS_MODELS), ("delay", DELAY_MODELS)):
        tables = [case["channel"][sort] for case in CASES if sort in case.get("channel", {})]
        names = {table.get("model") for table in tables} - {None}
        assert len(names) == 7
        assert names <= set(models)


@pytest.mark.parametrize(
    "case",
    [case for case in CASES if "links" not in case.get("channel", "links")],
    ids=lambda case: str(case["channel"]),
)
def test_a_table_with_the_keys_of_all_models_is_the_same_one(case):
    ((sort, table),) = case["channel"].items()
    whole = {**case, "channel": {sort: {**FORMER_KEYS[sort], **table}}}
    assert loaded(whole) == loaded(case)
    assert digest_header(loaded(whole), SEED) == case["header"]
