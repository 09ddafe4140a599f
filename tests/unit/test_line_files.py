"""Files of gauges and distances: read back what was written, or refused in one line."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from testbench.errors import BenchError
from testbench.files.read_pairs import read_csv, read_export
from testbench.files.write import write_csv
from testbench.identify.base_frame import register_dataset
from testbench.plant.tracker import DRAW_WIRE, Gauge, IsotropicTracker
from testbench.runs.rows import trial_rng
from testbench.workflows.campaign import poses_with_weight, read_instruments
from testbench.workflows.instruments import Mounted, mounted
from testbench.workflows.read_runs import contents

HEAD = "run,marker,joint_1_deg,joint_2_deg,joint_3_deg,joint_4_deg,joint_5_deg,joint_6_deg,mass_kg"
POSE = "10,-60,80,5,30,0,460"
GAUGES = f"""{HEAD},travel_unloaded_mm,travel_loaded_mm,direction_x,direction_y,direction_z,tilt_deg,sigma_um
1,P1,{POSE},10.000,9.012,1,0,0,0.5,5
1,P2,{POSE},10.001,12.500,0,1,0,1.0,5
1,P3,{POSE},,,,,,,5
"""


def simulated(cell, *instruments):
    """Three poses read by some instruments."""
    q = cell.arm.draw_poses(np.random.default_rng(1), 3)
    loaded = poses_with_weight(cell, q, np.arange(3) + 1, 200.0)
    return read_instruments(cell, "linear", loaded, instruments, trial_rng(1, 1))


@pytest.mark.parametrize(
    "instruments",
    [
        [Mounted(Gauge(), "P1", np.array([1.0, 2.0, 2.0])), Mounted(DRAW_WIRE, "P2", fixed=np.zeros(3))],
        [Mounted(Gauge(), "P3", np.eye(3)[0], on_tool=True), Mounted(IsotropicTracker(3e-5))],
    ],
    ids=["gauge and wire", "gauge and tracker"],
)
def test_readings_along_lines_are_read_back(kr500, tmp_path, instruments):
    data = simulated(kr500, *instruments)
    write_csv(data, kr500.arm, tmp_path / "lines.csv")
    again = read_csv(tmp_path / "lines.csv", kr500.arm)
    for name in ("run_id", "pose_id", "q", "wrench"):
        np.testing.assert_array_equal(getattr(again, name), getattr(data, name))
    np.testing.assert_array_equal(again.is_measured, data.is_measured)
    np.testing.assert_array_equal(again.is_line_reading, data.is_line_reading)
    for name in ("before", "after", "line_direction", "line_direction_deviation", "line_length"):
        own = [
            np.where(data.is_measured.reshape(*data.is_measured.shape, *[1] * (x.ndim - 2)), x, 0)
            for x in (getattr(again, name), getattr(data, name))
        ]
        np.testing.assert_allclose(*own, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(again.precision, data.precision, rtol=1e-6, atol=1e-6 * data.precision.max())


def test_a_reading_out_of_range_is_lost_and_a_marker_without_an_instrument_is_not(kr500, tmp_path):
    short, wire = (
        Mounted(Gauge(measuring_range=2e-4), "P1", np.eye(3)[2]),
        Mounted(DRAW_WIRE, "P2", fixed=np.zeros(3)),
    )
    alone = simulated(kr500, short, wire)
    write_csv(alone, kr500.arm, tmp_path / "lines.csv")
    for data in (alone, read_csv(tmp_path / "lines.csv", kr500.arm)):
        assert not data.is_measured[:, 0].any()
        assert data.is_lost.tolist() == [[True, False, False]] * 3
    export = read_export(tmp_path / "lines.csv", kr500.arm)
    found = contents(export)
    assert (found.targets, len(found.lost), found.without) == (6, 3, ["P3"])
    beside = simulated(kr500, short, Mounted(IsotropicTracker(3e-5)))
    assert beside.is_lost.any(axis=1).tolist() == [True, False] * 3
    assert not beside.is_lost[:, 1:].any()
    assert contents(replace(export, data=beside)).without == [
        f"P{k} in run {n}" for n in (1, 3, 5) for k in (2, 3)
    ]
    some = beside.precision.copy()
    some[1, 2] = 0
    assert replace(beside, precision=some).is_lost[1].tolist() == [False, False, True]


def test_a_workshops_table_of_gauges_needs_no_position(kr500, tmp_path):
    file = tmp_path / "gauges.csv"
    file.write_text(GAUGES)
    data = read_csv(file, kr500.arm)
    assert data.is_line_reading.tolist() == [[True, True, False]]
    np.testing.assert_allclose(data.deflection[0, 0], [-0.988e-3, 0, 0], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(data.line_direction_deviation[0]), [0.5, 1.0, 0.0])
    zeroed = GAUGES.replace("travel_unloaded_mm,", "").replace("10.000,", "").replace("10.001,", "")
    file.write_text(zeroed.replace("P3,10,-60,80,5,30,0,460,,,,", "P3,10,-60,80,5,30,0,460,,,"))
    np.testing.assert_allclose(read_csv(file, kr500.arm).deflection[0, 0, 0], 9.012e-3)


def test_a_minus_in_a_map_turns_the_direction_of_a_gauge(kr500, tmp_path):
    """A direction has no unit; its sign is of the map as that of any other number."""
    (file := tmp_path / "gauges.csv").write_text(GAUGES)
    (map_ := tmp_path / "map.toml").write_text('columns.direction_x = "-direction_x"\n')
    data = read_export(file, kr500.arm, map_).data
    np.testing.assert_array_equal(data.line_direction[0, :2], [[-1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(data.deflection[0, 0], [0.988e-3, 0, 0], atol=1e-12)


def test_what_a_file_does_not_say_is_assumed_and_said(kr500, tmp_path):
    file = tmp_path / "gauges.csv"
    file.write_text("\n".join(",".join(line.split(",")[:-2]) for line in GAUGES.splitlines()) + "\n")
    export = read_export(file, kr500.arm)
    assert any("0.5 deg for the direction is assumed" in note for note in export.notes)
    np.testing.assert_allclose(np.rad2deg(export.data.line_direction_deviation[0, 1]), 0.5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("9.012,1,0,0,0.5", "9.012,0,0,0,0.5", "expected a direction, got 0, 0, 0"),
        ("9.012,1,0,0,0.5", "9.012,,,,0.5", "expected direction_x, _y and _z"),
        ("9.012,1,0,0,0.5", "9.012,1,0,,0.5", "expected a finite number, got ''"),
        ("9.012,1,0,0,0.5", "9.012,1,0,0,50", "expected 0 to 0.175"),
        ("travel_loaded_mm", "travel_there_mm", "travel_after_m"),
        (
            "travel_unloaded_mm,travel_loaded_mm",
            "distance_unloaded_mm,distance_loaded_mm",
            "fixed_x, _y and _z",
        ),
    ],
)
def test_a_wrong_table_of_gauges_is_refused_in_one_line(kr500, tmp_path, old, new, words):
    file = tmp_path / "gauges.csv"
    file.write_text(GAUGES.replace(old, new))
    assert words in refused(read_csv, file, kr500.arm)


def test_readings_along_lines_need_no_frame_and_lie_at_their_markers(kr500):
    data = simulated(kr500, Mounted(Gauge(), "P1", np.eye(3)[2]))
    found = register_dataset(kr500.vjm, data)
    assert (found.frame, found.registration) == ("base", None)
    moved = np.linalg.norm(found.data.deflection - data.deflection, axis=2)
    assert moved.max() < 1e-4  # the direction turns with the arm
    with pytest.raises(BenchError, match="base axes"):
        register_dataset(kr500.vjm, data, "tracker")


@pytest.mark.parametrize(
    "text",
    [
        "gauge:P1",
        "gauge:P1:w",
        "wire:P1:1,2",
        "laser",
        "wire:P1:z",
        "gauge:P1:0,0,0",
        "tracker:0um",
        "wire:P1:nan,0,0",
        "plane:P1:z",
        "plane:P1:0,0,0:1,0,0",
        "plane:P1:z:1,0,0:10mm",
        "plane:P1:z:1,0,0:5 um",
        "wire:P1:1,0,0:box",
    ],
)
def test_a_wrong_instrument_is_refused(text):
    with pytest.raises(BenchError, match="--instrument: expected gauge"):
        mounted(text)


def test_an_instrument_is_a_few_words():
    own = mounted("gauge:P2:tool_-x:3um:0.25deg")
    assert (own.marker, own.on_tool, own.instrument.sigma) == ("P2", True, 3e-6)
    assert np.rad2deg(own.instrument.tilt_sigma) == pytest.approx(0.25)
    np.testing.assert_array_equal(own.direction, [-1, 0, 0])
    assert mounted("wire:P1:1.5,0,0.2:100um").instrument.sigma == pytest.approx(1e-4)
    assert mounted("wire:P1:1.5,0,0.2:1000mm").instrument.zero_sigma == 1.0
    own = mounted("plane:P1:-x:2,0,1:20um:1deg")
    assert (own.direction.tolist(), own.fixed.tolist()) == ([-1, 0, 0], [2, 0, 1])
    assert (own.instrument.sigma, own.block) == (2e-5, "")
    assert mounted("plane:P1:-x:2,0,1:box:20um").block == "box"
    assert mounted("tracker:20um").marker == ""
