"""testbench.toml of the current folder: values of flags, once for all commands."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from run_here import do, fine, refused
from strangers import heavy_urdf

from testbench.arm.folder import load_arm
from testbench.files.read_series import read_series
from testbench.workflows.options import NAME, Project, read_project

ROOT = Path(__file__).resolve().parents[2]
ARM = "kr500_l480"
MAP = '[columns]\n"joint_{n}_rad" = "A{n}"\n"{axis}_m" = "Ist {axis}_m"\nmarker = "Ziel"\n'


def taken(folder):
    return json.loads((folder / "manifest.json").read_text())["project"]


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    """An instrument's file in German."""
    file = tmp_path_factory.mktemp("instrument") / "may.csv"
    fine("simulate", ARM, "--poses", 24, "--absolute", "--tracker", "4,-2,1.5", "--out", file)
    head, rows = file.read_text().replace("marker", "Ziel", 1).split("\n", 1)
    for theirs, ours in [*((f"A{k} [rad]", f"joint_{k}_rad") for k in range(1, 7)), ("Ist ", "position_")]:
        head = head.replace(ours, theirs)
    return f"{head}\n{rows}"


@pytest.fixture
def cell(export, tmp_path, monkeypatch):
    """A folder with that file, its map, and nothing else."""
    monkeypatch.chdir(tmp_path)
    Path("may.csv").write_text(export)
    Path("may.toml").write_text(MAP)
    return tmp_path


def instrument(arm):
    """What a tracker writes in German of an arm in 30 poses, and a program of two of them."""
    fine("simulate", arm, "--poses", 30, "--absolute", "--tracker", "3,-2,1.5", "--out", "known.csv")
    [series] = read_series("known.csv", load_arm(Path(arm))).series
    joints = [joint.display_column for joint in load_arm(Path(arm)).joints]
    lines = [f"Punkt;X;Y;Z;{';'.join(f'Achse {k + 1} [°]' for k in range(len(joints)))}"]
    for k, (q, places) in enumerate(zip(np.degrees(series.q), series.position, strict=True)):
        numbers = [f"{x:.5f}".replace(".", ",") for x in (*1e3 * places[0], *q)]
        lines.append(";".join([f"P{k + 1:02}", *numbers]))
    Path("leica.txt").write_text("\n".join(lines) + "\n", encoding="cp1252")
    rows = [",".join(f"{x:.5f}" for x in np.degrees(series.q[k])) for k in (0, 3)]
    Path("program.csv").write_text("\n".join([",".join(joints), *rows]) + "\n")


def test_from_a_urdf_and_an_instrument_s_file_to_a_corrected_program_in_six_commands(cell):
    """None has a flag that the project file knows; manifests say which values were taken."""
    heavy_urdf(cell)
    words = []

    def step(*args):
        words.append(args)
        return fine(*args)

    step("new", "my_arm", "--from", "heavy.urdf", "--payload-kg", 300, "--project")
    instrument("my_arm")
    step("data", "map", "my_arm", "leica.txt")
    examples = {'# payload = "120kg"': 'payload = "120kg"', "# sigma_um = 50": "sigma_um = 20"}
    text = NAME.read_text()
    for example, own in examples.items():  # as with an editor
        text = text.replace(example, own)
    NAME.write_text(f'{text}\n[files."leica.txt"]\nmap = "leica.toml"\n')
    step("check")
    step("calibrate", "leica.txt")
    step("compensate", "runs/calibrate", "program.csv", "--out", "corrected.csv", "--jumps")
    step("export", "runs/calibrate")
    assert len(words) == 6
    assert "error: none.yaml: " in do("export", "runs/calibrate", "--into", "none.yaml").stderr  # no --urdf
    assert Path("corrected.csv").is_file()
    assert Path("heavy_calibrated.urdf").is_file()
    flags = {word for args in words for word in args[1:] if str(word).startswith("--")}
    assert flags == {"--from", "--payload-kg", "--project", "--out", "--jumps"}
    found = taken(Path("corrected_report"))
    assert found["taken"] == {"arm": "my_arm", "payload": "120kg"}
    assert found["sha256"] == hashlib.sha256(NAME.read_bytes()).hexdigest()
    known = {"arm": "my_arm", "sigma_um": 20.0, "map": {"leica.txt": "leica.toml"}}
    assert taken(Path("runs/calibrate"))["taken"] == known


@pytest.mark.study
def test_a_file_has_its_own_values_and_flags_count_more(cell):
    NAME.write_text(
        f'arm = "{ARM}"\nsigma_um = 40\nload = "460kg"\n'
        '[files."may.csv"]\nmap = "may.toml"\nload = "661.38678655lb"\n'
    )
    june = Path("may.csv").read_text().splitlines()
    Path("june.csv").write_text("\n".join([june[0], *june[40:]]) + "\n")
    Path("may.csv").write_text("\n".join(june[:40]) + "\n")
    assert "june.csv" in do("calibrate", "may.csv", "june.csv").stderr  # whose names the map has
    fine("calibrate", "may.csv", "./june.csv", "--map", "may.toml", "--out", "both")
    found = json.loads(Path("both/manifest.json").read_text())
    assert found["scenario"]["sigma_um"] == 40.0
    assert found["scenario"]["load"] == [pytest.approx(300.0), None]  # 460 kg hang in no file without a word
    loads = {"may.csv": "661.38678655lb"}
    assert found["project"]["taken"] == {"arm": ARM, "sigma_um": 40.0, "load": loads}
    fine("calibrate", ARM, "may.csv", "june.csv", "--map", "may.toml", "--sigma-um", 5, "--out", "flags")
    assert json.loads(Path("flags/manifest.json").read_text())["scenario"]["sigma_um"] == 5.0


@pytest.mark.study
def test_a_pair_without_a_mass_has_the_project_s_load(cell):
    fine("simulate", ARM, ROOT / "docs" / "poses.csv", "--payload-kg", 460, "--out", "pairs.csv")
    names, *rows = [line.split(",") for line in Path("pairs.csv").read_text().splitlines()]
    kept = [k for k, name in enumerate(names) if not name.startswith(("force", "moment", "point"))]
    Path("pairs.csv").write_text("\n".join(",".join(row[k] for k in kept) for row in [names, *rows]) + "\n")
    NAME.write_text(f'arm = "{ARM}"\nload = 460\ntargets = ["P9"]\n')
    words = fine("data", "check", "pairs.csv", "--out", "seen")
    assert "4512.6 N (the weight of 460 kg) in 11 runs" in words
    assert "no column gives a mass: loaded rows get the 460 kg that you stated" in words
    assert "testbench identify pairs.csv --new-target" not in words
    assert "testbench identify pairs.csv --out" in words  # the arm is known
    Path("hand.toml").write_text("")
    words = fine("data", "check", ARM, "pairs.csv", "--map", "hand.toml", "--frame", "base", "--out", "again")
    assert "testbench identify pairs.csv --map hand.toml --frame base --out" in words
    assert taken(Path("seen"))["taken"] == {"arm": ARM, "targets": ["P9"], "load": ["460"]}
    NAME.write_text(f'arm = "{ARM}"\nload = [240, 460]\n')
    assert "missing columns: mass_kg" in do("data", "check", "pairs.csv").stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("arm = ", "not TOML"),
        (
            'tracker = "1,2"',
            "tracker: expected a text of three numbers with commas between, such as 2.5,0,1, got '1,2'",
        ),
        ('tracer = "x"', "line 1, column 1, tracer: unknown key; keys are arm, urdf, map,"),
        (
            'arm = "nowhere"',
            "line 1, column 1, arm: expected the folder of an arm, or the name of one of ours, got 'nowhere'",
        ),
        ('map = "none.toml"', "line 1, column 1, map: expected a file that exists, got 'none.toml'"),
        (
            "sigma_um = 0",
            "line 1, column 1, sigma_um: expected at least 0.001, got 0",
        ),
        (
            '\nload = "12 stone"',
            "line 2, column 1, load.0: expected a mass such as 240, 240kg or 530lb; units are N",
        ),
        ("tracker = [1, 2]", "line 1, column 1, tracker: expected a text, got [1, 2]"),
        ('arm = "--help"', "arm: expected a text that does not begin with -, got '--help'"),
        ('[files."jun.csv"]\nload = 5', "files.jun.csv: expected a file that exists"),
        ('[files."may.csv"]\nmas = 5', "files.may.csv.mas: unknown key; keys are map, load, payload"),
        ('out = "elsewhere"', "out: unknown key"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(cell, text, said):
    NAME.write_text(text + "\n")
    assert refused("check", ARM, "--out", "seen", said=said, below=cell).startswith(f"error: {NAME}: ")


def test_every_command_reads_the_project_file_but_for_its_help(cell):
    NAME.write_text("arm = \n")
    for args in (("calibrate", ARM, "may.csv"), ("plan", ARM, "--absolute")):
        refused(*args, said=f"{NAME}: ", below=cell)
    fine("calibrate", "--help")


def test_words_that_are_no_arm_are_files_and_missing_ones_are_named(cell):
    NAME.write_text(f'arm = "{ARM}"\n')
    assert "error: typo.csv: cannot be read" in do("data", "check", "typo.csv").stderr
    assert "Missing argument 'dataset'" in do("data", "check", ARM).stderr
    assert (
        "no_arm: expected the folder of an arm, with rigid.xml"
        in do("data", "check", "no_arm", "may.csv").stderr
    )
    assert "Missing argument 'arm'" in (NAME.unlink() or do("check").stderr)


def test_new_writes_a_project_file_of_sound_examples_and_replaces_none(cell):
    heavy_urdf(cell)
    fine("new", "my_arm", "--from", "heavy.urdf", "--project")
    assert read_project() == Project(arm="my_arm", urdf="heavy.urdf")
    said = f"{NAME}: exists already; edit it, or leave out --project"
    refused("new", "other", "--from", "heavy.urdf", "--project", said=said, below=cell)
    text = NAME.read_text()
    assert all(f"{key} = " in text for key in Project.model_fields if key != "files")
    examples = text[: text.index("# [files")].splitlines(keepends=True)
    NAME.write_text("".join(line.removeprefix("# ") for line in examples if " = " in line))
    assert "map: expected a file that exists" in do("check").stderr  # all examples are sound
