"""Runs in a laser tracker's frame through the command line: simulated, identified, given frames read."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_here import fine, numbers_alone, refused, table
from scipy.spatial.transform import Rotation

from testbench.errors import InputError
from testbench.report.table import rows as as_rows
from testbench.workflows.absolute_campaign import by_trackers
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.read_runs import read_frames, registration_notes, registration_row, to_base

ROOT = Path(__file__).resolve().parents[2]
ARM, POSES = ROOT / "models" / "kr500_l480", ROOT / "docs" / "poses.csv"
PLACE = (4.0, -2.0, 1.5)


def identified(data, out):
    """models.json of a quick fit."""
    with numbers_alone():
        fine("identify", ARM, data, "--model", "Joints", "--no-intervals", "--out", out)
    return json.loads((out / "models.json").read_text())


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The same poses read in the base's frame and by a tracker."""
    folder = tmp_path_factory.mktemp("runs")
    for name, flags in (("base", []), ("tracker", ["--tracker", ",".join(map(str, PLACE))])):
        fine("simulate", ARM, POSES, "--out", folder / f"{name}.csv", "--payload-kg", 460.3, *flags)
    return folder


def test_trackers_frame_is_found_and_the_model_is_that_of_the_bases(runs, tmp_path):
    """Compliances of joints agree to 10 %: without links they hang on the weights of the readings."""
    base, tracker = (identified(runs / f"{name}.csv", tmp_path / name) for name in ("base", "tracker"))
    assert [found["registration"]["frame"] for found in (base, tracker)] == ["base", "tracker"]
    (frame,) = tracker["registration"]["frames"]
    assert np.linalg.norm(frame["position_mm"]) == pytest.approx(1e3 * np.linalg.norm(PLACE), abs=10)
    assert frame["position_mm"][2] == pytest.approx(-1500, abs=10)
    np.testing.assert_allclose(frame["rotation_deg"][:2], 0, atol=0.2)
    joints = [found["models"][0]["joints"] for found in (base, tracker)]
    assert joints[1]["joint_2"] == pytest.approx(joints[0]["joint_2"], rel=0.1)


def test_target_that_the_folder_lacks_is_found(runs, tmp_path):
    data = tmp_path / "data.csv"
    data.write_text((runs / "tracker.csv").read_text().replace(",P2,", ",T9,"))
    flags = ["--model", "Joints", "--no-intervals", "--out", tmp_path / "fit"]
    with numbers_alone():
        fine("identify", ARM, data, "--new-target", "T9", *flags)
    targets = json.loads((tmp_path / "fit" / "models.json").read_text())["registration"]["targets"]
    (new,) = [target for target in targets if target["marker"] == "T9"]
    assert new["from_nominal_mm"] is None
    np.testing.assert_allclose(new["position_mm"], [480, -320, 260], atol=3)
    for more, said in (
        ([], "no marker 'T9' in kr500_l480; markers are P1, P2, P3"),
        (["--new-target", "P1"], "--new-target: expected new names, got P1; kr500_l480 has P1, P2, P3"),
    ):
        refused("identify", ARM, data, *more, *flags, said=said, below=tmp_path)


def test_the_base_is_told_wherever_it_stands_in_its_world(kr500, tmp_path):
    """A cell that is moved as a whole, arm and trackers, reads the same and has its base where it was."""
    clean = simulate(kr500, Scenario(arm="kr500_l480", noise=False, workspace_poses=1), 500).measured
    data = by_trackers(clean, [PLACE, (-3.0, 3.0, 2.0)], 500)
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_euler("xyz", [0.2, -0.3, 0.7]).as_matrix()
    moved[:3, 3] = 0.5, -2.0, 0.7
    cells = kr500, replace(kr500, vjm=replace(kr500.vjm, base_pose=moved @ kr500.vjm.base_pose))
    notes, rows = zip(
        *(
            (registration_notes(f), as_rows(registration_row(f)))
            for _, f in (to_base(c, data) for c in cells)
        ),
        strict=True,
    )
    for one, other in zip(*(row.frames for row in rows), strict=True):
        for key in ("position_mm", "rotation_deg", "position_sd_mm", "rotation_sd_deg"):
            np.testing.assert_allclose(getattr(other, key), getattr(one, key), rtol=1e-4, atol=1e-3)
    assert [note.split(" By")[0] for note in notes[1][:2]] == [note.split(" By")[0] for note in notes[0][:2]]
    given = ""
    for frame in rows[0].frames:
        turn = Rotation.from_rotvec(frame.rotation_deg, degrees=True).as_euler("xyz", degrees=True).tolist()
        place = [x / 1e3 for x in frame.position_mm]
        given += f"[[frame]]\nstation = {frame.station}\nposition_m = {place}\nrotation_xyz_deg = {turn}\n"
    (tmp_path / "frame.toml").write_text(given)
    found = (to_base(cell, data, str(tmp_path / "frame.toml"))[1] for cell in cells)
    same = [as_rows(registration_row(own)) for own in found]
    assert same[1].rms_mm == pytest.approx(same[0].rms_mm, rel=1e-3)
    assert same[1].frames[1].position_mm == pytest.approx(rows[0].frames[1].position_mm)


@pytest.mark.parametrize("sigma_um", [1.0, 400.0])
def test_noise_that_is_asked_for_counts_more_than_the_tracker_s_own(sigma_um, tmp_path):
    flags = ("--payload-kg", 460, "--tracker", "4,-2,1", "--sigma-um", sigma_um)
    fine("simulate", ARM, POSES, "--out", tmp_path / "d.csv", *flags)
    rows = table(tmp_path / "d.csv")
    assert {float(row["sigma_m"]) for row in rows} == {sigma_um / 1e6}
    read = np.array([[float(row[f"before_{axis}_m"]) for axis in "xyz"] for row in rows]).reshape(-1, 3, 3)
    apart = np.linalg.norm(read[:, 0] - read[:, 1], axis=1)  # of two targets of one plate
    assert 0.3 < 1e6 * apart.std() / sigma_um < 4


PLACED = "[[frame]]\nposition_m = [{}, 0.0, 0.0]\nrotation_xyz_deg = [0.0, 0.0, 0.0]\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("frame = 3", r"frame: expected a list, got 3; \[\[frame\]\] has position_m and rotation_xyz_deg"),
        ("[[frame]]\nposition_m = [1.0, 2.0, 3.0]", r"frame\.0\.rotation_xyz_deg: this key is missing"),
        (PLACED.format(4000.0), "expected at most 1000"),
        ("[[frame", "not TOML"),
        (2 * PLACED.format(1.0), r"expected every station once, got \[1, 1\]"),
    ],
)
def test_file_of_frames_that_is_wrong_is_refused(text, expected, tmp_path):
    (tmp_path / "frame.toml").write_text(text)
    with pytest.raises(InputError, match=expected):
        read_frames(tmp_path / "frame.toml")
