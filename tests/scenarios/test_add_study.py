"""The study of docs/add_study.md runs as it stands there: files, numbers, picture, page and recording."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from pyarrow import parquet
from run_here import ROOT, check_files

MOST = 150  #: Lines of a study.
NAMED = re.compile(r"`payload/(\w+\.py)`:\n\n```python\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "payload"
    folder.mkdir()
    for name, code in NAMED.findall((ROOT / "docs" / "add_study.md").read_text()):
        (folder / name).write_text(code)
    command = [sys.executable, folder / "payload.py", "--quick", "--seeds", "2", "--out", folder / "out"]
    return folder / "out", subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.study
def test_it_leaves_what_every_study_leaves_and_is_short(run):
    check_files(run, "payload.png")
    files = list(run[0].parent.glob("*.py"))
    assert {file.name for file in files} == {"payload.py"}
    assert sum(len(file.read_text().splitlines()) for file in files) <= MOST


@pytest.mark.study
def test_its_numbers_are_those_of_its_trials(run):
    out, _ = run
    report = json.loads((out / "report.json").read_text())
    rows = parquet.read_table(out / "trials.parquet").to_pylist()
    assert {row["name"] for row in rows} == {"Joints", "MLS56", "MGCO56 + prior"}
    cells = report["cells"]["errors"]
    assert len(cells) == 3 * 4
    for cell in cells:
        own = [
            r["rms_um"] for r in rows if (r["name"], r["payload_kg"]) == (cell["name"], cell["payload_kg"])
        ]
        assert cell["rms_um"]["median"] == pytest.approx(np.median(own))
    plain, filled = (
        np.median([row["rms_um"] for row in rows if (row["name"], row["payload_kg"]) == (name, 150.0)])
        for name in ("MLS56", "MGCO56 + prior")
    )
    pair = next(row for row in report["rivals"] if row["theirs"] == "MLS56")
    assert (pair["ours"], report["at"]) == ("MGCO56 + prior", {"payload_kg": 150.0})
    assert pair["ours_error"]["median"] == pytest.approx(filled)
    assert pair["theirs_error"]["median"] == pytest.approx(plain)
