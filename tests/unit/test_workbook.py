"""A sheet of a workbook says what the same table says as CSV; what a spreadsheet spoils is refused by row."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from refused import refused
from workbooks import packed, parts

from testbench.arm.folder import load_arm
from testbench.campaign.absolute import File, read_all
from testbench.data.program import read_poses
from testbench.data.read_pairs import read_csv
from testbench.data.read_series import read_series
from testbench.data.series import Series
from testbench.errors import InputError
from testbench.files import digest

MODELS = Path(__file__).parents[2] / "models"
ARM = load_arm(MODELS / "arm_6r")
RNG = np.random.default_rng(5)
N = 9
NUMBERS = np.hstack([0.9 * RNG.uniform(*ARM.limits, (N, 6)), 1e3 * RNG.uniform(-3, 3, (N, 3))])
NAMES = [*(f"joint_{k}_rad" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
ROWS = [NAMES, *NUMBERS.tolist()]
Rows = list[list[str | float | None]]


def spoilt(row: int, name: str, cell: str | float | None) -> Rows:
    """The table with another cell in a row, counted from 1 as the spreadsheet does."""
    rows: Rows = [list(own) for own in ROWS]
    rows[row - 1][NAMES.index(name)] = cell
    return rows


def write(folder: Path, hidden: tuple[str, ...] = (), **sheets: Rows) -> Path:
    file = folder / "one.xlsx"
    file.write_bytes(packed(parts(sheets, hidden)))
    return file


def csv(folder: Path, rows: Rows = ROWS, name: str = "one.csv") -> Path:
    file = folder / name
    file.write_text("\n".join(",".join(map(str, own)) for own in rows), encoding="utf-8")
    return file


def read(path: Path) -> Series:
    (one,) = read_series(path, ARM).series
    return one


def check_same(a: Series, b: Series, *other: str) -> None:
    for own in (f.name for f in fields(Series) if f.name not in other):
        x, y = getattr(a, own), getattr(b, own)
        assert np.array_equal(x, y) if isinstance(x, np.ndarray) else x == y, own


def test_a_sheet_reads_as_its_csv_does_bit_by_bit(tmp_path):
    """Also far to the right; a mark in the name of any other file is part of it."""
    plain = read(csv(tmp_path))
    right = [[f"note {k}" if row is NAMES else None for k in range(26)] + row for row in ROWS]
    for rows in (ROWS, right):
        check_same(read(write(tmp_path, A=rows)), plain)
    check_same(read(csv(tmp_path, name="one.csv#B")), plain, "name", "frame", "target")


def test_the_sheet_is_the_one_behind_the_mark_else_the_first_that_is_seen(tmp_path):
    other = spoilt(4, "z_mm", 12.5)
    file = write(tmp_path, ("Draft",), Draft=[["x"]], A=ROWS, B=other)
    first, second = read(file), read(tmp_path / "one.xlsx#B")
    check_same(first, read(csv(tmp_path)))
    check_same(second, read(csv(tmp_path, other)), "name", "frame", "target")
    assert second.position[2, 0, 2] == 0.0125
    assert (first.name, second.name) == ("one", "one B")
    assert read_series(tmp_path / "one.xlsx#B", ARM).columns.table.notes[0].startswith("sheet B, tabs")
    assert digest(tmp_path / "one.xlsx#B") == digest(file)
    assert "expected one of its sheets, Draft, A, B, got 'C'" in refused(read, tmp_path / "one.xlsx#C")


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
    found = read_series(write(tmp_path, A=rows), ARM)
    (one,) = found.series
    assert one.row.tolist() == list(range(5, 5 + N))  # as the spreadsheet numbers them
    assert found.lost.tolist() == [5 + N]
    assert np.array_equal(one.position, read(csv(tmp_path)).position)


@pytest.mark.parametrize(
    ("cell", "found"),
    [
        ('<c s="2"><v>12.5</v></c>', 0.0125),
        ("<c><f>A1*2</f><v>-3.0</v></c>", -0.003),
        ('<c t="str"><v>1e2</v></c>', 0.1),
        ('<c t="inlineStr"><is><r><t>1</t></r><r><t>2.5</t></r></is></c>', 0.0125),
        ('<c s="3"><v>43862</v></c>', "got '2020-02-01 00:00:00'"),
        ('<c s="1"><v>43862.5</v></c>', "got '2020-02-01 12:00:00'"),
        ("<c><f>A1+1</f></c>", "a formula without its result"),
        ('<c t="e"><v>#DIV/0!</v></c>', "got 'DIV/0!'"),
        ('<c t="b"><v>1</v></c>', "got 'TRUE'"),
        ('<c t="inlineStr"><is><t>12 mm</t></is></c>', "got '12 mm'"),
    ],
)
def test_a_number_is_what_the_file_holds_and_what_is_none_is_refused_by_row_and_column(tmp_path, cell, found):
    """A date is what spreadsheets make of 1.2: its number, 43862, would be a reading 44 m away."""
    file = write(tmp_path, A=spoilt(6, "y_mm", cell))
    if isinstance(found, str):
        line = refused(read, file)
        assert "line 6, column y_mm" in line
        assert found in line
    else:
        assert read(file).position[4, 0, 1] == found


def test_dates_are_times_of_the_rows(tmp_path):
    stamps = ["<c" + f' s="1"><v>{44000.25 + k / 86400!r}</v></c>' for k in range(N)]
    rows = [[*own, s] for own, s in zip(ROWS, ["Timestamp", *stamps], strict=True)]
    one = read(write(tmp_path, A=rows))
    assert one.time == pytest.approx(np.arange(N), abs=1e-3)  # a millisecond is what days tell apart


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
    assert data.runs == N


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"xl/workbook.xml": None}, "it has no xl/workbook.xml"),
        ({"xl/worksheets/sheet1.xml": None}, "it has no xl/worksheets/sheet1.xml"),
        ({"xl/worksheets/sheet1.xml": "<w><row>"}, "no element found"),
        ({"xl/sharedStrings.xml": "<sst/>"}, "list index out of range"),
        ({"xl/worksheets/sheet1.xml": "<w><row><c r='B1'/><c r='A1'/></row></w>"}, "cell 'A1' stands behind"),
        ({"xl/worksheets/sheet1.xml": "<w><row r='2'/><row r='1'/></w>"}, "row 1 stands behind row 2"),
        ({"xl/worksheets/sheet1.xml": "<!DOCTYPE w [<!ENTITY a 'b'>]><w>&a;</w>"}, "document types"),
    ],
)
def test_a_broken_workbook_is_refused_in_one_line(tmp_path, change, said):
    file, made = tmp_path / "one.xlsx", parts({"A": ROWS})
    file.write_bytes(packed({name: text for name, text in (made | change).items() if text is not None}))
    assert said in refused(read, file)


def test_any_cut_of_a_workbook_is_refused_in_one_line(tmp_path):
    whole, file = write(tmp_path, A=ROWS).read_bytes(), tmp_path / "cut.xlsx"
    for size in range(4, len(whole), 211):
        file.write_bytes(whole[:size])
        assert "workbook" in refused(read, file)
