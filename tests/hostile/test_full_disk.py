"""Every command that writes, on a full disk: one line, and earlier results as they were.

TESTBENCH_FULL_DISK=1 tries those too that compute for long.
"""

import os

import pytest

from testbench.cli.predict import COMMANDS
from testbench.runs.whole import remove

FULL = 600  #: Largest file that the disk takes [byte]: what the commands say fits, their results do not.
QUICK = {
    "new": "new made --from robot.urdf",
    "elastic": "check arm --elastic made/elastic.xml",
    "simulate": "simulate arm poses.csv --payload-kg 1 --out made.csv",
    "series": "simulate arm --absolute --poses 9 --series 2 --out made.csv",
    "check": "check arm --out made",
}
LONG = {
    "plan": "plan arm --absolute --poses 12 --candidates 60 --out made",
    "plan_tasks": "plan arm --task poses.csv --load 1 --poses 2 --candidates 60 --out made",
    "study": "study single_link --quick --seeds 1 --workers 1 --resume --out made",
    "data": "data check arm data.csv --out made",
    "identify": "identify arm many.csv --model MGCO56 --no-intervals --out made",
    "calibrate": "calibrate arm readings.csv --orders 1 --out made",
    "export": "export model --urdf made.urdf",
    "predict": "predict model loaded.csv --out made",
    "compensate": "compensate model loaded.csv --keep-unreachable --jumps --out made.csv",
    "compare": "compare model again --out made",
    "demo": "demo --quick --seeds 2 --workers 1 --out made",
}
SILENT = {"view"}  #: It writes nothing.
ELSEWHERE = {"bench"}  #: It writes as a study.
ASKED = QUICK | LONG if os.environ.get("TESTBENCH_FULL_DISK") else QUICK


@pytest.fixture(scope="module")
def cell(attack, stock, tmp_path_factory):
    """A folder with what the commands read, and what each left before."""
    lab = tmp_path_factory.mktemp("cell") / "lab"
    lab.mkdir()
    for path in stock.iterdir():
        (lab / path.name).symlink_to(path)
    if ASKED != QUICK:
        head, *rows = (lab / "poses.csv").read_text().splitlines()
        (lab / "loaded.csv").write_text("\n".join([f"{head},mass_kg", *(f"{row},10" for row in rows)]))
        for words in (
            "simulate arm --poses 12 --payload-kg 1 --out many.csv",
            "simulate arm --absolute --poses 40 --out readings.csv",
            "identify arm many.csv --no-intervals --model MGCO56 --out model",
            "identify arm many.csv --no-intervals --model MGCO56 --out again",
        ):
            assert attack(lab, *words.split()).code == 0
    return lab


def test_every_command_that_writes_is_tried():
    tried = {words.split()[0] for words in (QUICK | LONG).values()}
    assert tried == COMMANDS.keys() - SILENT - ELSEWHERE | {"study"}


@pytest.mark.parametrize("name", ASKED)
def test_a_full_disk_is_one_line_and_leaves_earlier_results(attack, cell, name):
    words = ASKED[name].split()
    if name != "new":  # it makes what is not there
        made = attack(cell, *words)
        assert made.code == 0, made
    refused = attack(cell, *words, largest=FULL)
    refused.refused("cannot be")
    assert ".new" not in refused.err
    for path in cell.glob("made*"):
        remove(path)
