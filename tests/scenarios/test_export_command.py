"""testbench export: the robot's own URDF or a new one, never over an input, one line for what is wrong."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from own_urdf import own_urdf
from run_here import here

from testbench import files
from testbench.campaign.arm_models import read_model
from testbench.campaign.controller_files import STAMP
from testbench.cli.program import program

ROOT = Path(__file__).resolve().parents[2]


def run(*args):
    return here(program(["export"]), "export", *args)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder to work in, with a model of errors of geometry alone and the robot's own URDF."""
    monkeypatch.chdir(tmp_path)
    (model := tmp_path / "model").mkdir()
    for name in ("rigid.xml", "elastic.toml"):
        shutil.copyfile(ROOT / "models" / "ur10" / name, model / name)
    rng = np.random.default_rng(4)
    theta = np.zeros(48)
    theta[6:36] = rng.uniform(-5e-4, 5e-4, 30)
    document = {
        **{"format": 1, "kind": "absolute calibration", "arm": "ur10", "compliances": "none"},
        "digests": {name: files.digest(model / name) for name in ("rigid.xml", "elastic.toml")},
        "theta_0": theta.tolist(),
        "C_theta": np.zeros((48, 48)).tolist(),
        "errors": {"orders": [], "ratio": False, "play": False, "stiffening": False}
        | {"coefficients": [[]] * 6, "torque_scale": [1.0] * 6},
        "weights": {"mass_kg": [1.0] * 8, "centre_m": [[0.0] * 3] * 8},
        "noise": {"open_position_m": 0.0, "open_rotation_rad": 0.0, "factor": [1.0] * 4},
        **{"columns": [], "frames": {}, "mounts": {}},
    }
    (model / "model.json").write_text(json.dumps(document))
    np.savez(model / "posterior.npz", root=np.zeros((0, 0)), L=np.zeros((0, 0)))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "robot.urdf").write_text(own_urdf(read_model(model).vjm, rng)[0])
    return tmp_path


def held(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_an_own_urdf_a_new_one_and_both_again(place):
    before = held(place)
    done = run("model", "--urdf", "in/robot.urdf")
    assert done.returncode == 0, done.stderr
    assert "in robot_calibrated.urdf, its tool is 'tool0'" in done.stdout
    assert "read back by Pinocchio in 1000 poses: within 0.001 um and 0.001 urad" in done.stdout
    assert "not in it, but in robot_calibrated.json: compliances" in done.stdout
    said = json.loads((place / "robot_calibrated.json").read_text())
    assert said["kind"] == "what a URDF cannot hold"
    assert said["urdf_sha256"] == files.digest(place / "robot_calibrated.urdf")
    assert said["read_back"]["position_um"] < 1
    assert run("model", "--urdf", "new.urdf").stdout.startswith("no file new.urdf: written from scratch")
    assert "testbench export wrote it" in run("model", "--urdf", "robot_calibrated.urdf").stderr
    for urdf in ("in/robot.urdf", "new.urdf"):  # what the command wrote may be replaced
        assert "replaced" in run("model", "--urdf", urdf).stdout
    after = held(place)
    made = {Path(f"{stem}.{kind}") for stem in ("robot_calibrated", "new") for kind in ("urdf", "json")}
    assert set(after) - set(before) == made
    assert all(after[path] == content for path, content in before.items())


def test_a_urdf_of_another_arm_is_not_replaced_and_one_from_scratch_may_be_the_robots_own(place):
    document = json.loads((place / "model" / "model.json").read_text())
    (place / "drawn").mkdir()
    for path in (place / "model").iterdir():
        shutil.copyfile(path, place / "drawn" / path.name)
    (place / "drawn" / "model.json").write_text(json.dumps(document | {"theta_0": [0.0] * 48}))
    assert run("drawn", "--urdf", "new.urdf").returncode == 0
    copied = run("model", "--urdf", "new.urdf", "--out", "mine.urdf")
    assert copied.returncode == 0, copied.stderr
    assert (place / "mine.urdf").read_text() != (place / "new.urdf").read_text()
    assert run("model", "--urdf", "identified.urdf").returncode == 0
    done = run("model", "--urdf", "identified.urdf", "--out", "mine.urdf")
    assert "wrote it from scratch, with the geometry of a calibration" in done.stderr
    beside = (place / "new.json").read_text().replace('"arm": "ur10"', '"arm": "arm_6r"')
    (place / "new.json").write_text(beside)
    before = held(place)
    done = run("model", "--urdf", "new.urdf")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "testbench export wrote it of another arm, arm_6r; choose another name" in done.stderr
    assert held(place) == before
    assert run("model", "--urdf", "new.urdf", "--force").returncode == 0


def test_offsets_in_a_controllers_file_and_what_they_cannot_hold(place):
    machine = "DEFDAT $MACHINE PUBLIC\n" + "".join(f"$MAMES[{k}]=0.0\n" for k in range(1, 7))
    (place / "in" / "$machine.dat").write_text(machine)
    done = run("model", "--into", "in/$machine.dat")
    assert done.returncode == 0, done.stderr
    new = (place / "$machine_calibrated.dat").read_text()
    told = re.search(r"(\d\.\d{3}) and (\d\.\d{3}) mm: lengths and tilts of axes", done.stdout)
    assert f"; {told[1]} mm RMS, {told[2]} at most: lengths and tilts of axes\n" in new
    elbow = re.search(r"\$MAMES\[3\]=(.*)\n", new)[1]
    assert float(elbow) != 0
    assert f"elbow_joint {float(elbow):.4f}" in done.stdout
    assert run("model", "--into", "in/$machine.dat").returncode == 0  # what the command wrote may be replaced
    done = run("model", "--into", "in/$machine.dat", "--out", "in/$machine.dat")
    assert "is read by this command" in done.stderr


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("model", "--urdf", "in/robot.urdf", "--out", "in/robot.urdf"), "is read by this command"),
        (("model", "--urdf", "in/robot.urdf", "--out", "in/notes.urdf"), "expected a URDF that testbench"),
        (("model", "--urdf", "in/robot.urdf", "--out", "in/robot.xml"), "ending with .urdf"),
        (("model", "--urdf", "in/robott.urdf", "--out", "x.urdf"), "expected the robot's own URDF; to write"),
        (("model", "--urdf", "new.urdf", "--tip", "tool0"), "leave --out and --tip away"),
        (("model", "--urdf", "in/robot.urdf", "--tip", "tool1"), "no link 'tool1' for the tip"),
        (("model", "--urdf", "in"), "expected a file, got a folder"),
        (("model", "--urdf", "model/rigid.xml"), "expected URDF"),
        (("in", "--urdf", "new.urdf"), "expected the folder of a model"),
        (("model", "--urdf", "nowhere/deep/new.urdf", "--force", "--bad"), "No such option"),
        (("model",), "expected --urdf or --into, one of"),
        (
            ("model", "--urdf", "new.urdf", "--into", "in/ur.yaml"),
            "expected --urdf or --into, one of",
        ),
        (("model", "--into", "in/machine.dat", "--gears", "1"), "--gears: is for ABB's motors alone"),
        (("model", "--into", "in/machine.dat"), "$machine.dat with a number at $MAMES[2]"),
        (("model", "--into", "in/twice.dat"), "$MAMES[1]: stands twice"),
        (("model", "--into", "in/MOC.cfg"), "--gears: expected 6 numbers, or 36 row by row, got 0"),
        (("model", "--into", "in/MOC.cfg", "--gears", "a"), "--gears: expected numbers with commas"),
        (
            ("model", "--into", "in/MOC.cfg", "--gears", "0,1,1,1,1,1"),
            "--gears: expected turns of the motors",
        ),
        (("model", "--into", "in/MOC.cfg", "--gears", "9,9,9,9,9,9"), 'at cal_offset of "rob1_1"'),
        (("model", "--into", "in/ur.yaml"), "kinematics of a UR driver with a number at shoulder.y"),
        (("model", "--into", "in/huge.yaml"), "from that of ur10 as drawn"),
        (("model", "--into", "in/ur.yaml", "--tip", "a"), "--tip is for --urdf"),
        (("model", "--into", "in/robot.urdf"), "expected kinematics of a UR driver, KUKA's $machine.dat or"),
        (("model", "--into", "in/ours.yaml"), "testbench export wrote it; expected the robot's own file"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(place, args, said):
    (place / "in" / "notes.urdf").write_text("<robot name='mine'/>")
    ur = "kinematics:\n" + "".join(
        f"  {frame}:\n" + "".join(f"    {key}: 1e3\n" for key in "x y z roll pitch yaw".split())
        for frame in "shoulder upper_arm forearm wrist_1 wrist_2 wrist_3".split()
    )
    texts = {
        "machine.dat": "$MAMES[1]=1.0\n$MAMES[2]=1e999\n",
        "twice.dat": "$MAMES[1]=1.0\n$mames[1] = 2.0\n",
        "MOC.cfg": 'MOC:CFG_1.0\nMOTOR_CALIB:\n#\nARM:\n  -name "rob1_1" -cal_offset 9\n',
        "ur.yaml": "kinematics:\n  shoulder:\n    x: 0\n    y: .inf\n",
        "huge.yaml": ur,
        "ours.yaml": f"# {STAMP}\n{ur}",
    }
    for name, text in texts.items():
        (place / "in" / name).write_text(text)
    before = held(place)
    done = run(*args)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stdout + done.stderr
    assert said in done.stderr
    assert held(place) == before
