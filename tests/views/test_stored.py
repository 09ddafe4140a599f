"""A report of every study is read back from report.json as it was."""

import importlib
import json
from pathlib import Path
from typing import get_type_hints

import pytest
from made_up import fill

from testbench import studies
from testbench.errors import InputError
from testbench.studies.run import to_json
from testbench.studies.stored import report_of
from testbench.studies.study import TypedStudy


def study_of(name):
    return importlib.import_module(f"testbench.studies.{name}.study").STUDY


STUDIES = [file.parent.name for file in sorted(Path(studies.__file__).parent.glob("*/study.py"))]
NAMES = [name for name in STUDIES if isinstance(study_of(name), TypedStudy)]


@pytest.mark.parametrize("name", NAMES)
def test_a_report_is_read_back_as_it_was(name, rng):
    study = study_of(name)
    plain = json.loads(json.dumps(to_json(fill(get_type_hints(study.summary)["return"], rng))))
    assert to_json(report_of(study, Path("report.json"), plain)) == plain
    del plain["scenario"]
    with pytest.raises(InputError, match=r"report.json: scenario: not a report of this version: expected it"):
        report_of(study, Path("report.json"), plain)
