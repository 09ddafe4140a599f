"""Every command on arms that are not six hinges: their own payload, poses, units and models."""

import json

import numpy as np
import pytest
from run_here import fine as run
from run_here import numbers_alone, refused, table
from serial_arms import write_arm

ARMS = {"scara": "zzZ", "nine": "zyzyzyzXY"}


@pytest.fixture(scope="module", params=["scara", pytest.param("nine", marks=pytest.mark.study)])
def made(request, tmp_path_factory):
    """An arm, and runs of it without a pose file."""
    folder = tmp_path_factory.mktemp("arm")
    arm, data = write_arm(folder / request.param, ARMS[request.param]), folder / "data.csv"
    said = run("simulate", arm, "--poses", 10, "--loads", "5,10", "--seed", 3, "--out", data)
    assert "20 runs under 5 to 10 kg, deflections" in said
    return arm, data


def test_runs_without_a_pose_file_are_in_random_poses_within_the_limits(made):
    arm, data = made
    rows, joints = table(data), ARMS[arm.name]
    columns = [f"joint_{k + 1}_{'m' if x.isupper() else 'rad'}" for k, x in enumerate(joints)]
    assert list(rows[0])[3 : 3 + len(joints)] == columns
    q = np.array([[float(row[name]) for name in columns] for row in rows])
    low, high = np.array([(0, 0.4) if x.isupper() else (-1.746, 1.746) for x in joints]).T
    assert ((q >= low) & (q <= high)).all()
    assert len(np.unique(q[:, 0])) == 10
    assert {(row["pose"], round(float(row["force_z_N"]), 3)) for row in rows} == {
        (str(pose), force) for pose in range(1, 11) for force in (-49.05, -98.1)
    }


def test_every_command_goes_on_from_there(made, tmp_path):
    arm, data = made
    joints = ARMS[arm.name]
    count = 21 * (len(joints) + 1) + len(joints)
    checked = run("check", arm, "--elastic", tmp_path / "elastic.xml")
    assert "MuJoCo and Pinocchio agree on the places of links" in checked
    fit = ("--out", tmp_path / "fit", "--model", "all", "--uncertainty-percent", 30, "--identifiability")
    with numbers_alone():
        said = run("identify", arm, data, *fit)
    assert f"ALL{count} + prior" in said
    assert "the same runs once more" in said
    [fitted] = json.loads((tmp_path / "fit" / "models.json").read_text())["models"]
    assert fitted["parameters"] == count
    assert fitted["f_m"] < 2 * fitted["f_m_floor"]
    tasks = tmp_path / "tasks.csv"
    names = [f"joint_{k + 1}_{'mm' if x.isupper() else 'deg'}" for k, x in enumerate(joints)]
    tasks.write_text(
        "\n".join([",".join(names), ",".join(["20"] * len(joints)), ",".join(["40"] * len(joints))])
    )
    model = f"MGCO{8 * len(joints) + 8}" if len(joints) > 3 else f"ALL{count}"  # all of many take seconds
    few = ("--poses", 3, "--candidates", 8, "--out", tmp_path / "plan")
    few += ("--model", model) if len(joints) > 3 else ()
    with numbers_alone():
        said = run("plan", arm, "--task", tasks, *few)
    assert "No floor" in said
    report = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert (report["model"], report["loads_kg"]) == (model, [10.0])  # its own, and what it states
    assert report["units"] == ["mm" if x.isupper() else "deg" for x in joints]
    run("simulate", arm, tmp_path / "plan" / "plan.csv", "--out", tmp_path / "rehearsed.csv")
    assert len(table(tmp_path / "rehearsed.csv")) == 3 * 3


def test_an_arm_that_states_no_payload_is_asked_for_one(tmp_path):
    arm, out = write_arm(tmp_path / "arm", "zyy"), tmp_path / "data.csv"
    toml = arm / "elastic.toml"
    toml.write_text("\n".join(line for line in toml.read_text().splitlines() if "payload" not in line))
    said = refused("simulate", arm, "--poses", 3, "--out", out)
    assert said == "error: --payload-kg: expected a mass [kg], as arm states no payload in elastic.toml\n"
    assert "3 runs" in run("simulate", arm, "--poses", 3, "--payload-kg", 5, "--out", out)
    assert "Warning" not in run("simulate", arm, "--poses", 3, "--payload-kg", 460.3, "--out", out)


def test_a_payload_far_beyond_the_stated_one_is_doubted_and_hung(tmp_path):
    arm, out = write_arm(tmp_path / "arm", "zyy"), tmp_path / "data.csv"
    assert "Warning" not in run("simulate", arm, "--poses", 3, "--payload-kg", 15, "--out", out)
    said = run("simulate", arm, "--poses", 3, "--loads", "10,16", "--out", out)
    assert "Warning: 16 kg hang from an arm that states a payload of 10 kg" in said
    assert "6 runs" in said
    assert "• Warning: 16 kg hang" in run("data", "check", arm, out)


@pytest.mark.study
def test_a_link_without_joints_is_identified_predicted_and_exported(tmp_path):
    data, fit = tmp_path / "data.csv", tmp_path / "fit"
    run("simulate", "single_link", "--poses", 4, "--out", data)
    assert "ALL21 + prior" in run("identify", "single_link", data, "--out", fit)
    [*_, found] = json.loads((fit / "models.json").read_text())["models"]
    assert (found["name"], found["parameters"]) == ("ALL21 + prior", 21)
    (loads := tmp_path / "loads.csv").write_text("mass_kg\n1\n")
    assert "Under 1 kg the tool moves" in run("predict", fit, loads, "--out", tmp_path / "predicted")
    out = ("--out", tmp_path / "corrected.csv")
    assert "single_link has no joints" in refused("compensate", fit, loads, *out)
    assert "written" in run("export", fit, "--urdf", tmp_path / "arm.urdf")
    assert '<link name="tool"' in (tmp_path / "arm.urdf").read_text()
