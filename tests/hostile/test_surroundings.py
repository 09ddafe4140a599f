"""What stands around a command: settings in its folder and in the environment, folders of results."""

import json
import os
import subprocess
import sys

import pytest
from attack import ROOT

ASKED = """
from testbench.runs.command import undisturbed
undisturbed()
import matplotlib, mujoco, os
found = matplotlib.rcParams
print(found["savefig.dpi"], found["text.usetex"], os.environ.get("RERUN"), os.getcwd())
"""


@pytest.mark.parametrize("pipe", [False, True])
def test_settings_of_the_folder_and_the_environment_are_not_read(tmp_path, pipe):
    settings = tmp_path / "matplotlibrc"
    if pipe:
        os.mkfifo(settings)
    else:
        settings.write_text("savefig.dpi: 1000000\ntext.usetex: True\n")
    strange = {"MPLBACKEND": "none", "RERUN": "off", "MUJOCO_GL": "none such", "PYTHONPATH": str(ROOT)}
    env = {**os.environ, **strange, "MPLCONFIGDIR": str(tmp_path / "x")}
    done = {"cwd": tmp_path, "env": env, "capture_output": True, "text": True, "timeout": 60, "check": True}
    found = subprocess.run([sys.executable, "-c", ASKED], **done)
    assert found.stdout.split() == ["figure", "False", "None", str(tmp_path)]


def test_the_folder_of_results_may_be_a_link_which_is_written_itself_by_force_alone(attack, lab):
    (lab / "disk").mkdir()
    (lab / "runs").symlink_to("disk")
    attack(lab, "check", "arm", "--out", "runs").refused("is a symbolic link")
    attack(lab, "check", "arm", "--out", "runs", "--force").done("disk")
    (lab / "runs" / "manifest.json").unlink()
    attack(lab, *"simulate arm poses.csv --payload-kg 1 --out runs/new.csv".split()).done("disk")
    attack(lab, *"new runs/new --from robot.urdf".split()).done("disk")


@pytest.mark.parametrize(
    "names",
    [["../kept.txt", "sub/../../kept.txt", "", "/"], ["\0"], ["\ud800"]],
    ids=["elsewhere", "zero", "half"],
)
def test_a_manifest_of_a_stranger_removes_nothing_and_is_no_traceback(attack, lab, names):
    """What a run replaces it knows by names in manifest.json, which came with the folder."""
    kept = lab / "kept.txt"
    kept.write_text("kept")
    (lab / "out").mkdir()
    said = {"command": "testbench check", "versions": {"testbench": "0"}, "files": ["manifest.json", *names]}
    (lab / "out" / "manifest.json").write_text(json.dumps(said))
    found = attack(lab, "check", "arm", "--out", "out")
    if names == ["\ud800"]:  # no text: the manifest is none of ours
        found.refused("manifest.json", "was not written by testbench check")
    else:
        found.done("out")
    assert kept.read_text() == "kept"
