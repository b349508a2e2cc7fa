"""A bundle of a small study, and reports that are made once for each table."""

import pytest
from helpers_bundles import packed, study_of

from encircle.bundles import packing, report_checks
from encircle.bundles.bundle_plan import plan_text
from encircle.bundles.table_text import table_text


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    return study_of(tmp_path_factory.mktemp("bundled"))


@pytest.fixture(scope="session")
def bundle(study, tmp_path_factory):
    """Without recordings: nothing is run again unless rows are asked for."""
    return packed(study, tmp_path_factory.mktemp("bundle") / "small.zip")


@pytest.fixture(scope="session")
def recorded_bundle(study, tmp_path_factory):
    return packed(study, tmp_path_factory.mktemp("recorded") / "small.zip", 1)


REPORTS = {}


@pytest.fixture(autouse=True)
def reports_made_once(monkeypatch):
    """The same plan and table give the same report, which takes seconds to draw."""
    make = report_checks.report_members

    def remembered(plan, table):
        text = table_text(plan, [{**row, "wall_s": 0.0} for row in table.read().to_pylist()])
        key = plan_text(plan), text
        if key not in REPORTS:
            REPORTS[key] = make(plan, table)
        return dict(REPORTS[key])

    for module in (report_checks, packing):
        monkeypatch.setattr(module, "report_members", remembered)
