"""The `testbench` command on a user's own arm, poses and runs."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from listening import listening
from made_up_run import REPORT
from run_here import do, fine, heed_ctrl_c, numbers_alone, refused
from tables import write_table

from testbench import __version__
from testbench.cli.program import COMMANDS
from testbench.files.write import write_csv
from testbench.identify.prior import cad_prior
from testbench.report.recording.run import write_run
from testbench.report.recording.stream import RecordingHeader
from testbench.report.scene import PageContent
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.cell import build_cell
from testbench.workflows.models import asked_models
from testbench.workflows.options import mass, read_masses

ROOT = Path(__file__).resolve().parents[2]
ARM = ROOT / "models" / "kr500_l480"
HEADER = ",".join(f"joint_{k}_rad" for k in range(1, 7))
POSES = [[0, -90, 90, 0, 20, 0], [20, -80, 95, 10, -30, 15], [-30, -100, 70, 0, 45, 90]]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    poses = write_table(folder / "poses.csv", HEADER, np.deg2rad(POSES * 3))
    assert "9 runs under 460.3 kg, deflections" in fine(
        "simulate", ARM, poses, "--out", folder / "data.csv", "--seed", 4
    )
    return folder


def test_check_says_what_is_in_the_arm_and_what_to_confirm():
    words = fine("check", ARM)
    for said in (
        "joint_2: range -130 to 20 deg; compliance 0.075 urad/(N m) (inferred)",
        "marker P3: 0.16 -0.12 -0.4 m in the tool's frame",
        "18 % link_2's tube diameters 340/310 mm, E 110 GPa, assumed",
        "460.3 kg move the tool by 3.46 mm (median over random poses). Warnings: 0.",
        "460.3 kg 0.852 3.46 6.4 8.1",
    ):
        assert said in words
    assert not re.search(r"\de[+-]?\d", words)


@pytest.mark.parametrize(
    "asked",
    [pytest.param("data check kr500_l480 docs/example_dataset.csv", marks=pytest.mark.study), "--help"],
)
def test_a_reader_that_is_gone_is_no_missed_threshold(asked):
    words = [sys.executable, "-c", "from testbench.cli import main; main()", *asked.split()]
    gone = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    gone.stdout.close()
    assert gone.communicate()[1] == b""
    assert gone.returncode == 141


def identified(data, out, *flags):
    """What is said of a fit, and what is written of it."""
    with numbers_alone():
        said = fine("identify", ARM, data, *flags, "--out", out)
    return said, json.loads((out / "models.json").read_text())


PLAIN = ["Joints", "MLS56", "MGCO56", "MGCO68"]
FILLED = ["Joints + prior", "MGCO56 + prior", "MGCO68 + prior", "ALL153 + prior"]
EVERY = ["Joints", "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68", "MGCO69", "MGCO147", "ALL153"]


def test_without_a_model_those_of_the_default_are_fitted(kr500):
    prior = cad_prior(kr500.arm)
    assert [m.name for m in asked_models(kr500, (), prior)] == [*PLAIN, *FILLED]
    assert [m.name for m in asked_models(kr500, (), None)] == EVERY


def test_masses_are_read_in_their_units():
    for text, kilograms in {
        "240": 240,
        "240kg": 240,
        "240 KG": 240,
        "100lb": 45.359237,
        "981 daN": 1000,
        " 0.24 t": 240,
    }.items():
        assert mass(text) == pytest.approx(kilograms, rel=1e-4)
    with pytest.raises(typer.BadParameter, match="expected a mass such as 240, 240kg"):
        mass("240 stone")
    assert read_masses("100lb,240 kg, 981 daN") == pytest.approx([45.359237, 240, 1000], rel=1e-4)


def test_poses_of_other_names_are_read_by_a_map(tmp_path):
    """The same runs as from our names; a map without the joints says which names are expected."""
    head, row = [f"joint_{k}_deg" for k in range(1, 7)], "10,-80,70,5,40,3\n"
    plain, named, table = (tmp_path / name for name in ("plain.csv", "named.csv", "map.toml"))
    plain.write_text(",".join(head) + "\n" + row)
    named.write_text(",".join(f"Achse{k}" for k in range(1, 7)) + "\n" + row)
    table.write_text("[columns]\n" + "".join(f'joint_{k}_deg = "Achse{k}"\n' for k in range(1, 7)))
    for file, flags in ((plain, ()), (named, ("--map", table))):
        fine("simulate", "kr500_l480", file, *flags, "--out", tmp_path / f"runs_{file.stem}.csv")
    assert (tmp_path / "runs_plain.csv").read_bytes() == (tmp_path / "runs_named.csv").read_bytes()
    said = "no column name is known: expected joint_1_deg, joint_2_deg"
    refused("simulate", "kr500_l480", named, "--out", tmp_path / "no.csv", said=said)
    asked = ("--task", named, "--map", table, "--out", tmp_path / "p", "--poses", 0)
    assert "Achse" not in refused("plan", "kr500_l480", *asked)  # what is wrong is the number of poses


def test_view_without_a_display_says_what_else_there_is(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "recording.rrd").write_bytes(b"RRF2")
    said = refused("view", tmp_path)
    assert f"`testbench view {tmp_path} --web`" in said
    assert "report.html" not in said
    (tmp_path / "report.html").touch()
    refused("view", tmp_path, said=f"{tmp_path / 'report.html'} opens anywhere")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.study
def test_view_serves_a_browser_of_this_machine_only_until_ctrl_c(tmp_path):
    write_run(tmp_path / "recording.rrd", RecordingHeader("test", "{}", 1), REPORT, PageContent(), {})
    start = "from testbench.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", start, "view", tmp_path, "--web"],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "BROWSER": "true", "NO_COLOR": "1"},
        preexec_fn=heed_ctrl_c,
    )
    viewer = None
    try:
        line = next(line for line in process.stderr if "Hosting a web-viewer" in line)
        (viewer,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        address = re.search(r"http://127\.0\.0\.1:\d+", line)[0]
        with urllib.request.urlopen(address, timeout=30) as answer:
            assert b"re_viewer" in answer.read()
        listens = listening(int(viewer))
        assert len(listens) == 2
        assert {place.split(":")[0] for place in listens} == {"0100007F"}
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)  # to the end of what the viewer may say: it is gone too
        assert process.returncode == 130
        assert err.splitlines()[-1].startswith("interrupted:")
    finally:
        for pid in (process.pid, *([int(viewer)] if viewer else [])):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.communicate()


def test_prior_and_robust_loss_are_named_and_outliers_listed(simulated, tmp_path):
    lines = (simulated / "data.csv").read_text().splitlines()
    column = lines[0].split(",").index("after_x_m")
    cells = lines[8].split(",")
    cells[column] = repr(float(cells[column]) + 2e-3)
    (tmp_path / "spoiled.csv").write_text("\n".join([*lines[:8], ",".join(cells), *lines[9:]]) + "\n")
    flags = ["--uncertainty-percent", "30", "--robust", "--model", "MGCO56"]
    _, written = identified(tmp_path / "spoiled.csv", tmp_path / "fit", *flags)
    [model] = written["models"]
    run_id, marker = cells[lines[0].split(",").index("run")], cells[lines[0].split(",").index("marker")]
    assert [(r["run"], r["marker"]) for r in model["rejected"]] == [(int(run_id), marker)]
    text = (tmp_path / "fit" / "report.md").read_text()
    assert "uncertainty of 30 %" in text
    assert "Outliers left out of MGCO56 + prior: 1." in text


def test_poses_held_back_are_scored_with_intervals_and_none_where_the_data_see_nothing(simulated, tmp_path):
    flags = ["--model", "MLS56", "--no-prior", "--check-pose", "2", "--check-pose", "3"]
    said, written = identified(simulated / "data.csv", tmp_path / "fit", *flags)
    [model] = written["models"]
    found = model["intervals"]
    assert model["check"]["rms_mm"] > 0
    assert model["equations"] == 7 * 9
    of = {(run_, marker) for run_ in (2, 3) for marker in ("P1", "P2", "P3")}
    assert {(d["run"], d["marker"]) for d in found["deflections"]} == of
    widths = [
        (high - low) / 2
        for d in found["deflections"]
        for low, high in zip(d["lower_mm"], d["upper_mm"], strict=True)
        if low is not None
    ]
    assert found["components"] == 18 == len(widths) + found["unbounded"]
    assert max(widths) == pytest.approx(found["half_width_max_mm"], rel=1e-9)
    assert found["confidence"] == 0.95
    assert f"{found['half_width_mm']:.3f}" in said


@pytest.mark.study
def test_a_pose_whose_targets_were_all_lost_is_lived_with(tmp_path):
    """The tracker saw nothing in pose 3: fits, cross-validation and doubts do without it."""
    out, data = tmp_path / "fit", tmp_path / "lost_everywhere.csv"
    cell = build_cell(ARM)
    scenario = Scenario(arm="kr500_l480", identification_poses=6, identification_runs=6, workspace_poses=1)
    clean = simulate(cell, scenario, 1).identification
    P = np.array(np.broadcast_to(np.eye(3) / (2 * clean.sigma**2), (6, 3, 3, 3)))
    P[2] = 0
    write_csv(replace(clean, precision=P), tuple(j.name for j in cell.arm.joints), data)
    models = ["--model", "MGCO56", "--model", "MGCO47"]
    assert "Warning" not in fine("identify", ARM, data, *models, "--out", out)
    held_back = ("--check-pose", 3, "--out", out)
    refused("identify", ARM, data, *models, *held_back, said="every target was lost there", below=tmp_path)


SCREEN = 45  #: Lines of a terminal of 100 columns.
HEAVY = {"mujoco", "pinocchio", "rerun", "matplotlib", "scipy", "pyarrow"}


def test_help_lists_every_command_and_imports_nothing_heavy():
    code = "import sys; from testbench.runs import command; from testbench.cli.program import program; "
    code += "command.run(program([])); sys.argv[1:] = ['--version']; command.run(program([])); "
    code += "print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=True)
    assert all(words in done.stdout for words in (*COMMANDS, f"testbench {__version__}\n"))
    assert not HEAVY & set(done.stderr.split())


def test_every_command_says_its_flags_on_one_screen(monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    for name, words in COMMANDS.items():
        done = do(name, "--help")
        assert (done.returncode, done.stderr) == (0, "")
        assert words in done.stdout
        assert "--help" in done.stdout
        assert len(done.stdout.splitlines()) <= SCREEN
        assert " ," not in done.stdout  # a unit in square brackets would be taken for a style, and be gone
        assert " ;" not in done.stdout
