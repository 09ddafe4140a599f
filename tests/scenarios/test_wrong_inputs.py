"""Command lines that are wrong: one line says what was expected, exit code 2, nothing written."""

import shlex
import shutil

import numpy as np
import pytest
from run_here import ROOT, fine, refused
from serial_arms import write_arm

HEADER = ",".join(f"joint_{k}_rad" for k in range(1, 7))
PAIRS, ABSOLUTE = "identify kr500_l480", "simulate kr500_l480 --poses 3 --out o.csv"
PLACED, RANDOM = "simulate kr500_l480 poses.csv --out out", "simulate zyy --out out"
PLAN = "plan kr500_l480 --out out"
TASKED = f"{PLAN} --load 460 --candidates 100 --task tasks.csv"
WRONG = [
    (f"{PAIRS} data.csv --out out --model MGCO1", "--model: no model 'MGCO1'; models are Joints, MLS32"),
    (f"{PAIRS} data.csv --out out --model Joints --model joints", "--model: expected different models, got"),
    (f"{PAIRS} absurd.csv --out out", "expected 0 or numbers from 1e-100 up to"),
    (f"{PAIRS} exchanged.csv --out out", "before and after exch"),
    (f"{PAIRS} data.csv --out out --full-pose --model MGCO56", "expected rotation_before_*_rad"),
    (f"{PAIRS} data.csv --out out --model MGCO56 --check-pose 99", "no pose 99"),
    (f"{PAIRS} data.csv --out out --no-prior --uncertainty-percent 30", "cannot be combined with --no-prior"),
    (f"{PAIRS} marker.csv --out earlier", "no marker 'P9'"),
    (f"{PAIRS} data.csv --out data.csv/inside", "cannot be written"),
    (
        f"{PAIRS} data.csv --frame world --out out",
        "frame: expected auto, base, tracker or a .toml file",
    ),
    ("check kr500_l480 --elastic data.csv/elastic.xml", "elastic.xml"),
    ("check pieces", "elastic.toml: cannot be read"),
    (
        "compensate model p.csv --out o.csv --hold all",
        "error: --hold: expected one of 'pose', 'axis', 'position', got 'all'",
    ),
    ("check kr501", "or one of arm_6r, kr500_l480, single_link, ur10"),
    ("nothing", "nothing"),
    ("view pieces", "no recording (*.rrd) in "),
    ("simulate kr500_l480 floor.csv --out out", "collides with"),
    (f"simulate kr500_l480 poses.csv --out {'x' * 5000}", "250 bytes"),
    (f"{PLACED} --tracker=nan,0,0", "expected"),
    (RANDOM, "expected either a file of poses or --poses NUMBER"),
    (f"{RANDOM} --poses 0", "--poses"),
    (f"{RANDOM} --poses 2 --loads 5,5", "--loads: expected different masses, got '5,5'"),
    (f"{RANDOM} --poses 2 --loads 5 --payload-kg 5", "--loads cannot be combined with --payload-kg"),
    (f"{ABSOLUTE} --gear-urad 5", "--gear-urad is only for --absolute"),
    (f"{ABSOLUTE} --series 2", "--series is only for --absolute"),
    (
        f"{ABSOLUTE} --absolute --series 2",
        "o_2.csv: exists and is not a file of absolute readings; choose",
    ),
    (f"{ABSOLUTE} --absolute --tracker 1,2", "--tracker x,y,z [m]: expected 3 numbers with commas"),
    (f"{TASKED} --box 10,10,10,11,11,11", "most were refused by 'tool outside the work area'"),
    (f"{TASKED} --tracker 0,0,0.5", "inside link_0"),
    (f"{TASKED} --acceptance-deg 30", "expected the position of a tracker too"),
    (f"{TASKED} --poses 201", "poses: expected 1 to 200, got 201"),
    (f"{TASKED} --candidates 5", "--candidates: expected 12 to 50000, got 5"),
    (f"{TASKED} --load 460", "different loads"),
    (f"{TASKED} --sigma-um 0", "--sigma-um: expected"),
    (f"{TASKED} --uncertainty-percent 0", "--uncertainty-percent: expected"),
    (f"{TASKED} --uncertainty-percent 30 --no-prior", "cannot be combined with --no-prior"),
    (
        f"{TASKED} --poses 5 --no-prior",
        "expected at least 9 poses, or a prior for the other directions",
    ),
    (f"{TASKED} --model MLS32", "no plan for MLS32"),
    (f"{TASKED} --criterion X", "no criterion 'X'"),
    (f"{TASKED} --orders 2", "--orders is only for --absolute"),
    (PLAN, "--task: expected a CSV of tasks, or --absolute"),
    (f"{PLAN} --absolute --task tasks.csv", "--task cannot be combined with --absolute"),
    (
        f"{PLAN} --absolute --criterion test",
        "no criterion 'test' of absolute readings; criteria are D, A,",
    ),
    (f"{PLAN} --absolute --gear-urad 0", "--gear-urad: expected 1e-06 to 100000, got 0"),
    ("bench --quick --out out --task gravity-9", "--task: expected some of gravity-8"),
    ("bench --quick --out out none.py", "none.py"),
    ("bench --quick --out out ridge=own.py", "ENTRY.py: the name 'ridge' is taken: put another before it"),
    ("bench --quick --out out own.py:lacks", "own.py: it has no function 'lacks'"),
]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Sound files, and others with one fault each."""
    folder = tmp_path_factory.mktemp("lab")
    poses = np.deg2rad([[0, -90, 90, 0, 20, 0], [20, -80, 95, 10, -30, 15], [-30, -100, 70, 0, 45, 90]])
    files = {"poses": poses, "floor": [poses[0], np.deg2rad([0, 20, 60, 0, 0, 0])]}
    for name, rows in files.items():
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=HEADER, comments="")
    fine("simulate", "kr500_l480", folder / "poses.csv", "--out", folder / "data.csv", "--seed", 4)
    data = (folder / "data.csv").read_text()
    head, first, rest = data.split("\n", 2)
    swapped = head.replace("before_", "later_").replace("after_", "before_").replace("later_", "after_")
    cells = first.split(",")
    written = {
        "marker.csv": data.replace(",P2,", ",P9,", 1),
        "absurd.csv": "\n".join([head, ",".join([*cells[:20], "1e300", *cells[21:]]), rest]),
        "exchanged.csv": "\n".join([swapped, first, rest]),
        "o_2.csv": "my notes",
        "earlier/models.json": "earlier",
        "drawn/a.rrd": "RRF2",
        "own.py": "def estimate(*_):\n    return None\n",
        "tasks.csv": (ROOT / "docs" / "tasks.csv").read_text(),
    }
    for name, text in written.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    (shutil.copytree(ROOT / "models" / "kr500_l480", folder / "pieces") / "elastic.toml").unlink()
    write_arm(folder / "zyy", "zyy")
    return folder


@pytest.mark.parametrize(("line", "said"), WRONG, ids=lambda text: text[:60])
def test_it_is_one_line_and_nothing_is_written(lab, monkeypatch, line, said):
    monkeypatch.chdir(lab)
    refused(*shlex.split(line), said=said, below=lab)
