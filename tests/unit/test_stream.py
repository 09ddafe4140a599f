"""Files of any number of runs: read block by block as they are read as a whole, fitted as from memory."""

import tracemalloc
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from blockwise import check_equal, in_blocks, read_both_ways, series_both_ways
from refused import refused

from testbench.arm.folder import load_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.fits import Runs, fit
from testbench.campaign.models import named_models
from testbench.campaign.runs import Many
from testbench.data import stream
from testbench.data.dataset import Dataset, select
from testbench.data.series import Series, select_rows, series_of
from testbench.data.spool import Campaign, spooled
from testbench.data.write import write_csv, write_series
from testbench.model.vjm import chain, observation, tool_points

ARM = load_arm(Path(__file__).parents[2] / "models" / "kr500_l480")
CELL = build_cell("kr500_l480")


def runs(count: int, *, lost: bool = False) -> Dataset:
    """Runs in as many poses under loads of three levels, read as the arm's own compliances have them."""
    rng, vjm = np.random.default_rng(count), CELL.vjm
    lower, upper = ARM.limits
    q = lower + (upper - lower) * rng.random((count, 6))
    wrench = np.zeros((count, 6))
    wrench[:, 2] = -1000 * rng.integers(2, 5, count)
    point = np.tile(vjm.load, (count, 1))
    [structure] = {m.structure for m in named_models(CELL, ["ALL153"])}
    moved = observation(chain(vjm, q), structure, wrench, point, vjm.markers) @ structure.entries(ARM.C_theta)
    before = tool_points(vjm, q, vjm.markers) + 5e-5 * rng.standard_normal((count, 3, 3))
    after = before + moved + 5e-5 * rng.standard_normal((count, 3, 3))
    number = np.arange(count) + 1
    found = Dataset(ARM.markers, number, number, q, wrench, point, before, after, 5e-5)
    if not lost:
        return found
    gone = (rng.random((count, 3)) < 0.2)[..., None]
    gone[5] = True  # a run without a reading
    precision = np.where(gone[..., None], 0.0, np.eye(3) / (2 * 5e-5**2))
    before, after = (np.where(gone, 0.0, x) for x in (before, after))
    return replace(found, before=before, after=after, precision=precision)


def campaign(data: Dataset, size: int = 17) -> Campaign:
    first = np.arange(data.runs) // size
    return spooled(select(data, first == k) for k in np.unique(first))


def _remarks(text: str) -> bytes:
    head, *rows = text.splitlines()
    return "\n".join([f'{head},x ("),y (")', *(f"{row},é,5" for row in rows)]).encode("cp1252")


WRITTEN = {
    "plain": str.encode,
    "windows": lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"),
    "decimal_comma": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabs_and_no_end": lambda text: text.replace(",", "\t").rstrip("\n").encode(),
    "title": lambda text: f"Report; of a day\n\n\n{text}".encode(),
    "comments_and_blank_lines": lambda text: text.replace("\n14,", "\n\n# a remark\n,,,\n14,").encode(),
    "header_again": lambda text: text.replace("\n19,", f"\n{text[: text.index(chr(10))]}\n19,", 1).encode(),
    "quotes": lambda text: text.replace(",P2,", ',"P2",').encode() + b"\n\r\n",
    "blanks_and_signs": lambda text: text.replace(",P3,", ", P3 ,").replace(",0.0,", ",+0.0,").encode(),
    "remarks": _remarks,
    "runs_of_blanks": lambda text: text.replace(",", "  ").encode(),
}
AT_ONCE = {"plain", "windows", "decimal_comma", "tabs_and_no_end", "title"}


def readings(*, lost: bool = False) -> list[Series]:
    """Two set-ups of one tracker, two readings a pose; of the second some targets, or rows, are lost."""
    [both] = series_of(runs(24), "set-up", "mount")
    order = np.argsort(both.pose, kind="stable")
    first = replace(select_rows(both, order), pose=both.pose[order] + 1, row=np.arange(48) + 1)
    gone = np.random.default_rng(1).random((48, 3)) < 0.3 * lost
    gone[7] = lost
    precision = np.where(gone[..., None, None], 0.0, np.eye(3) / first.sigma**2)
    second = replace(first, name="other", row=first.row + 48, pose=first.pose + 24)
    second = replace(second, position=np.where(gone[..., None], 0.0, first.position + 0.01))
    return [first, replace(second, precision=precision if lost else None)]


@pytest.mark.parametrize("name", WRITTEN)
def test_blocks_are_read_as_the_whole_file_is(tmp_path, name):
    """Runs of blanks have no blank cells; of numbers alone only the head is looked at line by line."""
    lost = name != "runs_of_blanks"
    data = runs(24, lost=lost)
    pairs, series = tmp_path / "pairs.csv", tmp_path / "series.csv"
    write_csv(data, ARM, pairs)
    write_series(series, ARM, readings(lost=lost))
    for file in (pairs, series):
        file.write_bytes(WRITTEN[name](file.read_text(encoding="utf-8")))
    found, streamed = read_both_ways(pairs, ARM)
    assert streamed
    check_equal(replace(found, precision=None), replace(data, precision=None))
    with patch.object(stream, "table_of", wraps=stream.table_of) as asked:
        assert len(in_blocks(pairs, ARM).every) > 10
    assert asked.call_count == 1 or name not in AT_ONCE
    absolute, streamed = series_both_ways(series, ARM)
    assert streamed
    assert len(absolute.series) == 2
    assert any("rows without a reading" in note for note in absolute.notes) == lost


def test_poses_without_a_column_are_numbered_alike_and_may_not_return(tmp_path):
    [one, _] = readings()
    one = replace(one, name="one", frame="one", target="one")
    for name, rows in (("one", np.arange(48)), ("back", np.r_[np.arange(48), 0])):
        own = select_rows(one, rows)
        write_series(tmp_path / f"{name}.csv", ARM, replace(own, row=np.arange(len(rows)) + 1, name=name))
        text = (tmp_path / f"{name}.csv").read_text(encoding="utf-8")
        assert "pose" not in text.splitlines()[0].split(",")
        found, streamed = series_both_ways(tmp_path / f"{name}.csv", ARM)
        assert streamed == (name == "one")
        assert "poses are numbered by equal joint angles: 24 of them" in found.notes


@pytest.fixture
def lines(tmp_path):
    write_csv(runs(60), ARM, tmp_path / "runs.csv")
    return (tmp_path / "runs.csv").read_text(encoding="utf-8").splitlines()


def instead(line, cell, other):
    """Another cell in a line, counted from 1."""

    def change(lines):
        cells = lines[line - 1].split(",")
        return [*lines[: line - 1], ",".join([*cells[:cell], other, *cells[cell + 1 :]]), *lines[line:]]

    return change


def other_sigma(lines):
    """From a run on, so that no block has two."""
    return [*lines[:148], *(line.replace(",5e-05", ",6e-05") for line in lines[148:])]


FAR_DOWN = [
    *((instead(151, cell, other), "line 151") for cell, other in ((3, "x"), (3, "9"), (3, ""), (20, "nan"))),
    *(
        (instead(151, cell, other), "line 151")
        for cell, other in ((0, "1.5"), (1, ""), (2, "P9"), (20, "\0"))
    ),
    *((instead(line, 0, "\ufeff1"), f"line {line}, column run") for line in (2, 9, 20)),
    (other_sigma, "line 149, column sigma_m: expected one value in the whole file"),
    (lambda lines: [*lines, *lines[1:4]], "stands in the file twice"),
]


@pytest.mark.parametrize(("change", "said"), FAR_DOWN)
def test_what_is_wrong_far_down_is_named_as_ever(tmp_path, lines, change, said):
    file = tmp_path / "bad.csv"
    file.write_text("\n".join(change(lines)), encoding="utf-8")
    found = {refused(read, file, ARM) for read in (read_both_ways, in_blocks)}
    assert len(found) == 1
    assert said in found.pop()


def test_rows_of_a_run_that_stand_apart_are_read_as_a_whole(tmp_path, lines):
    apart, file = tmp_path / "apart.csv", tmp_path / "sorted.csv"
    apart.write_text("\n".join([*lines[:2], *lines[3:], lines[2]]), encoding="utf-8")
    assert not read_both_ways(apart, ARM)[1]
    file.write_text("\n".join([lines[0], *sorted(lines[1:], key=lambda row: row.split(",")[2])]))
    data, streamed = read_both_ways(file, ARM)
    assert not streamed
    assert (data.runs, data.markers) == (60, ("P1", "P2", "P3"))


def test_memory_does_not_grow_with_the_runs(tmp_path):
    """Identifiers and sizes of loads are held, 32 bytes a run, and sorted; the runs themselves take 264.

    Both files are longer than what their columns are understood by.
    """
    few, many = tmp_path / "few.csv", tmp_path / "many.csv"
    write_csv(runs(1100), ARM, few)
    head, _, rows = few.read_text(encoding="utf-8").partition("\n")
    with many.open("w", encoding="utf-8") as file:
        file.write(f"{head}\n")
        for k in range(3):
            again = (row.split(",", 1) for row in rows.splitlines())
            file.writelines(f"{int(run) + 1100 * k},{rest}\n" for run, rest in again)

    def peak(path: Path) -> int:
        tracemalloc.start()
        found = in_blocks(path, ARM, size=60_000)
        assert max(found.every.block(k)[1].runs for k in range(len(found.every))) < 100
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(few)
    assert peak(many) - peak(few) < 2200 * 130


@pytest.mark.parametrize("lost", [False, True])
def test_very_many_runs_are_fitted_chosen_and_judged_as_few_are(lost):
    data = runs(80, lost=lost)
    data = replace(data, pose=(data.pose + 1) // 2)
    held = data.pose % 9 == 0
    models = named_models(CELL, ["Joints", "MLS56", "MGCO56"])
    few = Runs("runs.csv", data, select(data, ~held), select(data, held))
    many = replace(few, many=Many(campaign(data), ~held))
    one, two = (fit(CELL, models, own, lambda: 0.0, widths=True) for own in (few, many))
    assert (two.fits.recommended, two.fits.runs, two.fits.poses) == (one.fits.recommended, 72, 36)
    for a, b in zip(one.fits.models, two.fits.models, strict=True):
        for there in ("identification", "check"):
            row, other = getattr(a, there), getattr(b, there)
            assert other.rms_mm == pytest.approx(row.rms_mm, rel=1e-6)
            assert other.max_mm == pytest.approx(row.max_mm, rel=1e-5)
            assert other.max_relative_percent == pytest.approx(row.max_relative_percent, rel=1e-5)
        assert b.f_m == pytest.approx(a.f_m, rel=1e-6)
    for a, b in zip(one.fits.held_out, two.fits.held_out, strict=True):
        assert b.f_m == pytest.approx(a.f_m, rel=1e-6)
    check_equal(two.runs.every, data)  # all of so few are looked at
    assert "all 80 runs are fitted" in two.fits.notes[-1]


def test_of_more_runs_than_are_looked_at_the_worst_are_and_some_have_intervals(monkeypatch):
    """The notes say so."""
    data, models = runs(80), named_models(CELL, ["Joints"])
    data.after[37, 1] += 0.01
    for module in ("data.spool", "campaign.fits"):
        monkeypatch.setattr(f"testbench.{module}.SHOWN", 10)
    monkeypatch.setattr("testbench.identify.evaluate.FAR", 3)
    held = Runs("runs.csv", data, data, None)
    many = replace(held, many=Many(campaign(data), np.ones(80, dtype=bool)))
    found = fit(CELL, models, many, lambda: 0.0).runs
    assert 10 <= found.every.runs <= 13
    assert 38 in found.every.run
    assert found.total == 80
    fits = fit(CELL, models, held, lambda: 0.0, widths=True).fits
    assert fits.runs == 80
    asked = [row["run"] for row in fits.models[0].intervals.deflections[::3]]
    assert asked == [1, 10, 19, 27, 36, 45, 54, 62, 71, 80]
    assert "intervals are of 10 of 80 runs" in fits.notes[-1]
