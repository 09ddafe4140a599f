"""Positions with orientations in a notation that the file does not state: fitted to the arm, or asked."""

import tomllib

import numpy as np
import pytest
from run_here import do, fine
from scipy.spatial.transform import Rotation

from testbench.arm.folder import find_arm, load_arm
from testbench.errors import InputError
from testbench.files.beside import clear_fit, fits_of, notations
from testbench.files.propose_map import map_text, propose
from testbench.files.read_series import read_series
from testbench.model.kinematics import build_vjm
from testbench.model.vjm import tool_poses

ARM = load_arm(find_arm("kr500_l480"))
WRONG_JOINTS = np.radians(0.1)  #: The drawn arm is off by so much a joint.


def measured(poses=8, spread=1.0, seed=4):
    """Joints, positions [m] and orientations of a target on an arm that is not quite as drawn."""
    rng, vjm = np.random.default_rng(seed), build_vjm(ARM)
    q = ARM.draw_poses(rng, poses)
    q = q[0] + spread * (q - q[0])
    x, R = tool_poses(vjm, q + rng.normal(0, WRONG_JOINTS, q.shape))
    X, Y = (own.as_matrix() for own in Rotation.random(2, rng=rng))
    return q, np.array([3.0, -2.0, 1.0]) + (x + R @ [0.1, 0.2, 0.05]) @ X.T, X @ R @ Y


def angles_in(notation, C):
    """Three angles [rad] of orientations."""
    R = Rotation.from_matrix(C)
    if notation == "vector":
        return R.as_rotvec()
    kind, order = notation.split()
    return R.as_euler(order.upper() if kind == "intrinsic" else order)


def quaternions(C):
    """Quaternions of orientations, the real part last."""
    return Rotation.from_matrix(C).as_quat()


def export(path, made, head, values):
    """Write an export with joints in degrees, positions in mm, and columns of an orientation."""
    q, p, _ = made
    names = ["Pose", *(f"A{k}" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]", *head]
    rows = [
        ",".join([f"p{k}", *map(repr, [*np.degrees(q[k]).tolist(), *(1e3 * p[k]).tolist(), *own])])
        for k, own in enumerate(values.tolist())
    ]
    path.write_text("\n".join([",".join(names), *rows, ""]))
    return path


@pytest.mark.parametrize(
    "notation",
    ["vector", "intrinsic zyx", "extrinsic xyz", "intrinsic zxz", "extrinsic zyz", "intrinsic yxz"],
)
def test_every_notation_is_found_among_all_others(notation):
    q, p, C = measured(6)
    fits = fits_of(ARM, q, p, notations(angles_in(notation, C), by_axis=False))
    assert clear_fit(fits).notation == notation
    assert np.degrees(fits[0].angle) < 0.5 < 10 < np.degrees(np.hypot(fits[1].angle, fits[1].distance))


DEG = 180 / np.pi
FILES = {
    "KUKA": (["A", "B", "C"], lambda C: DEG * angles_in("intrinsic zyx", C), "intrinsic zyx"),
    "FANUC": (["W [°]", "P [°]", "R [°]"], lambda C: DEG * angles_in("extrinsic xyz", C), "extrinsic xyz"),
    "UR": (["Rx", "Ry", "Rz"], lambda C: angles_in("vector", C), "vector"),
    "by axis": (
        ["Rot X [°]", "Rot Y [°]", "Rot Z [°]"],
        lambda C: DEG * angles_in("intrinsic yxz", C)[:, [1, 0, 2]],
        "intrinsic yxz",
    ),
    "spoken": (["Yaw", "Pitch", "Roll"], lambda C: DEG * angles_in("intrinsic zyx", C), "intrinsic zyx"),
    "real first": (["q1", "q2", "q3", "q4"], lambda C: quaternions(C)[:, [3, 0, 1, 2]], None),
    "real last": (["q1", "q2", "q3", "q4"], lambda C: quaternions(C), None),
    "named": (["Qw", "Qx", "Qy", "Qz"], lambda C: quaternions(C)[:, [3, 0, 1, 2]], None),
}


@pytest.mark.parametrize("name", FILES)
def test_an_export_of_poses_is_read_with_its_orientations_right(name, tmp_path):
    head, values, notation = FILES[name]
    made = measured()
    file = export(tmp_path / "poses.csv", made, head, values(made[2]))
    proposal = propose(file, ARM, None, tmp_path)
    assert proposal.asked == ""
    text = map_text(proposal.entries)
    assert tomllib.loads(text).get("series", {}).get("rotation") == notation
    (tmp_path / "poses.toml").write_text(text)
    [series] = read_series(file, ARM, tmp_path / "poses.toml").series
    np.testing.assert_allclose(series.q, made[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(series.position[:, 0], made[1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(series.rotation, made[2], rtol=0, atol=1e-12)


def test_notations_that_fit_alike_are_named_and_the_user_is_asked(tmp_path):
    """Small turns are the same in many orders; a map that states one is taken at its word."""
    made = measured(6, spread=0.004)
    C = made[2][0].T @ made[2]  # turns of few degrees
    file = export(tmp_path / "poses.csv", made, ["A", "B", "C"], DEG * angles_in("intrinsic zyx", C))
    proposal = propose(file, ARM, None, tmp_path)
    assert "several notations fit the nominal arm: " in proposal.asked
    assert "intrinsic zyx (" in proposal.asked
    assert "extrinsic xyz (" in proposal.asked
    assert "rotation" not in map_text(proposal.entries)
    angles = '[columns]\nrotation_1_deg = "A"\nrotation_2_deg = "B"\nrotation_3_deg = "C"\n'
    text = map_text(proposal.entries).replace("[columns]\n", angles)
    (map_file := tmp_path / "poses.toml").write_text(text)
    with pytest.raises(InputError, match=r"poses\.toml: series.rotation: expected .* several notations fit"):
        read_series(file, ARM, map_file)
    map_file.write_text(f'{text}\n[series]\nrotation = "intrinsic zyx"\n')
    np.testing.assert_allclose(read_series(file, ARM, map_file).series[0].rotation, C, rtol=0, atol=1e-12)


def test_angles_that_no_notation_explains_are_not_read(tmp_path):
    made = measured()
    wrong = Rotation.random(len(made[0]), rng=np.random.default_rng(1)).as_euler("xyz", degrees=True)
    file = export(tmp_path / "poses.csv", made, ["A", "B", "C"], wrong)
    assert "no notation fits the nominal arm; the nearest is " in propose(file, ARM, None, tmp_path).asked
    few = tuple(own[:3] for own in made)
    file = export(tmp_path / "few.csv", few, ["A", "B", "C"], wrong[:3])
    assert "from 4 poses or more" in propose(file, ARM, None, tmp_path).asked


def test_data_check_names_the_notation_and_how_well_it_fits(tmp_path):
    head, values, _ = FILES["KUKA"]
    made = measured()
    file = export(tmp_path / "poses.csv", made, head, values(made[2]))
    said = do("data", "check", ARM.name, file).stdout
    assert "rotation: only this one fits the nominal arm: intrinsic zyx (0." in said
    assert 'rotation = "intrinsic zyx"' in said
    assert "poses: orientations differ from the nominal arm by 0." in said
    saved = said.partition("with --map:\n\n")[2].partition("\n\n")[0]
    (tmp_path / "saved.toml").write_text(saved)
    again = fine("data", "check", ARM.name, file, "--map", tmp_path / "saved.toml")
    assert "poses: orientations differ from the nominal arm by 0." in again
