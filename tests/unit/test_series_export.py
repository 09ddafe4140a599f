"""Absolute readings in every notation that laboratories publish, as text and in workbooks, with a map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refused import refused
from scipy.spatial.transform import Rotation
from workbooks import packed, parts

from testbench.arm.folder import load_arm
from testbench.data.dataset import Dataset, Series, series_from_runs
from testbench.errors import BenchError, InputError
from testbench.files.program import read_poses
from testbench.files.read_pairs import read_csv
from testbench.files.read_series import SeriesExport, read_series
from testbench.files.write import write_series
from testbench.runs.manifest import digest
from testbench.workflows.absolute import File, read_all

ROOT = Path(__file__).parents[2]
ARM = load_arm(ROOT / "models" / "arm_6r")
KR500 = load_arm(ROOT / "models" / "kr500_l480")
N = 7
RNG = np.random.default_rng(11)
Q = 0.9 * RNG.uniform(*ARM.limits, (N, 6))
P = RNG.uniform(-3, 3, (N, 3))
R = Rotation.random(N, random_state=3)
JOINTS = [f"joint_{k}_rad" for k in range(1, 7)]
XYZ = ["x_mm", "y_mm", "z_mm"]
SAME_PLACE = 1e-12  #: Rounding of a number written in full [m].


def read(folder: Path, columns: dict[str, list], toml: str = "", arm=ARM, name="one") -> SeriesExport:
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    (folder / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
    (folder / "map.toml").write_text(toml)
    return read_series(folder / f"{name}.csv", arm, folder / "map.toml" if toml else None)


def table(names: list[str], values) -> dict[str, list]:
    return dict(zip(names, np.asarray(values).T.tolist(), strict=True))


VECTOR = [f"rotation_{x}_rad" for x in "xyz"]
MATRICES = table([f"rotation_{i}{j}" for i in "123" for j in "123"], R.as_matrix().reshape(N, 9))
PLAIN = table(JOINTS, Q) | table(XYZ, 1e3 * P)


def check_alike(a: Series, b: Series, tolerance: float = 1e-9, other: tuple[str, ...] = ()) -> None:
    """Equal in all else that a file holds; matrices of rotation and precision relative to their size."""
    for name in a.__dataclass_fields__.keys() - {*other}:
        x, y = getattr(a, name), getattr(b, name)
        if name == "joint_columns":
            continue  # names of the file's columns
        if isinstance(x, np.ndarray):
            np.testing.assert_allclose(y, x, rtol=tolerance, atol=tolerance, err_msg=name)
        elif isinstance(x, float):
            assert y == pytest.approx(x, rel=1e-12), name
        else:
            assert x == y, name


NOTATIONS = {
    f"{kind} {axes}": axes for kind in ("intrinsic", "extrinsic") for axes in ("xyz", "zyx", "zyz", "xzy")
}


@pytest.mark.parametrize("notation", NOTATIONS)
def test_euler_angles_in_any_order_are_the_rotation_that_scipy_makes_of_them(tmp_path, notation):
    kind, axes = notation.split()
    angles = R.as_euler(axes.upper() if kind == "intrinsic" else axes, degrees=True)
    own = table(["first", "second", "third"], angles)
    toml = f'[series]\nrotation = "{notation}"\n[columns]\nrotation_1_deg = "first"\n'
    toml += 'rotation_2_deg = "second"\nrotation_3_deg = "third"\n'
    [s] = read(tmp_path, PLAIN | own, toml).series
    np.testing.assert_allclose(s.rotation, R.as_matrix(), atol=1e-12)
    if len(set(axes)) == 3:  # the same named by their axes
        named = dict(zip((f"r{x}" for x in axes), own.values(), strict=True))
        toml = f'[series]\nrotation = "{notation}"\n[columns]\n"rotation_{{axis}}_deg" = "r{{axis}}"\n'
        [s] = read(tmp_path, PLAIN | named, toml).series
        np.testing.assert_allclose(s.rotation, R.as_matrix(), atol=1e-12)


def test_quaternions_matrices_and_vectors_are_the_same_rotations(tmp_path):
    quat = R.as_quat().round(6)  # x, y, z, w, rounded as files have them
    for own in (table(["qx", "qy", "qz", "qw"], quat), MATRICES, table(VECTOR, R.as_rotvec())):
        [s] = read(tmp_path, PLAIN | own).series
        np.testing.assert_allclose(s.rotation, R.as_matrix(), atol=3e-6)
        square = s.rotation @ s.rotation.swapaxes(1, 2)
        np.testing.assert_allclose(square, np.tile(np.eye(3), (N, 1, 1)), atol=1e-12)


def full(**changes) -> Series:
    """A series with everything: two markers, one lost in a row, loads, torques, covariances."""
    A = RNG.normal(size=(N, 3, 3, 3))
    C = 1e-10 * (A @ A.swapaxes(2, 3) + np.eye(3))
    precision = np.linalg.inv(C)
    precision = (precision + precision.swapaxes(2, 3)) / 2
    precision[2, 1] = 0
    position = RNG.uniform(-3, 3, (N, 3, 3))
    position[2, 1] = 0
    wrench = RNG.normal(size=(N, 6))
    wrench[::2] = 0
    rotation = R.as_matrix()
    rotation[4] = np.nan
    every = Series(
        name="whole A",
        markers=KR500.markers,
        frame="cell",
        mount="mount",
        row_id=np.arange(N) * 3 + 5,
        pose_id=np.array([4, 4, 7, 8, 8, 9, 2]),
        q=0.9 * RNG.uniform(*KR500.limits, (N, 6)),
        wrench=wrench,
        point=RNG.normal(size=(N, 3)),
        position=position,
        sigma=31e-6,
        precision=precision,
        rotation=rotation,
        sigma_rotation=2e-4,
        torque=RNG.normal(size=(N, 6)),
        temperature=RNG.uniform(20, 25, N),
        time=np.arange(N) * 40.0,
    )
    return replace(every, **changes)


def test_what_we_write_is_read_back(tmp_path):
    """Two series that share a frame, one with deviations by axis, and the least there is."""
    path = tmp_path / "whole.csv"
    first, second = full(), full(name="whole B", mount="another", rotation=None, sigma_rotation=None)
    diagonal = RNG.uniform(1e8, 4e8, (N, 3, 3, 1)) * np.eye(3)
    diagonal[2, 1] = 0
    deviated = replace(first, precision=diagonal)
    for own in ((first, second), (deviated,)):
        write_series(path, KR500, own)
        by_axis = ",sigma_x_m,sigma_y_m,sigma_z_m" in path.read_text(encoding="utf-8")
        assert by_axis == (own[0] is deviated)
        for a, b in zip(own, read_series(path, KR500).series, strict=True):
            check_alike(a, b)
    one = read(tmp_path, PLAIN).series[0]
    write_series(tmp_path / "one.csv", ARM, one)
    assert "series" not in (tmp_path / "one.csv").read_text()
    check_alike(one, read_series(tmp_path / "one.csv", ARM).series[0])
    with pytest.raises(BenchError, match="markers"):
        write_series(path, ARM, replace(one, markers=("unknown",)))


HEAD_A = "Timestamp;Goal x;" + ";".join(f"{x}_joint" for x in ("shoulder_pan", "shoulder_lift", "elbow"))
HEAD_A += ";wrist_1_joint;wrist_2_joint;wrist_3_joint;measurement_temperature"
DEVIATED = ";".join(f"measurement_{x};measurement_std_{x}" for x in ("x", "y", "z", "rx", "ry", "rz"))
EXPORTS = {
    "A": f"""{HEAD_A};measurement_x;measurement_y;measurement_z;measurement_rx;measurement_ry;measurement_rz
20200714163904;0,365141;-1,5708;-1,5708;0,0;-1,5708;0,0;0,0;23,68;2361,9831;-1368,5474;119,39713;-90,5;-60;-91
20200714164037;0,8;-2,18771;-1,9683;-1,18616;0,01;0,79;-0,002;23,68;1689,1702;-1659,388;-515,2;-91;-69,7;-92
""",
    "C": f"""{HEAD_A};{DEVIATED}
2,02011E+13;0;-3,1;-1,5;0;-1,5;0;0;21,6;383,97123;0,04;-3240,7562;0;201,72621;0,005;-90;0,002;-20;0,006;-90;0,004
2,02011E+13;0;-3,0;-1,5;0;-1,5;0;0;21,6;383,97123;0,04;-3240,7562;0,02;201,72;0,005;-90;0,002;-20;0,006;-90;0,004
""",
}


def test_one_map_serves_readings_of_the_ur10_with_and_without_standard_deviations(tmp_path):
    arm = load_arm(ROOT / "models" / "ur10")
    found = {}
    for name, text in EXPORTS.items():
        (tmp_path / f"{name}.csv").write_text(text)
        found[name] = read_series(tmp_path / f"{name}.csv", arm, ROOT / "docs" / "maps" / "ur10.toml")
    [a], [c] = found["A"].series, found["C"].series
    angles = np.deg2rad([-90.5, -60, -91])
    turns = [Rotation.from_rotvec(x * e).as_matrix() for x, e in zip(angles, np.eye(3), strict=True)]
    np.testing.assert_allclose(a.rotation[0], turns[0] @ turns[1] @ turns[2], atol=1e-12)
    np.testing.assert_allclose(a.position[0, 0], [2.3619831, -1.3685474, 0.11939713], atol=SAME_PLACE)
    assert (a.sigma, a.precision, a.frame, a.mount) == (pytest.approx(30e-6), None, "A", "A")
    assert (a.time[1], c.time, *c.temperature) == (93, None, 21.6, 21.6)
    deviations = np.diagonal(c.precision[:, 0], axis1=1, axis2=2) ** -0.5
    np.testing.assert_allclose(deviations, [[40e-6, 1e-6, 5e-6], [40e-6, 20e-6, 5e-6]], rtol=1e-9)
    assert c.sigma_rotation == pytest.approx(np.deg2rad(0.004))
    for words in (
        "below 1 um",
        "expected times that differ",
        "only own weight",
    ):
        assert any(words in note for note in found["C"].notes)


@pytest.mark.parametrize("stamp", ["2,02011E+13", "2.02011E+13", "20201100000000", "2E+13"])
def test_a_time_that_a_spreadsheet_rounded_is_said_once_and_plainly(tmp_path, stamp):
    notes = read(tmp_path, PLAIN | {"Timestamp": [f'"{stamp}"'] * N}).notes
    [said] = [note for note in notes if stamp in note]
    assert said.startswith("Timestamp: expected times that differ, such as 20200714163904")
    assert said.endswith(f"got {stamp!r}; times are not read")


def test_masses_hang_and_torques_times_and_poses_stand_beside(tmp_path):
    own = table([f"A{k}" for k in range(1, 7)], np.rad2deg(Q))
    own |= table(["X [m]", "Y [m]", "Z [m]"], P) | {"load": [0, 1.25, 2.5, 0, 0, 1.25, ""]}
    own |= table([f"tau{k}" for k in range(6)], RNG.normal(size=(N, 6)))
    own |= {"when": [f"2026-09-14 09:0{k}:30" for k in range(N)], "temperature [°C]": ["n/a"] * N}
    toml = '[columns]\n"joint_{n}_deg" = "A{n}"\npayload_kg = "load"\n"torque_joint_{n0}_Nm" = "tau{n0}"\n'
    toml += 'time = "when"\n[series]\nframe = "cell"\ntarget = "mount"\n'
    export = read(tmp_path, own, toml)
    [s] = export.series
    np.testing.assert_allclose(s.q, Q, atol=1e-12)
    np.testing.assert_allclose(s.wrench[:, 2], -9.81 * np.array([0, 1.25, 2.5, 0, 0, 1.25, 0]))
    np.testing.assert_allclose(s.torque[:, 5], own["tau5"])
    np.testing.assert_allclose(s.time, 60.0 * np.arange(N))
    assert (s.frame, s.mount, s.temperature) == ("cell", "mount", None)
    assert any("temperature" in note for note in export.notes)


def test_a_station_has_a_frame_of_its_own_and_shares_the_mount(tmp_path):
    a, b = read(tmp_path, PLAIN | {"station": [1, 1, 1, 2, 2, 2, 2]}).series
    assert (a.n_rows, b.n_rows, a.frame, b.frame, a.mount, b.mount) == (3, 4, "one 1", "one 2", "one", "one")
    names = ["north", "north", "south", "south", "south", "north", "north"]
    a, b = read(tmp_path, PLAIN | {"series": names}, '[series]\nframe = "cell"\n').series
    assert (a.name, a.row_id.tolist(), b.frame) == ("one north", [2, 3, 7, 8], "cell south")
    both = table(JOINTS, Q[[0] * 4]) | table(XYZ, 1e3 * P[:4]) | {"marker": ["T1", "T1", "T2", "T2"]}
    a, b = read(tmp_path, both | {"series": [*"abba"]}, '[series]\nmarkers = ["T1", "T2"]\n').series
    np.testing.assert_allclose([a.position[0], b.position[0]], P[[[0, 3], [1, 2]]], atol=SAME_PLACE)


def test_several_targets_of_the_laboratorys_own_names_some_lost(tmp_path):
    """One is lost, and a row has none."""
    places = RNG.uniform(-3, 3, (N, 2, 3)).round(6)
    places[1, 0] = places[3] = np.nan
    blank = np.where(np.isnan(places), "", places.astype(object)).reshape(N, 6)
    names = [f"T{k} {x} [m]" for k in (1, 2) for x in "XYZ"]
    wide = read(tmp_path, table(JOINTS, Q) | table(names, blank), '[series]\nmarkers = ["T1", "T2"]\n')
    [one] = wide.series
    assert one.is_measured.tolist() == [[True, True], [False, True], *[[True, True]] * 4]
    expected = np.nan_to_num(np.delete(places, 3, axis=0))
    np.testing.assert_allclose(one.position, expected, atol=SAME_PLACE)
    np.testing.assert_allclose(one.precision[1], [np.zeros((3, 3)), np.eye(3) / one.sigma**2])
    assert "rows without a reading are left out: 1 (line 5)" in wide.notes


def test_pairs_as_readings_keep_their_orientations():
    """What a fit of both kinds sees of a pair is all that was read."""
    turns = np.random.default_rng(2).normal(size=(2, N, 3))
    still = {
        "run_id": np.arange(N),
        "pose_id": np.arange(N),
        "wrench": np.zeros((N, 6)),
        "point": np.zeros((N, 3)),
    }
    data = Dataset(
        markers=("P1",), q=Q, before=P[:, None], after=P[:, None] + 1e-3, sigma=1e-5, sigma_rotation=1e-4,
        rotation_before=turns[0], rotation_after=turns[1], **still,
    )  # fmt: skip
    [own] = series_from_runs(data, "pairs", "mount")
    assert own.sigma_rotation == 1e-4
    np.testing.assert_allclose(own.rotation, Rotation.from_rotvec(np.vstack(turns)).as_matrix())


def changed(column: str, value: object, row: int = 2) -> dict[str, list]:
    return PLAIN | {column: [value if k == row else x for k, x in enumerate((PLAIN | TURNED)[column])]}


TURNED = table(["qx", "qy", "qz", "qw"], R.as_quat())
ANGLES = table(["rx", "ry", "rz"], np.rad2deg(R.as_euler("xyz")))
DEVIATIONS = {f"sigma_{x}_mm": [0.02] * N for x in "xyz"}
NAMED = '[columns]\n"rotation_{axis}_deg" = "r{axis}"\n'
FAULTS = {
    "an axis is missing": ({k: v for k, v in PLAIN.items() if k != "z_mm"}, "", "missing columns: z_m"),
    "no reading": (PLAIN | {x: [""] * N for x in XYZ}, "", "expected at least one reading"),
    "no unit quaternion": (TURNED | changed("qw", 3), "", "line 4, column .*unit quaternion"),
    "part of a quaternion": (PLAIN | {k: TURNED[k] for k in ("qx", "qy", "qz")}, "", "columns: quaternion_w"),
    "angles without notation": (PLAIN | ANGLES, NAMED, 'series.rotation: expected "intrinsic xyz"'),
    "angles of no notation": (PLAIN | ANGLES, '[series]\nrotation = "XYZ"', 'rotation: expected "vector"'),
    "angles about one axis": (PLAIN | ANGLES, NAMED + '[series]\nrotation = "intrinsic xxy"', "no Euler"),
    "degrees as radians": (PLAIN | {name: [90] * N for name in VECTOR}, "", "line 2, .*are these degrees"),
    "two notations": (PLAIN | TURNED | {name: [1] * N for name in VECTOR}, "", "in one notation"),
    "no rotation": (
        PLAIN | {name: [-x for x in own] for name, own in MATRICES.items()}, "", "expected a rotation matrix"
    ),
    "negative deviation": (PLAIN | DEVIATIONS | {"sigma_y_mm": [-1] * N}, "", "line 2, column sigma_y_mm"),
    "deviations in another unit": (PLAIN | {f"sigma_{x}_m": [0.02] * N for x in "xyz"}, "", "another unit"),
    "sigma twice": (PLAIN | {"sigma_um": [30] * N}, "[values]\nsigma_um = 30", "sigma"),
    "loaded with nothing": (PLAIN | {"state": ["loaded"] * N}, "", "missing columns: mass_kg"),
    "a torque is missing": (PLAIN | {"torque_joint_1_Nm": [1] * N}, "", "missing columns: torque_joint_2_Nm"),
    "no column to scale": (PLAIN, "scale.sigma_um = 0.5", "scale.sigma_um: expected a key of columns or opt"),
    "unknown key": (PLAIN, '[series]\nmount = "a"', "series.mount: unknown key; keys are frame, target"),
    "a set-up without a name": (PLAIN | {"series": ["a"] * 6 + [""]}, "", "line 8, column series"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_that_says_where(tmp_path, fault):
    columns, toml, words = FAULTS[fault]
    with pytest.raises(InputError, match=words) as err:
        read(tmp_path, columns, toml)
    assert len(str(err.value).splitlines()) == 1


def test_several_places_in_one_pose_want_a_column_of_markers(tmp_path):
    own = table(JOINTS, np.repeat(Q[:1], N, axis=0)) | table(XYZ, 1e3 * P)
    with pytest.raises(InputError, match="line 3: expected a column 'marker'"):
        read(tmp_path, own, arm=KR500)
    [s] = read(tmp_path, own | {"joint_1_rad": Q[:, 0].tolist()}, arm=KR500).series
    assert s.markers == ("target",)


NUMBERS, NAMES = np.hstack([Q, 1e3 * P]), [*JOINTS, *XYZ]
ROWS = [NAMES, *NUMBERS.tolist()]


def one_of(path):
    (one,) = read_series(path, ARM).series
    return one


def spoilt(row: int, name: str, cell: str | float | None):
    """The table with another cell in a row, counted from 1 as the spreadsheet does."""
    rows = [list(own) for own in ROWS]
    rows[row - 1][NAMES.index(name)] = cell
    return rows


def write(folder: Path, hidden: tuple[str, ...] = (), **sheets) -> Path:
    file = folder / "one.xlsx"
    file.write_bytes(packed(parts(sheets, hidden)))
    return file


def csv(folder: Path, rows=ROWS, name: str = "one.csv") -> Path:
    file = folder / name
    file.write_text("\n".join(",".join(map(str, own)) for own in rows), encoding="utf-8")
    return file


def test_the_mark_of_a_sheet_in_the_name_of_any_other_file_is_part_of_it(tmp_path):
    check_alike(one_of(csv(tmp_path, name="one.csv#B")), one_of(csv(tmp_path)), 0, ("name", "frame", "mount"))


def test_the_sheet_is_the_one_behind_the_mark_else_the_first_that_is_seen(tmp_path):
    """As its CSV is read, bit by bit; also far to the right."""
    other = spoilt(4, "z_mm", 12.5)
    right = [[f"note {k}" if row is NAMES else None for k in range(26)] + row for row in ROWS]
    file = write(tmp_path, ("Draft",), Draft=[["x"]], A=right, B=other)
    first, second = one_of(file), one_of(tmp_path / "one.xlsx#B")
    check_alike(first, one_of(csv(tmp_path)), 0)
    check_alike(second, one_of(csv(tmp_path, other)), 0, ("name", "frame", "mount"))
    assert second.position[2, 0, 2] == 0.0125
    assert (first.name, second.name) == ("one", "one B")
    [note, *_] = read_series(tmp_path / "one.xlsx#B", ARM).columns.table.notes
    assert note.startswith("sheet B, header in row")
    assert digest(tmp_path / "one.xlsx#B") == digest(file)
    assert "expected one of its sheets, Draft, A, B, got 'C'" in refused(one_of, tmp_path / "one.xlsx#C")


def test_a_cell_far_from_the_table_is_refused_by_its_column_and_row(tmp_path):
    """Calamine would ask for 500 GB, and end the process."""
    file = write(tmp_path, A=ROWS)
    whole = parts({"A": ROWS})
    [sheet] = [name for name in whole if name.startswith("xl/worksheets/")]
    far = '<row r="1048576"><c r="XFD1048576"><v>1</v></c></row></sheetData>'
    file.write_bytes(packed(whole | {sheet: whole[sheet].replace("</sheetData>", far)}))
    assert "its cells reach from A1 to column XFD and row 1048576, more than 20000000" in refused(
        one_of, file
    )


def test_two_sheets_are_two_series_and_one_sheet_twice_is_refused(tmp_path):
    other = [NAMES, *(NUMBERS[:, [0, 1, 2, 3, 4, 5, 7, 6, 8]] + 0.01).tolist()]
    write(tmp_path, A=ROWS, B=other)
    a, b = tmp_path / "one.xlsx#A", tmp_path / "one.xlsx#B"
    series, _ = read_all([File(a), File(b)], ARM)
    assert [one.name for one in series] == ["one A", "one B"]
    with pytest.raises(InputError, match="called one A was read already"):
        read_all([File(a), File(a)], ARM)


def test_rows_of_a_title_of_units_and_blank_cells_are_as_in_a_text(tmp_path):
    lost = [*NUMBERS[0, :6].tolist(), None, None, None]
    units = [*["rad"] * 6, *["mm"] * 3]
    plain = [name.rpartition("_")[0] for name in NAMES]
    rows = [['Report, of 3 "November"\nA & B < C'], [], plain, units, *NUMBERS.tolist(), lost]
    (tmp_path / "map.toml").write_text('words.lost = ""')
    found = read_series(write(tmp_path, A=rows), ARM, tmp_path / "map.toml")
    (one,) = found.series
    assert one.row_id.tolist() == list(range(5, 5 + N))  # as the spreadsheet numbers them
    assert f"rows without a reading are left out: 1 (line {5 + N})" in found.notes
    assert np.array_equal(one.position, one_of(csv(tmp_path)).position)


@pytest.mark.parametrize(
    ("cell", "found"),
    [
        ('<c s="2"><v>12.5</v></c>', 0.0125),
        ("<c><f>A1*2</f><v>-3.0</v></c>", -0.003),
        ('<c t="str"><v>1e2</v></c>', 0.1),
        ('<c t="inlineStr"><is><r><t>1</t></r><r><t>2.5</t></r></is></c>', 0.0125),
        ('<c s="3"><v>43862</v></c>', "got '2020-02-01 00:00:00'"),
        ('<c s="1"><v>43862.5</v></c>', "got '2020-02-01 12:00:00'"),
        ('<c t="b"><v>1</v></c>', "got 'TRUE'"),
        ('<c t="inlineStr"><is><t>12 mm</t></is></c>', "got '12 mm'"),
    ],
)
def test_a_number_is_what_the_file_holds_and_what_is_none_is_refused_by_row_and_column(tmp_path, cell, found):
    """A date is what spreadsheets make of 1.2: its number, 43862, would be a reading 44 m away."""
    file = write(tmp_path, A=spoilt(6, "y_mm", cell))
    if isinstance(found, str):
        line = refused(one_of, file)
        assert "sheet A, row 6, column y_mm" in line
        assert found in line
    else:
        assert one_of(file).position[4, 0, 1] == found


def test_a_map_of_the_same_export_as_text_serves(tmp_path):
    """Its decimal mark and delimiter are those of the text; a workbook's numbers have none."""
    (tmp_path / "map.toml").write_text('[file]\ndelimiter = ";"\ndecimal = ","\nencoding = "cp1252"\n')
    rows = spoilt(3, "x_mm", "1.234,5")
    (one,) = read_series(write(tmp_path, A=rows), ARM, tmp_path / "map.toml").series
    assert one.position[1, 0, 0] == pytest.approx(1.2345, rel=1e-15)
    assert np.array_equal(one.q, NUMBERS[:, :6])


def test_poses_and_pairs_come_from_sheets_too(tmp_path):
    file = write(tmp_path, A=[row[:6] for row in ROWS])
    assert np.array_equal(read_poses(file, ARM), NUMBERS[:, :6])
    marker = ARM.markers[0]
    names = [*NAMES[:6], "mass_kg", "marker", *(f"{w}_{a}_mm" for w in ("before", "after") for a in "xyz")]
    own = [[*q[:6], 10, marker, *q[6:], *(x + 0.5 for x in q[6:])] for q in NUMBERS.tolist()]
    data = read_csv(write(tmp_path, A=[names, *own]), ARM)
    assert data.deflection[:, 0] == pytest.approx(5e-4)
    assert data.n_runs == N


def ods(rows) -> bytes:
    """The same table as LibreOffice writes it: numbers as values, a gap as repeated cells."""
    value = '<table:table-cell office:value-type="float" office:value="{0!r}"><text:p>{0:.2f}</text:p>'
    text = '<table:table-cell office:value-type="string"><text:p>{}</text:p>'
    blank = '<table:table-cell table:number-columns-repeated="2"/>'
    lines = "".join(
        f"<table:table-row>{blank}"
        + "".join((text if isinstance(x, str) else value).format(x) + "</table:table-cell>" for x in row)
        + "</table:table-row>"
        for row in rows
    )
    names = " ".join(
        f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"'
        for name in "office table text".split()
    )
    body = f'<office:body><office:spreadsheet><table:table table:name="Sonntag">{lines}</table:table>'
    content = f"<office:document-content {names}>{body}</office:spreadsheet></office:body>"
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    content += "</office:document-content>"
    return packed({"mimetype": kind, "META-INF/manifest.xml": "<manifest/>", "content.xml": content})


@pytest.mark.parametrize("ending", ["ods", "xls"])
def test_sheets_of_other_spreadsheets_are_read_bit_by_bit(tmp_path, ending):
    """readings.xls is ROWS as xlwt 1.3 wrote it, with a hidden sheet before."""
    old = Path(__file__).with_name("readings.xls")
    file = tmp_path / f"one.{ending}"
    file.write_bytes(ods(ROWS) if ending == "ods" else old.read_bytes())
    check_alike(one_of(file), one_of(csv(tmp_path)), 0)
    sheet = f"{file}#{'Sonntag' if ending == 'ods' else 'Messung'}"
    check_alike(one_of(sheet), one_of(file), 0, ("name", "frame", "mount"))
    assert "expected one of its sheets, " in refused(one_of, Path(f"{file}#none"))


@pytest.mark.parametrize("spoilt", [None, '<c t="e"><v>#N/A</v></c>', "<c><f>A1+1</f></c>"])
@pytest.mark.parametrize("lost", ["", 'lost = "---"', 'lost = ""'])
def test_a_blank_an_error_and_an_uncomputed_formula_are_lost_targets_only_where_the_map_says_so(
    tmp_path, spoilt, lost
):
    """Calamine tells the three from each other by nothing."""
    rows = [list(own) for own in ROWS]
    rows[4][6:] = [spoilt] * 3
    (tmp_path / "map.toml").write_text(f"[words]\n{lost}\n")
    asked = write(tmp_path, A=rows), ARM, tmp_path / "map.toml"
    if lost == 'lost = ""':
        found = read_series(*asked)
        assert "rows without a reading are left out: 1 (line 5)" in found.notes
        assert found.series[0].n_rows == N - 1
        return
    said = refused(read_series, *asked)
    assert "one.xlsx: sheet A, row 5, column x_mm: expected a number, got a blank cell, an error or a" in said
    assert '[words] lost = ""' in said


def test_a_blank_mass_of_a_workbook_is_none_only_where_a_column_says_the_state(tmp_path):
    """Beside loads it may be a formula without a result."""
    masses = ["mass_kg", 10, "<c><f>A1+1</f></c>", 0, 10, 0, 10, 0]
    rows = [[*own, m] for own, m in zip(ROWS, masses, strict=True)]
    said = refused(one_of, write(tmp_path, A=rows))
    assert "row 3, column mass_kg: expected a finite number in a loaded row, got ''; write 0 if" in said
    states = ["state", *("loaded" if m == 10 else "unloaded" for m in masses[1:])]
    one = one_of(write(tmp_path, A=[[*own, s] for own, s in zip(rows, states, strict=True)]))
    assert one.wrench[:, 2].tolist() == [-9.81 * m if m == 10 else 0 for m in masses[1:]]


def test_any_cut_of_a_workbook_and_one_that_unpacks_to_too_much_are_refused_in_one_line(
    tmp_path, monkeypatch
):
    whole, file = write(tmp_path, A=ROWS).read_bytes(), tmp_path / "cut.xlsx"
    for size in range(4, len(whole), 211):
        file.write_bytes(whole[:size])
        assert "expected a workbook" in refused(one_of, file)
    for name in ("xl/workbook.xml", "xl/worksheets/sheet1.xml"):
        made = parts({"A": ROWS})
        del made[name]
        file.write_bytes(packed(made))
        assert "expected a workbook" in refused(one_of, file)
    monkeypatch.setattr("testbench.files.text.MAX_UNPACKED", 2000)
    file.write_bytes(whole)
    assert "expected a workbook: at most 2000 bytes when unpacked" in refused(one_of, file)
