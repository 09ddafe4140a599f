"""The `testbench` command on a user's own arm, poses and runs."""

import http.client
import json
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import typer
from listening import listening
from made_up_run import REPORT
from run_here import heed_ctrl_c, here

from testbench import __version__
from testbench.campaign.campaign import Scenario, build_cell, simulate
from testbench.campaign.campaign_flags import mass
from testbench.campaign.plan_input import read_masses
from testbench.cli.program import COMMANDS, program
from testbench.data.write import write_csv
from testbench.views.recording.run import write_run
from testbench.views.recording.stream import Header
from testbench.views.scene import Seen

ROOT = Path(__file__).resolve().parents[2]
ARM = ROOT / "models" / "kr500_l480"
HEADER = ",".join(f"joint_{k}_rad" for k in range(1, 7))
POSES = [[0, -90, 90, 0, 20, 0], [20, -80, 95, 10, -30, 15], [-30, -100, 70, 0, 45, 90]]


def run(*args):
    return here(program(args[:1]), *args)


def refused(done):
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr + done.stdout
    return done.stderr


def write_poses(path, degrees, header=HEADER):
    rows = [",".join(repr(float(x)) for x in np.deg2rad(row)) for row in degrees]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    poses = write_poses(folder / "poses.csv", POSES * 3)
    done = run("simulate", ARM, poses, "--out", folder / "data.csv", "--seed", 4)
    assert done.returncode == 0, done.stderr
    assert "9 runs, deflections" in done.stdout
    return folder


def test_check_says_what_is_in_the_arm_and_what_to_confirm():
    done = run("check", ARM)
    assert done.returncode == 0
    assert "joint_2: -130 to 20 deg, 0.075 urad/(N m), inferred" in done.stdout
    assert "markers P1, P2, P3" in done.stdout
    assert "18 %  link_2's tube 340/310 mm, E 110 GPa, assumed" in done.stdout
    words = " ".join(done.stdout.split())
    sag = "460.3 kg move the tool by 3.46 mm (0.852 to 6.4 in nine of ten poses)."
    assert f"{sag} No doubts about the arm. Most at x " in words
    assert " m: 8.1 mm, joints at [" in words
    assert "joint_2 does 34 % of the sag." in words
    assert not re.search(r"\de[+-]?\d", words)


def test_a_reader_that_is_gone_is_no_missed_threshold():
    start = "from testbench.cli import main; main()"
    words = [sys.executable, "-c", start, "data", "check", "kr500_l480", "docs/example_dataset.csv"]
    gone = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    gone.stdout.close()
    assert gone.communicate()[1] == b""
    assert gone.returncode == 141


def test_elastic_writes_a_model_that_mujoco_opens(tmp_path):
    assert run("elastic", ARM, tmp_path / "elastic.xml").returncode == 0
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "elastic.xml")).ntendon == 42


PLAIN = ["Joints", "MLS56", "MGCO56", "MGCO68"]
FILLED = ["Joints + prior", "MGCO56 + prior", "MGCO68 + prior", "ALL153 + prior"]
EVERY = ["Joints", "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68", "MGCO69", "MGCO147", "ALL153"]


@pytest.mark.parametrize(("flags", "wanted"), [([], [*PLAIN, *FILLED]), (["--no-prior"], EVERY)])
def test_without_a_model_those_of_the_default_are_fitted(simulated, tmp_path, flags, wanted):
    done = run("identify", ARM, simulated / "data.csv", *flags, "--out", tmp_path / "fit")
    assert done.returncode == 0, done.stderr
    written = json.loads((tmp_path / "fit" / "models.json").read_text())
    assert [m["name"] for m in written["models"]] == wanted
    assert [m["intervals"] is not None for m in written["models"]] == [
        m in FILLED or bool(flags) for m in wanted
    ]
    assert written["recommended"] in wanted
    assert bool(written["unchecked"]["stiffer"]) == (written["recommended"] in FILLED)


def of_data(change, *flags):
    """Arguments of identify with runs that are not as they were."""

    def args(simulated, folder):
        text = (simulated / "data.csv").read_text()
        (folder / "changed.csv").write_text(change(text))
        return "identify", ARM, folder / "changed.csv", *flags, "--out", folder / "out"

    return args


def of_poses(degrees, header=HEADER):
    return lambda _, folder: (
        *("simulate", ARM, write_poses(folder / "poses.csv", degrees, header)),
        *("--out", folder / "out"),
    )


def cells(text, change):
    """Runs with other cells in each row, or in the first one alone."""
    head, *rows = (line.split(",") for line in text.splitlines())
    return "\n".join(",".join(row) for row in [head, *map(change, rows)])


def degrees(row):
    return [*row[:3], *(repr(float(np.rad2deg(float(x)))) for x in row[3:9]), *row[9:]]


def exchanged(text):
    return text.replace("before_", "later_").replace("after_", "before_").replace("later_", "after_")


def in_pieces(_, folder):
    (shutil.copytree(ARM, folder / "arm") / "elastic.toml").unlink()
    return "check", folder / "arm"


def with_recording(*flags):
    def args(_, folder):
        (folder / "recording.rrd").write_bytes(b"RRF2")
        return "shot", folder / "recording.rrd", *flags

    return args


REFUSED = {
    "no such model": (
        of_data(str, "--model", "MGCO1"),
        "--model: no model 'MGCO1'; models are Joints, MLS32",
    ),
    "no such column": (
        of_data(lambda t: t.replace("force_z_N", "force_up_N")),
        "missing columns ['force_z_N']",
    ),
    "no number": (of_data(lambda t: t.replace("-4515.54", "nan", 1)), "column force_z_N"),
    "no such marker": (of_data(lambda t: t.replace(",P2,", ",P9,", 1)), "no marker 'P9'"),
    "no rows": (of_data(lambda t: t.splitlines()[0]), "expected at least one row"),
    "degrees": (of_data(lambda t: cells(t, degrees)), "are these degrees?"),
    "absurd": (
        of_data(lambda t: cells(t, lambda row: [*row[:20], "1e300", *row[21:]])),
        "expected numbers up to",
    ),
    "a sigma in um": (of_data(lambda t: t.replace("5e-05", "50.0")), "expected 1e-09 to 0.01, got 50"),
    "exchanged": (
        of_data(lambda t: exchanged(t.split("\n")[0]) + t[t.index("\n") :]),
        "before and after exch",
    ),
    "a term of none": (of_data(str, "--full-pose", "--model", "MGCO56"), "expected rotation_before_*_rad"),
    "a pose of none": (of_data(str, "--model", "MGCO56", "--check-pose", "99"), "no pose 99"),
    "no prior": (of_data(str, "--no-prior", "--uncertainty-percent", "30"), "expected a prior with it"),
    "a sure prior": (of_data(str, "--uncertainty-percent", "0"), "--uncertainty-percent: Input should be"),
    "out of reach": (
        of_poses([POSES[0], [0, 60, 90, 0, 0, 0]]),
        "line 3, column joint_2_rad: expected -2.2689 to 0.3491 rad",
    ),
    "in the floor": (of_poses([POSES[0], [0, 20, 60, 0, 0, 0]]), "collides with"),
    "other columns": (of_poses(POSES, HEADER.replace("_rad", "_grad")), "joint_6_deg, got joint_1_grad, "),
    "an arm in pieces": (in_pieces, "elastic.toml: cannot be read"),
    "nothing": (lambda *_: (), ""),
    "an endless name": (
        lambda runs, folder: ("simulate", ARM, runs / "poses.csv", "--out", folder / ("x" * 5000)),
        "255 bytes",
    ),
    "nothing to view": (lambda _, folder: ("view", folder), "no recording (*.rrd) in "),
    "nothing to follow": (lambda _, folder: ("next", folder), "expected the folder of a finished run"),
    "nothing to draw": (lambda _, folder: ("shot", folder), "no recording (*.rrd) in "),
    "a picture of another kind": (with_recording("--out", "a.jpg"), "ends with .png or .gif or .mp4"),
    "no film": (with_recording("--gif", "--out", "a.png"), "--out: expected a name that ends with .gif"),
    "a moment of a film": (with_recording("--out", "a.gif", "--at", "3"), "--at: "),
    "no size": (with_recording("--size", "foo"), "size: expected WIDTHxHEIGHT"),
    "an input": (
        lambda runs, _: ("identifiability", ARM, runs / "data.csv", "--figure", runs / "data.csv"),
        "is read by this command",
    ),
    "a folder": (
        lambda runs, folder: ("identifiability", ARM, runs / "data.csv", "--figure", folder),
        "got a folder",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_one_line_and_nothing_is_written(simulated, tmp_path, name):
    args, said = REFUSED[name]
    assert said in refused(run(*args(simulated, tmp_path)))
    assert not (tmp_path / "out").exists()


def test_a_broken_dataset_leaves_earlier_results(simulated, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "models.json").write_text("earlier")
    args = of_data(lambda text: text.replace(",P2,", ",P9,", 1))(simulated, tmp_path)
    refused(run(*args))
    assert (tmp_path / "out" / "models.json").read_text() == "earlier"


def test_an_unwritable_place_is_one_line(simulated, tmp_path):
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / "inside"
    assert "cannot be written" in refused(run("identify", ARM, simulated / "data.csv", "--out", place))
    assert "elastic.xml" in refused(run("elastic", ARM, tmp_path / "file" / "elastic.xml"))


def test_a_marker_that_did_not_move_is_no_fault(simulated, tmp_path):
    text = (simulated / "data.csv").read_text().splitlines()
    row = text[1].split(",")
    row[21:24] = row[18:21]  # after = before
    (tmp_path / "still.csv").write_text("\n".join([text[0], ",".join(row), *text[2:]]))
    done = run("identify", ARM, tmp_path / "still.csv", "--model", "MGCO56", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("text", "kilograms"),
    {
        "240": 240,
        "240kg": 240,
        " 0.24 t": None,
        "240 KG": 240,
        "100lb": 45.359237,
        "981 daN": 1000,
    }.items(),
)
def test_a_mass_is_read_in_its_unit(text, kilograms):
    if kilograms is None:
        with pytest.raises(
            typer.BadParameter, match="expected one of the units N, daN, kN, lbf, kgf, kg, lb"
        ):
            mass(text)
    else:
        assert mass(text) == pytest.approx(kilograms, rel=1e-4)


def test_several_masses_are_read_in_their_units():
    assert read_masses("100lb,240 kg, 981 daN") == pytest.approx([45.359237, 240, 1000], rel=1e-4)


def test_poses_of_other_names_are_read_by_a_map(tmp_path):
    """The same runs as from our names; a map without the joints says which names are expected."""
    head, row = [f"joint_{k}_deg" for k in range(1, 7)], "10,-80,70,5,40,3\n"
    plain, named, table = (tmp_path / name for name in ("plain.csv", "named.csv", "map.toml"))
    plain.write_text(",".join(head) + "\n" + row)
    named.write_text(",".join(f"Achse{k}" for k in range(1, 7)) + "\n" + row)
    table.write_text("[columns]\n" + "".join(f'joint_{k}_deg = "Achse{k}"\n' for k in range(1, 7)))
    for file, flags in ((plain, ()), (named, ("--map", table))):
        out = tmp_path / f"runs_{file.stem}.csv"
        done = run("simulate", "kr500_l480", file, *flags, "--out", out)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs_plain.csv").read_bytes() == (tmp_path / "runs_named.csv").read_bytes()
    said = refused(run("simulate", "kr500_l480", named, "--out", tmp_path / "no.csv"))
    assert "no column is known, expected joint_1_deg, joint_2_deg" in said
    tasks = run("plan", "kr500_l480", "--task", named, "--map", table, "--out", tmp_path / "p", "--poses", 0)
    assert "Achse" not in tasks.stderr  # what is wrong is the number of poses


def test_view_without_a_display_says_what_else_there_is(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "recording.rrd").write_bytes(b"RRF2")
    said = refused(run("view", tmp_path))
    assert f"`testbench view {tmp_path} --web`" in said
    assert f"`testbench shot {tmp_path}`" in said
    assert "report.html" not in said
    (tmp_path / "report.html").touch()
    assert f"{tmp_path / 'report.html'} opens anywhere" in refused(run("view", tmp_path))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_view_serves_recording_and_page_to_this_machine_until_ctrl_c(tmp_path):
    manifest = {
        "versions": {"testbench": "0"},
        "command": "x",
        "files": ["report.html", "a.png", "dataset.csv", "../above.png", ".."],
    }
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    for name in ("report.html", "a.png", "stranger.png", "dataset.csv"):
        (tmp_path / name).write_bytes(name.encode())
    write_run(tmp_path / "recording.rrd", Header("test", "{}", 1), REPORT, Seen(), {})
    start = "from testbench.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", start, "view", tmp_path, "--web"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_ctrl_c,
    )
    recording, page, elsewhere, _ = (process.stdout.readline().split() for _ in range(4))
    port = int(page[1].split(":")[2].split("/")[0])
    assert listening(process.pid) == [f"0100007F:{port:04X}"]
    assert f"-L {port}:127.0.0.1:{port}" in " ".join(elsewhere)
    root = page[1].removesuffix("report.html")
    token = root.removeprefix(f"http://127.0.0.1:{port}").strip("/")
    assert len(token) >= 32
    assert recording[1] == f"{root}recording"

    def status(path, token=f"/{token}"):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        connection.request("GET", token + path)
        answer = connection.getresponse()
        answer.read()
        return answer.status

    served = ["/", "/report.html", "/a.png", "/recording.rrd", "/viewer/", "/viewer/re_viewer_bg.wasm"]
    assert [status(path) for path in [*served, "/recording"]] == [200] * 7
    assert [status(path, "") for path in [*served, "/recording", "/favicon.ico"]] == [403] * 8
    hidden = ["/stranger.png", "/dataset.csv", "/manifest.json", "/viewer/../dataset.csv"]
    assert [status(path) for path in hidden] == [404] * 4
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, children) == (130, "", "")
    assert err.startswith("interrupted: nothing is served any more")


def test_prior_and_robust_loss_are_named_and_outliers_listed(simulated, tmp_path):
    lines = (simulated / "data.csv").read_text().splitlines()
    column = lines[0].split(",").index("after_x_m")
    cells = lines[8].split(",")
    cells[column] = repr(float(cells[column]) + 2e-3)
    (tmp_path / "spoiled.csv").write_text("\n".join([*lines[:8], ",".join(cells), *lines[9:]]) + "\n")
    flags = ["--uncertainty-percent", "30", "--robust", "--model", "MGCO56", "--out", tmp_path / "fit"]
    done = run("identify", ARM, tmp_path / "spoiled.csv", *flags)
    assert done.returncode == 0, done.stderr
    [model] = json.loads((tmp_path / "fit" / "models.json").read_text())["models"]
    run_id, marker = cells[lines[0].split(",").index("run")], cells[lines[0].split(",").index("marker")]
    assert [(r["run"], r["marker"]) for r in model["rejected"]] == [(int(run_id), marker)]
    text = (tmp_path / "fit" / "report.md").read_text()
    assert "uncertainty 30 %" in text
    assert "is fitted without 1 outlier; errors here count all readings." in text


def test_identifiability_is_said_before_any_fit(simulated, tmp_path, pixels):
    with pixels():
        done = run("identifiability", ARM, simulated / "data.csv", "--figure", tmp_path / "seen.png")
    assert done.returncode == 0, done.stderr
    assert "MGCO68 has 68 unknowns" in done.stdout
    assert "What would help most: " in done.stdout
    assert done.stdout.count(" • ") == 5
    named = run("identifiability", ARM, simulated / "data.csv", "--more")
    assert "No experiment tells apart: " in named.stdout
    assert "more with --more" in done.stdout
    assert "more with --more" not in named.stdout
    assert (tmp_path / "seen.png").read_bytes().startswith(b"\x89PNG")


def test_one_of_several_models_is_recommended_by_cross_validation(simulated, tmp_path):
    flags = ["--uncertainty-percent", "30", "--model", "mgco56", "--model", "MGCO47"]
    done = run("identify", ARM, simulated / "data.csv", *flags, "--out", tmp_path / "fit")
    assert done.returncode == 0, done.stderr
    written = json.loads((tmp_path / "fit" / "models.json").read_text())
    words = " ".join(done.stdout.split())
    assert f"Take {written['recommended']}" in words
    assert f"Why {written['recommended']}: {written['why']}." in words
    assert [c["name"] for c in written["held_out"]] == ["MGCO56 + prior", "MGCO47 + prior"]


def test_poses_held_back_are_scored_with_intervals_and_none_where_the_data_see_nothing(simulated, tmp_path):
    held = ["--check-pose", "2", "--check-pose", "3"]
    flags = ["--model", "MLS56", "--no-prior", *held, "--out", tmp_path / "fit"]
    done = run("identify", ARM, simulated / "data.csv", *flags)
    assert done.returncode == 0, done.stderr
    [model] = json.loads((tmp_path / "fit" / "models.json").read_text())["models"]
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
    assert f"{found['half_width_mm']:.3f}" in done.stdout


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
    done = run("identify", ARM, data, *models, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "Doubt" not in done.stdout
    held = run("identify", ARM, data, *models, "--check-pose", 3, "--out", out)
    assert held.returncode == 2
    assert "every target was lost there" in held.stderr


HEAVY = {"mujoco", "pinocchio", "rerun", "matplotlib", "scipy", "pyarrow"}


def test_help_lists_every_command_and_imports_nothing_heavy():
    code = "import sys; from testbench.shell import command; from testbench.cli.program import program; "
    code += "command.run(program([])); print(*sys.modules, file=sys.stderr)"
    for flag, said in (("--help", COMMANDS), ("--version", [f"testbench {__version__}\n"])):
        done = subprocess.run([sys.executable, "-c", code, flag], capture_output=True, text=True, check=True)
        assert all(words in done.stdout for words in said)
        assert not HEAVY & set(done.stderr.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_its_flags(name):
    done = run(name, "--help")
    assert done.returncode == 0, done.stderr
    assert COMMANDS[name] in done.stdout
    assert "--help" in done.stdout
    assert " ," not in done.stdout  # a unit in square brackets would be taken for a style, and be gone
    assert " ;" not in done.stdout


def test_our_arms_are_known_by_name_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "joint_2: -130 to 20 deg" in run("check", "kr500_l480").stdout
    message = refused(run("check", "kr501"))
    assert message.endswith("or one of arm_6r, kr500_l480, single_link, ur10\n")
