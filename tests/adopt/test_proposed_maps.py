"""`data map` on exports of known readings: it says how well they fit the arm, and refuses a wrong guess."""

import re
from datetime import datetime, timedelta

import numpy as np
import pytest
from run_here import ROOT, do, fine, is_refused
from test_samples import ARM, brought

from testbench.errors import InputError
from testbench.files.propose_map import map_text, propose
from testbench.files.read_series import read_series

BEGAN = datetime(2026, 9, 14, 9, 1, 30)
STEP = timedelta(seconds=47)


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Three targets in 20 poses under own weight: as arrays."""
    file = tmp_path_factory.mktemp("known") / "known.csv"
    fine("simulate", ARM.name, "--poses", 20, "--absolute", "--tracker", "4,-2,1.5", "--out", file)
    [series] = read_series(file, ARM).series
    return series


def joined(rows, between=","):
    return "\n".join(between.join(map(str, row)) for row in rows) + "\n"


def points(known, columns=("Name", "X [mm]", "Y [mm]", "Z [mm]"), name=lambda k: f"R{k + 1:02}", targets=1):
    """Lines of a tracker's file: a row a point."""
    places = (1e3 * known.position[:, :targets]).round(4)
    rows = [[*name(k).split(","), *place] for k in range(known.n_rows) for place in places[k].tolist()]
    return [[*columns], *rows]


def robot(known, name=lambda k: f"R{k + 1:02}", key="Name"):
    """Lines of the robot's log, in degrees."""
    q = np.degrees(known.q).round(5).tolist()
    return [[key, *(f"A{n}" for n in range(1, 7))], *([name(k), *row] for k, row in enumerate(q))]


def beside(known, **say):
    """Lines of a file with the joints behind the points."""
    tracker, log = points(known, **say), robot(known)
    return [[*own, *other[1:]] for own, other in zip(tracker, log, strict=True)]


def written(folder, tracker, log=None):
    """An export, and the flags of its log."""
    (file := folder / "export.csv").write_text(joined(tracker))
    if log is None:
        return file, []
    (folder / "robot.csv").write_text(joined(log))
    return file, ["--log", folder / "robot.csv"]


def test_the_command_says_how_far_readings_are_from_the_nominal_arm(known, tmp_path):
    file, _ = written(tmp_path, beside(known))
    said = fine("data", "map", ARM.name, file)
    assert "20 readings" in said
    off = re.search(r"median distance of these readings from the nominal arm is ([0-9.]+) mm", said)
    assert 0.1 < float(off[1]) < 20  # what simulated arms are off by
    [series] = read_series(file, ARM, file.with_suffix(".toml")).series
    np.testing.assert_allclose(series.position, known.position[:, :1], rtol=0, atol=1e-7)


def test_the_uncertainties_of_a_tracker_are_two_standard_deviations(tmp_path):
    file = brought("leica_fr.csv", tmp_path)
    [series] = read_series(file, ARM, propose(file, ARM, None, tmp_path).map()).series
    assert series.sigma == pytest.approx(30e-6)


def centimetres(known):
    lines = beside(known, columns=("Name", *"XYZ"))
    return [lines[0], *([row[0], *(x / 10 for x in row[1:4]), *row[4:]] for row in lines[1:])]


def another_sign(known):
    lines = beside(known)
    return [lines[0], *([*row[:5], -row[5], *row[6:]] for row in lines[1:])]


def one_name_for_targets(known):
    log = robot(known)
    lines = points(known, targets=3)
    return [[*row, *log[(k + 2) // 3][1:]] for k, row in enumerate(lines)]


def slipped(known):
    """Rows of the log belong to the names before them, from the sixth on."""
    log = robot(known)
    own = [row[1:] for row in log]
    own[6:] = [own[-1], *own[6:-1]]
    return points(known), [[row[0], *angles] for row, angles in zip(log, own, strict=True)]


def another_clock(known):
    def at(k, late=0.0):
        return (BEGAN + k * STEP + timedelta(seconds=late)).isoformat()

    tracker = points(known, columns=("Time", "X [mm]", "Y [mm]", "Z [mm]"), name=at)
    return tracker, robot(known, lambda k: at(k, 3600.0), "timestamp")


def a_name_less(known):
    log = robot(known)
    log[3][0] = "R3x"
    return points(known), log


WRONG = {
    "10 times too small: centimetres read as millimetres?": centimetres,
    "expected shots of one point within 0.002 m": one_name_for_targets,
    "column A2: expected -130": another_sign,
    "the readings belong to the next pose": slipped,
    "one reading is 3600 s away; do the clocks agree?": another_clock,
    "line 4: no row of robot.csv is called 'R03'": a_name_less,
}


@pytest.mark.parametrize("said", WRONG)
def test_a_wrong_guess_is_not_silent(said, known, tmp_path):
    made = WRONG[said](known)
    file, flags = written(tmp_path, *made) if isinstance(made, tuple) else written(tmp_path, made)
    done = do("data", "map", ARM.name, file, *flags)
    is_refused(done, said)
    assert "median distance" not in done.stdout


def test_targets_side_by_side_are_read_as_by_the_map_that_was_written_by_hand(tmp_path):
    file = ROOT / "docs/maps/spreadsheet.csv"
    fine("data", "map", ARM.name, file, "--out", tmp_path / "map.toml")
    maps = (tmp_path / "map.toml", file.with_suffix(".toml"))
    [found], [expected] = (read_series(file, ARM, own).series for own in maps)
    for name in ("q", "wrench", "position", "is_measured"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    other = tmp_path / "other.csv"
    other.write_text(file.read_text("cp1252").replace("Ziel ", "Kugel_"), "cp1252")
    done = do("data", "map", ARM.name, other, "--out", tmp_path / "other.toml")
    is_refused(done, "no column looks like a position; ")
    assert '"{marker}_{when}_{axis}" = "{marker} {when} {axis}"' in done.stderr


def test_a_log_is_joined_or_refused_line_by_line(tmp_path):
    file, log = (brought(f"leica_de.{kind}", tmp_path) for kind in ("csv", "robot"))
    map_ = tmp_path / "map.toml"
    whole = map_text(propose(file, ARM, log, tmp_path).entries)
    for old, new, said in (
        (
            "within_s = 1.0",
            "within_s = 0.1",
            "line 2: expected a row of leica_de.robot within 0.1 s, the near",
        ),
        ('"leica_de.robot"', '"none.csv"', r"none.csv: cannot be read"),
        ('"Datum"', '"Tag"', r"no column 'Tag' to join by; columns are PunktNr, X"),
        ("[log]", "[log]\nby = 3", r"log.by: unknown key; keys are file, on, to, parts, within_s, rows"),
    ):
        map_.write_text(whole.replace(old, new))
        with pytest.raises(InputError, match=said):
            read_series(file, ARM, map_)
