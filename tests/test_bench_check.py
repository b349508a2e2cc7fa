"""``make bench-check`` names what has become slower, by ratios alone."""

import json
import subprocess
import sys

from helpers_paths import ROOT

RECORDED = {
    "machine": {"cpu": "any"},
    "a_lock_step": [
        {"robots": 4, "ratio_to_bare": 0.3, "ratio_to_mango": None},
        {"robots": 16, "ratio_to_bare": 0.2},
    ],
    "c_decisions": [{"robots": 4, "ratio": 3.0, "decision_us": 60.0}],
    "e_studies": {"scaling_one_to_two": 1.9},
}


def checked(folder, now, *options):
    for name, results in (("recorded", RECORDED), ("now", now)):
        (folder / f"{name}.json").write_text(json.dumps(results))
    files = [str(folder / "now.json"), "--recorded", str(folder / "recorded.json")]
    script = [sys.executable, str(ROOT / "bench" / "check.py")]
    done = subprocess.run([*script, *files, *options], capture_output=True, text=True)
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()


def changed(**rows):
    return RECORDED | rows


def test_the_same_or_faster_is_fine_and_times_do_not_count(tmp_path):
    rows = [{"robots": 4, "ratio": 1.0, "decision_us": 9999.0}]
    status, lines = checked(tmp_path, changed(c_decisions=rows))
    assert status == 0
    assert len(lines) == 4
    assert all(line.startswith("ok ") for line in lines)


def test_what_is_slower_is_named_whichever_way_its_ratio_counts(tmp_path):
    now = changed(
        a_lock_step=[{"robots": 4, "ratio_to_bare": 0.29}, {"robots": 16, "ratio_to_bare": 0.1}],
        c_decisions=[{"robots": 4, "ratio": 4.6}],
    )
    status, lines = checked(tmp_path, now)
    assert status == 1
    assert [line for line in lines if line.startswith("SLOWER")] == [
        "SLOWER hunt over Zenoh / bare barrier, 16 robots: 0.2 on record, 0.1 now",
        "SLOWER a decision / its bare arithmetic, 4 robots: 3 on record, 4.6 now",
    ]
    assert checked(tmp_path, now, "--margin", "2.5")[0] == 0


def test_what_one_of_them_did_not_measure_is_told(tmp_path):
    status, lines = checked(tmp_path, changed(e_studies={}))
    assert status == 0
    assert lines[-1].startswith("missing study with two workers / with one")


def test_every_ratio_on_record_has_a_name():
    """Of keys that say that they are ratios, none is passed over."""
    recorded = json.loads((ROOT / "bench" / "results.json").read_text())

    def keys(part):
        if isinstance(part, dict):
            return {k for k, v in part.items() if v is not None} | keys(list(part.values()))
        return set().union(*map(keys, part)) if isinstance(part, list) else set()

    named = (ROOT / "bench" / "check.py").read_text()
    told = {key for key in keys(recorded) if "ratio" in key or "_over_" in key}
    assert told
    assert [key for key in sorted(told) if f'"{key}":' not in named] == []
