"""Layouts of known exports: each sample is read by its own layout, to the last digit, and by no other."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from run_here import ROOT, do, fine, is_refused

from testbench.arm.folder import find_arm, load_arm
from testbench.errors import InputError
from testbench.files.layouts import FOLDER, every_fitting, known_layouts
from testbench.files.propose_map import map_text, propose
from testbench.files.read_series import read_series
from testbench.files.rearranged import clock, times_of
from testbench.files.table import read_table

ARM = load_arm(find_arm("kr500_l480"))
READINGS = read_table(FOLDER / "readings.csv", bool)
"""What every sample holds: six poses by their names, joints [deg], three targets [mm]."""
NUMBERS = np.column_stack([READINGS.numbers(k) for k in range(1, len(READINGS.names))])
Q, X = np.radians(NUMBERS[:, :6]), 1e-3 * NUMBERS[:, 6:].reshape(6, 3, 3)


def part(file, columns):
    """Write some columns of the readings."""
    rows = [line.split(",") for line in (FOLDER / "readings.csv").read_text().splitlines()]
    file.write_text("".join(",".join(row[k] for k in columns) + "\n" for row in rows))
    return file


@pytest.mark.parametrize("name", known_layouts())
def test_a_sample_is_read_to_the_last_digit_by_its_own_layout_and_by_no_other(name, tmp_path):
    layout, sample = known_layouts()[name], FOLDER / f"{name}.sample"
    [fits] = every_fitting(sample, ARM)
    assert fits.name == name
    if layout.times:
        times = times_of(read_table(sample, bool, fits.file), layout.times)
        np.testing.assert_allclose(times - times[0], 10 * np.arange(6), atol=1e-6)
    (file := tmp_path / sample.name).write_bytes(sample.read_bytes())
    log = None
    if "positions" not in layout.holds:
        log, file = file, part(tmp_path / "points.csv", [0, *range(7, 16)])
    elif "joints" not in layout.holds:
        log = part(tmp_path / "robot.csv", range(7))
    proposal = propose(file, ARM, log, tmp_path)
    (tmp_path / "map.toml").write_text(map_text(proposal.entries))
    [series] = read_series(file, ARM, tmp_path / "map.toml").series
    targets = len(series.markers)
    order = [series.markers.index(marker) for marker in ARM.markers] if targets > 1 else [0]
    np.testing.assert_allclose(series.position[:, order], X[:, :targets], rtol=0, atol=5e-11)
    np.testing.assert_allclose(series.q, Q, rtol=0, atol=6e-11)  # 10 digits in radians


EXPORTS = {path.stem: path for path in (ROOT / "tests" / "adopt" / "exports").glob("*.csv")}
"""Exports whose columns have names that tell all: they need no layout."""
WITH_JOINTS = {"joints_in_one_cell", "robodk_measurements", "table_chinese", "table_french", "table_german"}


@pytest.mark.parametrize("name", sorted(EXPORTS))
def test_an_export_of_common_names_is_read_to_the_last_digit_without_a_layout(name, tmp_path):
    (file := tmp_path / f"{name}.csv").write_bytes(EXPORTS[name].read_bytes())
    log = part(tmp_path / "robot.csv", range(7))
    if name == "ros_plotjuggler":
        log, file = file, part(tmp_path / "points.csv", [0, *range(7, 16)])
    elif name in WITH_JOINTS:
        log = None
    proposal = propose(file, ARM, log, tmp_path)
    [series] = read_series(file, ARM, proposal.map()).series
    targets = len(series.markers)
    order = [series.markers.index(marker) for marker in ARM.markers] if targets > 1 else [0]
    np.testing.assert_allclose(series.position[:, order], X[:, :targets], rtol=0, atol=5e-11)
    np.testing.assert_allclose(series.q, Q, rtol=0, atol=6e-11)


def test_our_own_files_are_of_no_layout():
    files = [*ROOT.glob("docs/*.csv"), *ROOT.glob("models/*/readings/*.csv"), FOLDER / "readings.csv"]
    assert len(files) > 5
    assert {file.name: every_fitting(file, ARM) for file in files if every_fitting(file, ARM)} == {}


def test_two_layouts_that_fit_are_both_named_and_one_may_be_chosen(tmp_path):
    names = [*(f"{x}1" for x in "xyz"), "timestamp", *(f"actual_q_{k}" for k in range(6))]
    names += [f"joint_{k}" for k in range(1, 7)]
    rows = [[*map(str, [*X[k, 0], k, *Q[k], *Q[k]])] for k in range(6)]
    (file := tmp_path / "both.csv").write_text("".join(",".join(row) + "\n" for row in [names, *rows]))
    for command in ("check", "map"):
        line = is_refused(do("data", command, ARM.name, file), "fits the layouts figaroh (FIGAROH, data of")
        assert "and ur_rtde (Universal Robots, record of RTDE); choose one by --layout NAME" in line
    assert not file.with_suffix(".toml").exists()
    assert propose(file, ARM, None, tmp_path, "ur_rtde").layouts == (
        "ur_rtde (Universal Robots, record of RTDE)",
    )
    flags = [ARM.name, file, "--layout"]
    is_refused(do("data", "map", *flags, "delmia_auto_id"), "expected rows of 8 cells without a header")
    is_refused(do("data", "map", *flags, "none"), "no layout 'none'; layouts are delmia_auto_id, ")
    is_refused(
        do("data", "check", *flags, "figaroh", "--map", tmp_path / "m.toml"),
        "--map states the log, loaded file and layout",
    )


def test_data_check_takes_the_layout_that_fits_and_prints_the_map_to_save(tmp_path):
    (file := tmp_path / "take.csv").write_bytes((FOLDER / "motion_capture.sample").read_bytes())
    flags = [ARM.name, file, "--log", part(tmp_path / "robot.csv", range(7))]
    done = do("data", "check", *flags)
    assert (done.returncode, done.stderr) == (0, "")
    said, _, rest = done.stdout.partition("Save this map as take.toml and give it with --map:\n\n")
    assert "layout     motion_capture (Motion capture of OptiTrack Motive, Vicon Nexus and others" in said
    fine("data", "map", *flags)
    assert rest.startswith(file.with_suffix(".toml").read_text())
    assert "6 readings" in rest
    assert "The median distance of these readings from the nominal arm is" in rest


def test_data_check_shows_pairs_of_a_layout_as_runs(tmp_path):
    head = [f"{x}{m}" for m in (1, 2, 3) for x in "xyz"] + [f"joint_{k}" for k in range(1, 7)]
    rows = [
        [*map(str, (X[k] - down).ravel()), *map(str, Q[k]), str(mass)]
        for k in range(6)
        for mass, down in ((0, np.zeros(3)), (240, np.array([0, 0, 3e-6])))
    ]
    lines = [[*head, "mass [kg]"], *rows]
    (file := tmp_path / "pairs.csv").write_text("".join(",".join(line) + "\n" for line in lines))
    said = fine("data", "check", ARM.name, file)
    assert "layout figaroh (FIGAROH, data of a calibration)" in said
    assert "size: 12 rows, 6 runs, 6 poses, 1 station" in said
    assert "240 kg" in said


SECONDS = 1789376490  #: 14 September 2026, 9:01:30, since 1970.
TIMES = ["2026-09-14T09:01:30Z", "2026-09-14 09:01:30,0", "20260914090130", "14.09.2026 09:01:30"]
TIMES += ["14/09/2026 09:01:30", "2026/09/14 09:01:30", "09/14/2026 09:01:30 AM", "2026年09月14日 09:01:30"]
TIMES += [
    str(SECONDS),
    f"{SECONDS}.0",
    f"{SECONDS}000",
    f"{SECONDS}000000",
    f"{SECONDS}000000000",
    f"{SECONDS} 0",
]


@pytest.mark.parametrize("text", TIMES)
def test_a_time_is_the_same_in_every_notation(text):
    np.testing.assert_allclose(clock([text]), [SECONDS], rtol=0, atol=1e-6)


def test_numbers_of_a_cell_are_joints_with_anything_between_them_and_no_fewer(tmp_path):
    rows = [
        f"({X[k, 0, 0]} {X[k, 0, 1]} {X[k, 0, 2]});A1={' / '.join(map(str, NUMBERS[k, :6]))}"
        for k in range(6)
    ]
    (tmp_path / "map.toml").write_text('cells = { P = "{position_m}", Q = "{joints_deg}" }\n')
    (file := tmp_path / "cells.csv").write_text("\n".join(["P;Q", *rows, ""]))
    [series] = read_series(file, ARM, tmp_path / "map.toml").series
    np.testing.assert_allclose(series.q, Q, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(series.position[:, 0], X[:, 0])
    file.write_text("\n".join(["P;Q", *rows[:-1], "(1 2 3);1 / 2 / 3 / 4 / 5", ""]))
    with pytest.raises(
        InputError, match="line 2, column Q: expected 6 numbers in every cell, and any further"
    ):
        read_series(file, ARM, tmp_path / "map.toml")


def test_a_word_for_a_lost_target_is_found_in_the_table_of_a_layout(tmp_path):
    content = (FOLDER / "robot_calibration.sample").read_text()
    lost = "".join(f",{x:.6f}" for x in X[2, 0])
    assert lost in content
    (file := tmp_path / "ros.csv").write_text(content.replace(lost, ",---,---,---"))
    proposal = propose(file, ARM, None, tmp_path)
    [series] = read_series(file, ARM, proposal.map()).series
    np.testing.assert_allclose(series.position[:, 0], X[[0, 1, 3, 4, 5], 0], rtol=0, atol=1e-12)


def test_joints_that_are_called_otherwise_are_taken_in_their_order_as_a_guess(tmp_path):
    content = (FOLDER / "ros1_joint_states.sample").read_text()
    (log := tmp_path / "log.csv").write_text(content.replace("joint_", "axis_"))
    points = part(tmp_path / "points.csv", [0, *range(7, 16)])
    [why, *_] = {own.why for own in propose(points, ARM, log, tmp_path).entries if own.key == "joint_1_rad"}
    assert "joints axis_3, axis_2, axis_1, axis_4, axis_5, axis_6 of the file are those of the arm" in why
    log.write_text(content.replace("joint_3,", "joint_9,", 1))
    with pytest.raises(InputError, match=r"expected the same joints in every row, got 2 lists"):
        propose(points, ARM, log, tmp_path)


def test_joints_of_a_layout_that_slide_are_in_metres(tmp_path):
    """As of a robot on a lift, in data of FIGAROH."""
    names = ("lift", *(f"arm_{k}" for k in range(1, 6)))
    joints = [replace(j, name=n, prismatic=n == "lift") for j, n in zip(ARM.joints, names, strict=True)]
    (file := tmp_path / "f.csv").write_text(f"x1,y1,z1,{','.join(names)}\n1,2,3,0.2,1,2,3,4,5\n")
    proposal = propose(file, replace(ARM, joints=tuple(joints)), None, tmp_path)
    assert "figaroh" in proposal.layouts[0]
    assert {"lift_m", "arm_1_rad", "arm_5_rad"} <= {own.key for own in proposal.entries}


def test_the_documentation_lists_every_layout():
    with (ROOT / "docs/tables/layouts.csv").open(encoding="utf-8", newline="") as file:
        _, *rows = csv.reader(file)
    assert rows == [
        [f"`{name}`", own.title, " and ".join(own.holds), own.facts] for name, own in known_layouts().items()
    ]
