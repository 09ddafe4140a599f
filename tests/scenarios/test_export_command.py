"""testbench export: the robot's own URDF or a new one, never over an input, one line for what is wrong."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from own_urdf import own_urdf
from run_here import do, fine, held, refused

from testbench.arm.folder import load_arm
from testbench.files.export import STAMP
from testbench.identify.absolute.align import Noise
from testbench.identify.absolute.state import nominal_state
from testbench.identify.posterior import ArmModel, ModelOrigin, Posterior
from testbench.model.kinematics import build_vjm
from testbench.model.load import BodyMasses
from testbench.model.structure import joints_only
from testbench.runs import manifest as files
from testbench.workflows.arm_models import read_model, write_files

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A model of errors of geometry alone and the robot's own URDF."""
    folder = tmp_path_factory.mktemp("export")
    (model := folder / "model").mkdir()
    rng, vjm = np.random.default_rng(4), build_vjm(load_arm(ROOT / "models" / "ur10"))
    theta = np.zeros(48)
    theta[6:36] = rng.uniform(-5e-4, 5e-4, 30)
    state = replace(nominal_state(vjm, BodyMasses(np.ones(8), np.zeros((8, 3))), np.ones(6)), theta_0=theta)
    none = Posterior.from_covariance_root(np.zeros(0), np.zeros((0, 0)))
    known = ArmModel(state, joints_only(vjm.arm), np.zeros(0, int), none, ModelOrigin("geometry"), Noise())
    write_files(known, model, name="geometry", fit={})
    (folder / "in").mkdir()
    (folder / "in" / "robot.urdf").write_text(own_urdf(read_model(model).vjm, rng)[0])
    return folder


@pytest.fixture
def place(made, tmp_path, monkeypatch):
    """A folder to work in, with both."""
    monkeypatch.chdir(shutil.copytree(made, tmp_path, dirs_exist_ok=True))
    return tmp_path


def test_an_own_urdf_a_new_one_and_both_again(place):
    before = held(place)
    done = fine("export", "model", "--urdf", "in/robot.urdf")
    assert "written robot_calibrated.urdf" in done
    assert "tool 'tool0'" in done
    assert (
        "read back in 1000 poses the file differs from the model by at most 0.001 um and 0.001 urad" in done
    )
    assert "beside robot_calibrated.json: compliances" in done
    said = json.loads((place / "robot_calibrated.json").read_text())
    assert said["kind"] == "what a URDF cannot hold"
    assert said["urdf_sha256"] == files.digest(place / "robot_calibrated.urdf")
    assert said["read_back"]["position_um"] < 1
    assert "new.urdf, a new URDF without shapes" in fine("export", "model", "--urdf", "new.urdf")
    refused("export", "model", "--urdf", "robot_calibrated.urdf", said="testbench export wrote it")
    for urdf in ("in/robot.urdf", "new.urdf"):  # what the command wrote may be replaced
        assert "replaced" in fine("export", "model", "--urdf", urdf)
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
    fine("export", "drawn", "--urdf", "new.urdf")
    fine("export", "model", "--urdf", "new.urdf", "--out", "mine.urdf")
    assert (place / "mine.urdf").read_text() != (place / "new.urdf").read_text()
    fine("export", "model", "--urdf", "identified.urdf")
    done = do("export", "model", "--urdf", "identified.urdf", "--out", "mine.urdf")
    assert "from scratch, with the geometry of a calibration" in done.stderr
    beside = (place / "new.json").read_text().replace('"arm": "ur10"', '"arm": "arm_6r"')
    (place / "new.json").write_text(beside)
    said = "testbench export wrote this file for another arm, arm_6r; choose another name"
    refused("export", "model", "--urdf", "new.urdf", said=said, below=place)
    fine("export", "model", "--urdf", "new.urdf", "--force")


def test_offsets_in_a_controllers_file_and_what_they_cannot_hold(place):
    machine = "DEFDAT $MACHINE PUBLIC\n" + "".join(f"$MAMES[{k}]=0.0\n" for k in range(1, 7))
    (place / "in" / "$machine.dat").write_text(machine)
    said = fine("export", "model", "--into", "in/$machine.dat")
    new = (place / "$machine_calibrated.dat").read_text()
    told = re.search(
        r"(\d\.\d{3}) mm RMS, (\d\.\d{3}) mm at most: lengths and tilts of axes \(not in the file\)", said
    )
    assert f"; {told[1]} mm RMS, {told[2]} at most: lengths and tilts of axes\n" in new
    elbow = re.search(r"\$MAMES\[3\]=(.*)\n", new)[1]
    assert float(elbow) != 0
    assert f"elbow_joint {float(elbow):.4f}" in said
    fine("export", "model", "--into", "in/$machine.dat")  # what the command wrote may be replaced
    into = ("--into", "in/$machine.dat", "--out", "in/$machine.dat")
    refused("export", "model", *into, said="is read by this command", below=place)


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("model", "--urdf", "in/robot.urdf", "--out", "in/robot.urdf"), "is read by this command"),
        (
            ("model", "--urdf", "in/robot.urdf", "--out", "in/notes.urdf"),
            "is not a URDF that testbench export wrote",
        ),
        (("model", "--urdf", "in/robot.urdf", "--out", "in/robot.xml"), "ending with .urdf"),
        (
            ("model", "--urdf", "in/robott.urdf", "--out", "x.urdf"),
            "there is no such URDF of the robot; to write a",
        ),
        (("model", "--urdf", "new.urdf", "--tip", "tool0"), "omit --out and --tip"),
        (("model", "--urdf", "in/robot.urdf", "--tip", "tool1"), "no link, body or site 'tool1' for the tip"),
        (("model", "--urdf", "model/rigid.xml"), "expected URDF"),
        (("in", "--urdf", "new.urdf"), "expected the folder of a model"),
        (("model",), "expected either --urdf or --into"),
        (
            ("model", "--into", "in/machine.dat", "--gears", "1"),
            "--gears is only for a file of an ABB controller",
        ),
        (("model", "--into", "in/machine.dat"), "$machine.dat with a number at $MAMES[2]"),
        (("model", "--into", "in/twice.dat"), "$MAMES[1]: is there twice"),
        (("model", "--into", "in/MOC.cfg"), "--gears: expected 6 or 36 numbers with commas between them"),
        (
            ("model", "--into", "in/MOC.cfg", "--gears", "0,1,1,1,1,1"),
            "--gears: expected turns of each motor",
        ),
        (("model", "--into", "in/MOC.cfg", "--gears", "9,9,9,9,9,9"), 'at cal_offset of "rob1_1"'),
        (("model", "--into", "in/ur.yaml"), "kinematics of a UR driver: tools/ur_kinematics.py of a clone"),
        (("model", "--into", "in/ur.yaml", "--tip", "a"), "--tip is only for --urdf"),
        (("model", "--into", "in/robot.urdf"), "expected KUKA's $machine.dat or ABB's MOC.cfg"),
        (("model", "--into", "in/ours.yaml"), "testbench export wrote it; expected the robot's own file"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(place, args, said):
    (place / "in" / "notes.urdf").write_text("<robot name='mine'/>")
    texts = {
        "machine.dat": "$MAMES[1]=1.0\n$MAMES[2]=1e999\n",
        "twice.dat": "$MAMES[1]=1.0\n$mames[1] = 2.0\n",
        "MOC.cfg": 'MOC:CFG_1.0\nMOTOR_CALIB:\n#\nARM:\n  -name "rob1_1" -cal_offset 9\n',
        "ur.yaml": "kinematics:\n  shoulder:\n    x: 0\n    y: .inf\n",
        "ours.yaml": f"# {STAMP}\nkinematics:\n",
    }
    for name, text in texts.items():
        (place / "in" / name).write_text(text)
    refused("export", *args, said=said, below=place)
