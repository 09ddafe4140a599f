"""A dataset's file gives back every bit, or is refused in one line: which line, what was expected."""

import csv
import io
import itertools
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from refused import refused
from scipy.spatial.transform import Rotation

from testbench.arm.folder import Arm, load_arm
from testbench.data.dataset import Dataset, select_runs, series_from_runs, split_by_pose
from testbench.errors import BenchError, InputError
from testbench.files.read_pairs import read_csv
from testbench.files.table import read_table
from testbench.files.write import write_csv
from testbench.plant.tracker import LaserTracker, deflection_precision

MODELS = Path(__file__).parents[2] / "models"
ARM = load_arm(MODELS / "kr500_l480")
JOINTS = tuple(j.name for j in ARM.joints)
Rows = list[list[str]]
ALL, SECOND, THIRD = range(2, 14), range(5, 8), range(8, 11)  #: Lines of all runs, of one.


def dataset(*, rotation: bool = False, arm: Arm = ARM, poses: tuple[int, ...] = (7, 7, 9, 4)) -> Dataset:
    """Runs in these poses, with readings like those of a heavy arm."""
    rng = np.random.default_rng(1)
    runs, m = len(poses), len(arm.markers)
    q = {pose: rng.uniform(*arm.limits) for pose in dict.fromkeys(poses)}
    before = rng.uniform(-3, 3, (runs, m, 3))
    turned = rng.uniform(-1, 1, (runs, 3)) if rotation else None
    return Dataset(
        markers=arm.markers,
        run_id=np.arange(runs) + 11,
        pose_id=np.array(poses),
        q=np.array([q[pose] for pose in poses]),
        wrench=rng.uniform(-5e3, 5e3, (runs, 6)),
        point=rng.uniform(-0.5, 0.5, (runs, 3)),
        before=before,
        after=before + 1e-3 * rng.standard_normal((runs, m, 3)),
        sigma=3e-5,
        rotation_before=turned,
        rotation_after=None if turned is None else turned + 1e-3 * rng.standard_normal((runs, 3)),
        sigma_rotation=2e-5 if rotation else None,
    )


def precise() -> Dataset:
    """Runs read by a laser tracker, one target lost."""
    data = dataset()
    P = np.array(deflection_precision(LaserTracker((2.0, -4.0, 1.5)), data.before, data.after))
    P[1, 2] = 0
    return replace(data, precision=P)


def written(tmp_path, data: Dataset) -> Path:
    write_csv(data, JOINTS, tmp_path / "dataset.csv")
    return tmp_path / "dataset.csv"


def change(file: Path, edit: Callable[[Rows], Rows]) -> None:
    rows = list(csv.reader(io.StringIO(file.read_text())))
    changed = edit([list(row) for row in rows])
    assert changed != rows
    with file.open("w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(changed)


def put(column: str, *values: str, lines: Iterable[int] = ALL) -> Callable[[Rows], Rows]:
    """Other values in some lines, counted from 1, the header: one after another, again and again."""

    def edit(rows: Rows) -> Rows:
        for line, value in zip(lines, itertools.cycle(values)):
            rows[line - 1][rows[0].index(column)] = value
        return rows

    return edit


def without_column(column: str) -> Callable[[Rows], Rows]:
    def edit(rows: Rows) -> Rows:
        k = rows[0].index(column)
        return [row[:k] + row[k + 1 :] for row in rows]

    return edit


def loading(line: int, word: str) -> Callable[[Rows], Rows]:
    """A column more, on in all lines but one."""
    words = {0: "loading", line - 1: word}
    return lambda rows: [[*row, words.get(k, "on")] for k, row in enumerate(rows)]


# What is written; tests/property reads any of it back

ROTATION = """,rotation_before_x_rad,rotation_before_y_rad,rotation_before_z_rad,rotation_after_x_rad,
rotation_after_y_rad,rotation_after_z_rad,sigma_rad""".replace("\n", "")


@pytest.mark.parametrize("rotation", [False, True])
def test_header_is_the_documented_one_and_a_row_is_a_marker_of_a_run(tmp_path, rotation):
    lines = written(tmp_path, dataset(rotation=rotation)).read_text().splitlines()
    documented = (MODELS.parent / "docs" / "example_dataset.csv").read_text().splitlines()[0]
    assert lines[0] == documented + ROTATION * rotation
    assert len(lines) == 1 + 4 * 3
    assert [line.split(",")[:3] for line in lines[1:4]] == [["11", "7", f"P{k}"] for k in (1, 2, 3)]


# Covariances and lost targets

COVARIANCES = [f"deflection_cov_{ab}_m2" for ab in ("xx", "xy", "xz", "yy", "yz", "zz")]


def test_covariances_and_lost_targets_are_read_back(tmp_path):
    data = precise()
    file = written(tmp_path, data)
    back = read_csv(file, ARM)
    np.testing.assert_allclose(back.precision, data.precision, rtol=1e-9, atol=1e-3)
    np.testing.assert_array_equal(back.is_measured, data.is_measured)
    np.testing.assert_array_equal(back.after[data.is_measured], data.after[data.is_measured])
    assert not back.deflection[1, 2].any()
    lost = file.read_text().splitlines()[1 + 3 + 2]
    assert lost.split(",")[-6:] == [""] * 6
    assert lost.count(",,") >= 4


def test_a_deflection_varies_as_its_two_readings_together():
    data = dataset()
    alike = 2 * data.sigma**2 * np.eye(3)
    np.testing.assert_allclose(data.covariance, np.broadcast_to(alike, data.covariance.shape), rtol=1e-12)
    own = precise()
    [readings] = series_from_runs(own, "readings", "tool")
    np.testing.assert_allclose(readings.precision, np.tile(2 * own.precision, (2, 1, 1, 1)), rtol=1e-12)


def test_what_cannot_be_written_leaves_no_file(tmp_path):
    (tmp_path / "file").touch()
    for place, joints, said in (
        (tmp_path / "file" / "dataset.csv", JOINTS, "cannot be written: "),
        (tmp_path, JOINTS, "cannot be written: Is a directory"),
        (tmp_path / "dataset.csv", JOINTS[:1], r"joints: expected 6 names, got joint_1_rad"),
    ):
        with pytest.raises(BenchError, match=said):
            write_csv(dataset(), joints, place)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "cannot be read: No such file or directory"),
        (b"\xff\xfe1\x002\x00", "line 1: no column name is known: expected joint_1_deg"),
        (b"\xff\xfe1\x002", "byte 5: expected text in utf-16-le: truncated data"),
        (b"run,pose\n1,\x81\n", "byte 12: expected text in utf-8 or cp1252"),
        (b'run,pose\n"1,2\n', "line 2: not a table: a quote is never closed"),
        (b'run,pose\n"1,2"\n', "line 2: expected 2 fields, got 1"),
        (b"run," + b"x" * 200_000, "line 1: expected a header of at most 20000 letters, got 200004"),
        (b"\0" * 10, "line 1: expected text, got a zero byte"),
        (b"run;pose;marker\n1;2;P1\n", "missing columns: joint_1_rad, "),
    ],
)
def test_file_that_is_no_dataset_is_refused(tmp_path, content, expected):
    file = tmp_path / "dataset.csv"
    if content is not None:
        file.write_bytes(content)
    assert expected in refused(read_csv, file, ARM)


# The forms of a text table


def quoted(text: str) -> bytes:
    return text.replace(",P2,", ', "P2",').replace(",P3,", ',"P3\n",').encode() + b'""\n\r\n'


def remarks(text: str) -> bytes:
    head, *rows = text.splitlines()
    more = [f'{head},x ("),y ("),"a, b"', *(f'{row},é,5,"1"", 2"' for row in rows)]
    return "\n".join(more).encode("cp1252")


FORMS: dict[str, Callable[[str], bytes]] = {
    "windows": lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"),
    "utf_16": lambda text: text.replace("\n", "\r").encode("utf-16"),
    "decimal_comma": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabs_and_no_end": lambda text: text.replace(",", "\t").rstrip("\n").encode(),
    "bars": lambda text: text.replace(",", "|").encode(),
    "title": lambda text: f"Report; of a day\n\n\n{text}".encode(),
    "comments_and_blank_lines": lambda text: text.replace("\n12,", "\n\n# a remark\n,,,\n12,").encode(),
    "header_again": lambda text: text.replace("\n13,", f"\n{text[: text.index(chr(10))]}\n13,", 1).encode(),
    "blanks_and_signs": lambda text: text.replace(",P3,", ", P3 ,").replace(",0.", ",+0.").encode(),
    "ragged": lambda text: text.replace(",3e-05\n", ",3e-05,, ,\n", 5).encode(),
    "quotes": quoted,
    "remarks": remarks,
}


@pytest.mark.parametrize("form", FORMS)
def test_a_table_is_read_bit_by_bit_however_it_is_written(tmp_path, form):
    data, file = dataset(), tmp_path / "dataset.csv"
    file.write_bytes(FORMS[form](written(tmp_path, data).read_text(encoding="utf-8")))
    back = read_csv(file, ARM)
    for field in fields(Dataset):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(data, field.name), field.name)


def test_numbers_are_those_of_python_to_the_last_bit_and_of_ascii_decimals_alone(tmp_path):
    rng, file = np.random.default_rng(1), tmp_path / "numbers.txt"
    bits = rng.integers(0, 2**63, 3000).view(float)
    texts = [f"{x:.{k % 20}e}" for k, x in enumerate(bits.tolist()) if np.isfinite(x)]
    texts += ["+1.5", "-.5", "7.", "007", "0.1e+2", "1E3", "5e-324", "9" * 300, "0." + "0" * 300 + "1" * 90]
    file.write_text("\n".join(["x_m", *texts]))
    found = read_table(file, lambda name: name == "x_m").numbers(0)
    assert found.tobytes() == np.array([float(text) for text in texts]).tobytes()
    for none in (*"0x10 1_0 nan -inf infinity 1e999 1,5 １ 1d3 --1 e5 .".split(), "1 2"):
        file.write_text(f"x_m;y\n1.5;2\n{none};2\n")
        table = read_table(file, lambda name: name == "x_m")
        with pytest.raises(InputError, match="line 3, column x_m: expected a finite number, got"):
            table.numbers(0)


# The header, then the rows, then runs and markers

SAME = "expected the same value in every row of the run"
EACH = "expected one line for each of P1, P2, P3"
LIMITS = "line 5, column joint_2_rad: expected -2.2689 to 0.3491 rad, got"
SIGMAS, FINITE = ("sigma_m", "sigma_rad"), "expected a finite number, got"
NUMBERS, TEXTS = ("nan", ""), ("1.0", "9223372036854775808")
LOADING = (5, "up", "expected on or off, got 'up'"), (7, "off", SAME)
PLAIN: list[tuple[Callable[[Rows], Rows], str]] = [
    (lambda rows: rows[:1], "line 2: expected at least one row"),
    (without_column("force_z_N"), "line 1: missing columns: force_z_N\n"),
    (
        put("force_z_N", "force_z_kg", lines=[1]),
        "line 1: missing columns: force_z_N; not understood: force_z_kg; understood: run, ",
    ),
    (
        lambda rows: [[*row, row[3]] for row in rows],
        "line 1: expected one column for each quantity, got 'joint_1_rad' and 'joint_1_rad' for the same",
    ),
    (
        lambda rows: [*rows[:5], ["1"], *rows[5:]],
        "line 6: expected 25 fields, got 1; for a line after the table",
    ),
    *((put("after_y_m", x, lines=[5]), f"line 5, column after_y_m: {FINITE} {x!r}") for x in NUMBERS),
    *(
        (put(column, x, lines=[5]), f"line 5, column {column}: expected an integer of 64 bits, got {x!r}")
        for column in ("run", "pose")
        for x in TEXTS
    ),
    (put("joint_2_rad", "-90.0", lines=SECOND), f"{LIMITS} -90; are these degrees?"),
    (put("joint_2_rad", "0.5", lines=SECOND), f"{LIMITS} 0.5\n"),
    *(
        (put(column, "0.125", lines=[7]), f"line 7, column {column}: {SAME}")  # third row of the second run
        for column in ("joint_3_rad", "force_z_N", "moment_x_Nm", "point_y_m")
    ),
    (
        put("marker", "P4", lines=[5]),
        "line 5, column marker: no marker 'P4' in kr500_l480; markers are P1, P",
    ),
    (lambda rows: rows[:5] + rows[6:], f"line 5: run 12: {EACH}"),  # P2 of the second run
    (put("marker", "P1", lines=[6]), "line 6: run 12 is in the file twice"),
    (put("run", "99", lines=[6]), f"line 5: run 12: {EACH}"),
    (put("pose", "99", lines=[6]), f"line 6, column pose: {SAME}"),
    (lambda rows: rows + rows[4:7], "line 14: run 12 is in the file twice"),
    *((loading(line, word), f"line {line}, column loading: {said}") for line, word, said in LOADING),
]
TURNED = [
    *(
        (without_column(column), f"missing columns: {column}")
        for column in ("sigma_rad", "rotation_before_x_rad", "rotation_after_z_rad")
    ),
    (put("rotation_after_y_rad", "0.5", lines=[3]), "line 3, column rotation_after_y_rad: expected the same"),
    *((put(s, "1e-3", lines=THIRD), f"line 8, column {s}: expected one value in the whole") for s in SIGMAS),
    *((put(s, "0.0"), f"line 2, column {s}: expected 1e-09 to 0.01, got 0") for s in SIGMAS),
    *((put(s, "-3e-05"), f"line 2, column {s}: expected 1e-09 to 0.01, got -3e-05") for s in SIGMAS),
]
PRECISE = [
    (put(COVARIANCES[0], "-1e-9", lines=[2]), "line 2: expected a positive definite covariance"),
    (put(COVARIANCES[0], "nan", lines=[2]), f"line 2, column {COVARIANCES[0]}: expected a finite number"),
    (put(COVARIANCES[5], "", lines=[2]), f"line 2, column {COVARIANCES[5]}: expected a finite number"),
    (put("before_x_m", "", lines=[2]), "line 2, column before_x_m: expected a finite number"),
    (
        put(COVARIANCES[3], "some", lines=[1]),
        f"line 1: missing columns: {COVARIANCES[3]}; not understood: ",
    ),
]
CASES = [(dataset(), *case) for case in PLAIN] + [(dataset(rotation=True), *case) for case in TURNED]
CASES += [(precise(), *case) for case in PRECISE]


@pytest.mark.parametrize(("data", "edit", "said"), CASES, ids=[said for *_, said in CASES])
def test_what_is_wrong_is_named_by_line_and_column(tmp_path, data, edit, said):
    """A line break stands for the end of what is said."""
    file = written(tmp_path, data)
    change(file, edit)
    assert said in f"{refused(read_csv, file, ARM)}\n"


OTHERS = "all rows are within the limits with the other sign (name it '-joint_2_rad' in [columns] of a map)"


@pytest.mark.parametrize(
    ("second", "third", "said"),
    [
        (("1.2",), "-1.0", f"got 1.2; {OTHERS}, or with 'joint_2_rad' and 'joint_3_rad' exchanged"),
        (("1.2",), "0.7", f"got 1.2; {OTHERS}"),
        (("1.2", "-2.3"), "0.7", "got 1.2"),
    ],
)
def test_joints_of_the_other_sign_or_exchanged_are_told_where_all_rows_fit_so(tmp_path, second, third, said):
    """Columns 1, 4, 5 and 6 go to both sides: only 3 may be 2."""
    file = written(tmp_path, dataset())
    for n in (1, 4, 5, 6):
        change(file, put(f"joint_{n}_rad", "1.5", "-1.5"))
    change(file, put("joint_2_rad", *second))
    change(file, put("joint_3_rad", third))
    assert refused(read_csv, file, ARM).endswith(said)


def test_a_joint_that_rounding_takes_beyond_its_limit_is_read_at_the_limit(tmp_path):
    """Plans put joints at their limits; exports round to a hundredth of a degree: 0.005 deg is 87 urad."""
    file = written(tmp_path, dataset())
    end = ARM.joints[1].upper
    change(file, put("joint_2_rad", f"{end + 8.7e-5}"))
    np.testing.assert_array_equal(read_csv(file, ARM).q[:, 1], end)
    change(file, put("joint_2_rad", f"{end + 2e-4}"))
    assert "line 2, column joint_2_rad: expected " in refused(read_csv, file, ARM)


# The dataset in memory


def test_counts_deflection_and_rotation_follow_from_the_readings():
    data = dataset(rotation=True)
    assert (data.n_runs, data.n_points) == (4, 12)
    np.testing.assert_array_equal(data.deflection, data.after - data.before)
    assert data.rotation_before is not None
    turn = Rotation.from_rotvec(data.rotation) * Rotation.from_rotvec(data.rotation_before)
    error = (turn * Rotation.from_rotvec(data.rotation_after).inv()).magnitude()
    np.testing.assert_allclose(error, 0, atol=1e-14)  # rounding


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ({"run_id": np.array([1, 2, 3])}, r"pose_id: expected 3 integers, got int64 \(4,\)"),
        ({"run_id": np.ones(4)}, r"run_id: expected 4 integers, got float64 \(4,\)"),
        ({"markers": ()}, r"markers: expected different names, got none"),
        ({"markers": ("P1", "P1", "P3")}, "markers: expected different names, got"),
        ({"markers": ("P1", "P2")}, r"before \[m\]: expected shape \(4, 2, 3\), got \(4, 3, 3\)"),
        ({"q": np.zeros(4)}, r"q \[rad, m\]: expected shape \(4, any\), got \(4,\)"),
        ({"q": np.full((4, 6), np.nan)}, r"q \[rad, m\]: expected finite numbers"),
        ({"sigma": 0.0}, r"sigma \[m\]: expected a number above 0 and below 1, got 0.0"),
        ({"sigma": np.nan}, r"sigma \[m\]: expected a number above 0 and below 1, got nan"),
        ({"sigma_rotation": None}, "orientations: expected before, after and sigma together, or none"),
        ({"rotation_after": np.zeros((4, 3, 3))}, r"rotation_after \[rad\]: expected shape \(4, 3\)"),
        (
            {"unloaded_after_load": np.zeros(3, bool)},
            r"unloaded_after_load: expected shape \(4\), got \(3,\)",
        ),
        ({"station": np.zeros(3, int)}, r"station: expected 4 integers, got int64 \(3,\)"),
        ({"sigma_rotation": 0.0}, r"sigma_rotation \[rad\]: expected a number above 0 and below 1, got 0.0"),
        ({"precision": np.zeros((4, 3, 3))}, r"precision \[1/m\^2\]: expected shape \(4, 3, 3, 3\)"),
    ],
)
def test_wrong_array_is_refused_at_the_door(wrong, expected):
    with pytest.raises(BenchError, match=expected):
        replace(dataset(rotation=True), **wrong)


def test_a_load_taken_off_belongs_to_the_unloaded_reading_of_its_own_run(tmp_path):
    """A row a run and state; the one before the load, which others of the pose may use, is not it."""
    head = ["run", "state", "loading", "mass_kg", *(f"{name}_rad" for name in JOINTS)]
    head += [f"P1_{axis}_m" for axis in "xyz"]
    joints, rows = ["0.1"] * 6, [(1, "unloaded", "", 1), (1, "loaded", "On", 2), (2, "loaded", "off", 3)]
    rows.append((2, "unloaded", "off", 4))
    lines = [[run, when, way, 100, *joints, x, 0, 1] for run, when, way, x in rows]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(",".join(map(str, line)) for line in [head, *lines]))
    found = read_csv(file, ARM)
    assert found.before[:, 0, 0].tolist() == [1, 4]
    assert found.unloaded_after_load is not None
    assert found.unloaded_after_load.tolist() == [False, True]
    for wrong, said in (
        (lines[:3], "line 4: loading off: expected an unloaded reading of the same run"),
        ([*lines, lines[1]], "line 6: this marker was read before in the same run"),
    ):
        file.write_text("\n".join(",".join(map(str, line)) for line in [head, *wrong]))
        assert said in refused(read_csv, file, ARM)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        (
            lambda data: split_by_pose(data, np.array([7, 5])),
            r"no pose 5 in the dataset; poses are 4, 7, 9",
        ),
        (
            lambda data: split_by_pose(data, np.array([4, 7, 9])),
            "expected runs in these poses and in others, got 4 of 4",
        ),
        (
            lambda data: split_by_pose(data, np.array([], int)),
            "expected runs in these poses and in others, got 0 of 4",
        ),
        (
            lambda data: select_runs(data, np.ones(3, bool)),
            r"select: expected a mask of 4 runs, got shape \(3,\)",
        ),
        (lambda data: data.rotation, "expected orientations, it has positions only"),
    ],
)
def test_a_part_that_is_none_is_refused(part, said):
    with pytest.raises(BenchError, match=said):
        part(dataset())
