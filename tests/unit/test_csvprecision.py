"""Covariances and lost targets survive the CSV file bit by bit, or nearly; wrong ones are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbench.arm.folder import load_arm
from testbench.campaign.campaign import Scenario, build_cell, simulate
from testbench.data.read_pairs import read_csv
from testbench.data.tracker import LaserTracker, precision
from testbench.data.write import COVARIANCES as COLUMNS
from testbench.data.write import write_csv
from testbench.errors import InputError

KR500 = Path(__file__).resolve().parents[2] / "models" / "kr500_l480"
ARM = load_arm(KR500)
JOINTS = tuple(j.name for j in ARM.joints)


@pytest.fixture(scope="module")
def data():
    cell = build_cell(KR500)
    scenario = Scenario(arm="kr500_l480", identification_poses=2, identification_runs=2, workspace_poses=1)
    data = simulate(cell, scenario, 1).identification
    P = np.array(precision(LaserTracker((2.0, -4.0, 1.5)), data.before, data.after))
    P[1, 2] = 0
    return replace(data, precision=P)


@pytest.fixture
def file(data, tmp_path):
    path = tmp_path / "data.csv"
    write_csv(data, JOINTS, path)
    return path


def test_what_was_written_is_read_back(data, file):
    back = read_csv(file, ARM)
    np.testing.assert_allclose(back.precision, data.precision, rtol=1e-9, atol=1e-3)
    np.testing.assert_array_equal(back.seen, data.seen)
    np.testing.assert_array_equal(back.after[data.seen], data.after[data.seen])
    assert not back.deflection[1, 2].any()


def test_a_lost_target_is_a_row_of_empty_cells(file):
    line = file.read_text().splitlines()[1 + 3 + 2]
    assert line.split(",")[-6:] == [""] * 6
    assert line.count(",,") >= 4


def edit(file, row, name, value):
    lines = [line.split(",") for line in file.read_text().splitlines()]
    lines[row][lines[0].index(name)] = value
    file.write_text("\n".join(",".join(line) for line in lines) + "\n")


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (COLUMNS[0], "-1e-9", "line 2: expected a positive definite covariance"),
        (COLUMNS[0], "nan", f"line 2, column {COLUMNS[0]}: expected a finite number"),
        (COLUMNS[5], "", f"line 2, column {COLUMNS[5]}: expected a finite number"),
        ("before_x_m", "", "line 2, column before_x_m: expected a finite number"),
    ],
)
def test_a_wrong_cell_is_named(file, name, value, said):
    edit(file, 1, name, value)
    with pytest.raises(InputError, match=said):
        read_csv(file, ARM)


def test_a_missing_column_is_named(file):
    edit(file, 0, COLUMNS[3], "something")
    with pytest.raises(
        InputError, match=rf"line 1: missing columns \['{COLUMNS[3]}'\], ignored columns \['some"
    ):
        read_csv(file, ARM)
