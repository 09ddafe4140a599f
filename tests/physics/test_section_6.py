"""Section 6: the paper's statements judged by made-up seeds, and what may fill MGCO68."""

import json

import pytest
import section_6
from section_6 import CANDIDATES

from testbench.report.table import Row, Trials
from testbench.studies.paper import SECTION_6

SEEDS = 100


def verdicts(factor):
    """What is said where a model's check error is so many times the paper's MGCO56's, a number a seed."""
    check = {"check": {"rms_mm": 0.2, "max_relative_percent": 6.0, "max_mm": 0.4}}
    models = [
        Row(
            name=name,
            constraint="none" if name.startswith("MLS") else "psd",
            conservative=not name.startswith("MLS"),
            identification=Row(rms_mm=0.1),
            check=Row(check["check"]),
        )
        for name in SECTION_6
    ]
    rows = [
        {"name": name, "seed": seed, "check.rms_mm": 0.2 * factor.get(name, 1.0) * (1 + 0.01 * k)}
        for seed in range(SEEDS)
        for k, name in enumerate(SECTION_6)
    ]
    trials = Trials.holding({key: [row[key] for row in rows] for key in rows[0]})
    return {row.claim: row for row in section_6._judged(Row(models=models), trials)}


def test_a_model_is_the_best_where_it_errs_least_in_most_seeds():
    claim = "MGCO68 is the most accurate model in the check (Table III)"
    assert verdicts({"MGCO68": 0.5})[claim].verdict == "confirmed"
    assert verdicts({"MGCO68": 5.0})[claim].verdict == "contradicted"
    largest = "MGCO56 has the largest check error of the GCO models"
    assert verdicts({"MGCO56": 3.0})[largest].verdict == "confirmed"
    assert verdicts({"MGCO47": 3.0})[largest].verdict == "contradicted"
    same = "MGCO68 and MLS56 are nearly the same"
    assert verdicts({})[same].verdict == "confirmed"
    assert verdicts({"MLS56": 1.2})[same].verdict == "not confirmed"


@pytest.mark.parametrize("normal", [96, 94])
def test_the_table_has_a_row_a_candidate(tmp_path, monkeypatch, normal):
    monkeypatch.setattr(section_6, "_judged", lambda *_: iter(()))
    monkeypatch.setattr(section_6, "read_report", lambda _: Row(numbers={}))
    monkeypatch.setattr(section_6.Trials, "read", lambda _: None)
    own = {"median": 0.1, "p05": 0.05, "p95": 0.2, "least": 0.01, "most": 0.3, "trials": SEEDS}
    rows = [{"what": one.what, "fit_mm": own, "check_mm": own, "as_small": 3.0} for one in CANDIDATES]
    (tmp_path / "s.json").write_text(json.dumps({"seeds": SEEDS, "normal": [normal, 100], "rows": rows}))
    found = section_6.tables(tmp_path, tmp_path / "s.json")
    assert len(found["candidates"].rows) == len(CANDIDATES)
    said = found["claims"].rows[0].verdict
    assert said == ("confirmed" if normal >= 95 else "not confirmed")
