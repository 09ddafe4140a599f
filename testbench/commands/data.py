"""What `testbench data check` says and draws of a file of measured runs: columns, doubts, the runs."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import Cell
from testbench.campaign.registration_notes import registration_notes
from testbench.campaign.rows import MM, UM
from testbench.data.columns import Column, Columns
from testbench.data.dataset import Dataset
from testbench.data.names import What
from testbench.data.read_pairs import Export
from testbench.errors import Array, Ids
from testbench.identify.registered import Registered
from testbench.model.vjm import marker_points, tool_points, tool_pose
from testbench.plant.shapes import rigid_frames
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, say
from testbench.report.table import Row
from testbench.views.colours import LOAD, MEASURED, NOMINAL, SERIES, Look
from testbench.views.markdown import Markdown, capital, counted, ended
from testbench.views.scene import Layer, Line, Poses, RunChart, Scene, Seen, arrow_scale, of_all, picked
from testbench.views.schema import NUMBER, Table, plain, show, written_out

COMMAND = "testbench data check"  #: As manifest.json names it.
CALLED: dict[What, str] = {
    "reading": "position",
    "point": "load point",
    "covariance": "covariance",
    "rotation": "orientation",
}
"""What people call the quantities with another name of theirs."""
LISTED, MOST = 4, 6  #: Words of a column, and loads and names, that are listed.
SMALL = 1e-3  #: Lengths below are shown in um [m].
SHARE, ARROW = 0.15, 0.2  #: Length of deflections and of the load's arrow over the reach [1].
COLUMNS = columns("quantity file_columns unit values rows")


def understand(export: Export) -> Row:
    """What is in a file before any frame is found."""
    data, table = export.data, export.columns.table
    size = np.where(data.seen, MM * np.linalg.norm(data.deflection, axis=-1), np.nan)
    known = size[data.seen]
    least, median, most = np.quantile(known, [0, 0.5, 1]).tolist() if len(known) else [np.nan] * 3
    downward = (data.wrench[:, [0, 1, 3, 4, 5]] == 0).all() and (data.wrench[:, 2] <= 0).all()
    return Row(
        columns=list(column_rows(export.columns)),
        ignored=export.columns.ignored,
        rows=table.rows,
        runs=data.runs,
        poses=len(np.unique(data.pose)),
        stations=1 if data.station is None else len(np.unique(data.station)),
        markers=data.markers,
        lost=[_where(data, i, k) for i, k in np.argwhere(~data.seen)],
        loads=_loads(data, hung=bool(downward)),
        deflection_mm=Row(least=least, median=median, most=most),
        farthest=_where(data, *np.argwhere(size == most)[0]) if len(known) else "",
        sigma_um=UM * data.sigma,
        notes=[*table.notes, *export.notes],
    )


def _where(data: Dataset, run: int, marker: int) -> str:
    return f"{data.markers[marker]} in run {data.run[run]}"


def _loads(data: Dataset, *, hung: bool) -> list[str]:
    """Loads that differ in their sizes by more than rounding, the smallest first."""
    sizes = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=-1).round(6)
    values, counts = np.unique(sizes, axis=0, return_counts=True)
    return [
        f"{force:.5g} N"
        + (f" and {moment:.5g} N m" if moment else "")
        + (f" (as of {force / GRAVITY:.5g} kg hung)" if hung and force else "")
        + f" in {counted(runs, 'run')}"
        for (force, moment), runs in zip(values.tolist(), counts.tolist(), strict=True)
    ]


def column_rows(found: Columns) -> Iterator[Row]:
    """A row a quantity; the axes of a vector stand in one."""
    groups: dict[tuple[object, ...], list[Column]] = {}
    for column in sorted(found.found.values(), key=lambda c: c.index):
        slot = column.slot
        alone = slot.index if slot.what in ("joint", "sigma") else 0
        groups.setdefault((slot.what, slot.marker, slot.when, alone), []).append(column)
    for own in groups.values():
        slot, names = own[0].slot, [column.name for column in own]
        what = CALLED.get(slot.what, slot.what) + (f" {slot.index + 1}" if slot.what == "joint" else "")
        state = {"before": "unloaded", "after": "loaded"}.get(slot.when, slot.when)
        there = np.any([~found.table.blank(column.index) for column in own], axis=0)
        yield Row(
            quantity=" ".join(filter(None, (what, slot.marker, state))),
            file_columns=", ".join(names) if len(names) <= 2 else f"{names[0]} ... {names[-1]}",
            unit=own[0].unit.name if own[0].unit else "",
            values=_values(found, own),
            rows=str(int(there.sum())),  # a word: there is nothing to draw
        )


def _values(found: Columns, own: list[Column]) -> str:
    """The words of a column, or its least and largest number; small lengths are in um."""
    unit = own[0].unit
    if unit is None:
        words = list(dict.fromkeys(found.table.texts(own[0].index)))
        few = ", ".join(word[:20] for word in words[:LISTED])
        return few if len(words) <= LISTED else f"{few} ... ({len(words)})"
    numbers = np.concatenate([found.values(column) / unit.scale for column in own])
    known = numbers[np.isfinite(numbers)]
    ends = dict.fromkeys(f"{x:.5g}" for x in (known.min(), known.max())) if len(known) else ["none"]
    text = " to ".join(ends)
    return NUMBER.sub(lambda number: _length(number[0]), text) if unit.name == "m" else written_out(text)


def _length(number: str) -> str:
    metres = float(number)
    return f"{UM * metres:g} um" if 0 < abs(metres) < SMALL else plain(number)


def listed(found: Row) -> list[str]:
    """Columns below one another, then the whole in numbers: of any width, for a terminal."""
    return ["", *column_lines(found.columns), "", *contents(found)]


def column_lines(found: Sequence[Row]) -> list[str]:
    """Columns of a file below one another."""
    table = [[column.heading for column in COLUMNS]]
    table += [[row[column.key] for column in COLUMNS] for row in found]
    widths = [2 + max(map(len, cells)) for cells in zip(*table, strict=True)]
    return ["".join(map(str.ljust, cells, widths)).rstrip() for cells in table]


def contents(found: Row) -> list[str]:
    """The whole in numbers, what was left out, what was assumed."""
    lost, stations = found.lost, f", {found.stations} stations" if found.stations > 1 else ""
    return [
        f"{found.rows} rows: {counted(found.runs, 'run')} in {counted(found.poses, 'pose')}, "
        f"{counted(len(found.markers), 'marker')} {', '.join(found.markers)}{stations}",
        f"lost targets: {len(lost)} of {found.runs * len(found.markers)}"
        + (f", {_few(lost)}" if lost else ""),
        f"loads: {_few(found.loads, '; ')}",
        f"sigma of a reading {show(found.sigma_um, 'g')} um",
        f"columns not read: {_few(found.ignored)}",
        *(f"- {note}" for note in found.notes),
    ]


def _few(names: Sequence[str], mark: str = ", ") -> str:
    """The first names, and how many there are more."""
    more = f" and {len(names) - MOST} more" if len(names) > MOST else ""
    return (mark.join(names[:MOST]) or "none") + more


def report(found: Row, registered: Registered) -> Report:
    """How many runs there are, how far they move; `found` holds `doubts`, `scale` and `dataset` too."""
    f = Row(found, arm=registered.vjm.arm.name, frame=registered.frame, away=_away(registered))
    return Report(
        scenario="data_check",
        question=say("What was understood of {dataset}?", f),
        title=say("{dataset} as runs of {arm}", f),
        answer=say(
            "{runs:counted run} in {poses:counted pose}, {targets:counted target}: they move "
            "{deflection_mm.least:.3f} to {deflection_mm.most:.3f} mm, median {deflection_mm.median:.3f} mm"
            f"{'; {lost:counted reading} lost' if f.lost else ''}. "
            f"{'Doubts: {doubts}.' if f.doubts else 'No doubts about the runs.'}",
            f,
            targets=len(f.markers),
            lost=len(f.lost),
            doubts=len(f.doubts),
        ),
        worst=_worst(f),
        claims=list(_claims(f, registration_notes(registered))),
        numbers=f,
        tables={"columns": Table(COLUMNS, f.columns, "Which column is which quantity")},
        body=[
            "columns",
            Markdown("\n".join(say("- {text}", text=text.removeprefix("- ")) for text in contents(f))),
        ],
    )


def _worst(f: Row) -> Markdown:
    if not f.farthest:
        return Markdown()
    return say(
        "Most moves {farthest}: {deflection_mm.most:.3f} mm; {away.target} is read farthest from where the "
        "arm without sag has it, {away.distance_mm:.3f} mm.",
        f,
    )


def _claims(f: Row, notes: Sequence[str]) -> Iterator[Markdown]:
    yield from (say("**Doubt**: {text}", text=ended(text)) for text in f.doubts)
    yield from (say("{text}", text=ended(capital(text))) for text in notes)
    if f.scale is not None:
        yield say("The deflections are {scale:.2f} times those that the arm's folder predicts.", f)


def _away(registered: Registered) -> Row | None:
    """The unloaded reading that fits the arm without sag worst, and how far it is off."""
    data = registered.data
    if not data.seen.any():
        return None
    off = np.where(data.seen, np.linalg.norm(data.before - _nominal(registered), axis=-1), -1.0)
    i, k = np.unravel_index(int(off.argmax()), off.shape)
    return Row(target=_where(data, int(i), int(k)), distance_mm=MM * float(off[i, k]))


def _nominal(registered: Registered) -> Array:
    """Targets of the rigid arm, (runs, m, 3) [m]."""
    vjm, data = registered.vjm, registered.data
    return tool_points(vjm, data.q, marker_points(vjm, data.markers))


def write(cell: Cell, registered: Registered, said: Report, flags: str, out: Path) -> None:
    """data.png, report, recording, page and manifest.json, with the flags that say how the runs are read.

    Raises:
        InputError: When they cannot be written.
    """
    name, arms = said.numbers["dataset"], [cell.arm.rigid.parent]
    leave(
        out,
        Asked(COMMAND, name, {"data": name, "flags": flags}, arms, "data.png"),
        said,
        seen(cell, registered),
    )


def seen(cell: Cell, registered: Registered) -> Seen:
    """The arm run by run, its targets as read and as they should be."""
    data = registered.data
    hidden = np.where(data.seen, 0.0, np.nan)
    moved = MM * np.linalg.norm(data.deflection, axis=2) + hidden
    away = MM * np.linalg.norm(data.before - _nominal(registered), axis=2) + hidden
    some = picked(np.nan_to_num(moved).max(axis=1), np.flatnonzero(data.seen.any(axis=1)))
    if not len(some):
        return Seen()
    M = arrow_scale(data.deflection[some] + hidden[some][..., None], SHARE * cell.vjm.reach)
    labels, note = [str(data.run[k]) for k in some], of_all(len(some), data.runs, "runs")
    charts = [
        RunChart(
            title,
            0,
            "run",
            labels,
            [
                Line(n, Look(SERIES[k % len(SERIES)], k, prior=True), mm[some, k])
                for k, n in enumerate(data.markers)
            ],
            note=note,
        )
        for title, mm in (
            ("How far loads moved each target (mm)", moved),
            ("Unloaded reading from where the arm without sag has the target (mm)", away),
        )
    ]
    title = f"Deflections x {M:g}; loads are arrows of one length."
    return Seen(scene=Scene(cell, title, [_runs(cell, registered, some, M)]), runs=charts)


def _runs(cell: Cell, registered: Registered, some: Ids, M: float) -> Poses:
    """The arm in its runs, its targets where they should be, were read, and went under load."""
    data = registered.data
    q, force = data.q[some], data.wrench[some, :3]
    hidden = np.where(data.seen[some], 0.0, np.nan)[..., None]
    nominal, before = _nominal(registered)[some] + hidden, data.before[some] + hidden
    position, rotation = tool_pose(cell.vjm, q)
    hook = (position + np.matvec(rotation, data.point[some]))[:, None]
    size = np.linalg.norm(force, axis=1, keepdims=True)
    way = np.divide(force, size, out=np.full(force.shape, np.nan), where=size > 0)[:, None]
    layers = [
        Layer("targets of the arm without sag", NOMINAL, "dots", nominal),
        Layer("from the tool", NOMINAL, "lines", np.broadcast_to(position[:, None], nominal.shape), nominal),
        Layer("read unloaded", MEASURED, "dots", before),
        Layer("deflection", MEASURED, "arrows", before, before + M * data.deflection[some]),
        Layer("load", LOAD, "arrows", hook, hook + ARROW * cell.vjm.reach * way),
    ]
    found = registered.registration
    if registered.frame == "tracker" and found is not None:
        at = np.array([-one.rotation.T @ one.translation for one in found.frames.values()])
        names = [f"tracker {k + 1}" for k in range(len(at))]
        layers.append(Layer("tracker", MEASURED, "dots", at[None], labels=names))
    return Poses(
        name="Runs",
        names=[f"Run {run}, pose {pose}" for run, pose in zip(data.run[some], data.pose[some], strict=True)],
        words=[_said(cell, data, int(k)) for k in some],
        rigid=rigid_frames(cell.room, q),
        bent=None,
        layers=layers,
        first=int(np.nan_to_num(np.linalg.norm(before - nominal, axis=2)).max(axis=1).argmax()),
    )


def _said(cell: Cell, data: Dataset, k: int) -> str:
    size = MM * np.linalg.norm(data.deflection[k], axis=1)
    moved = [
        f"{name} {f'moves {mm:.3f} mm' if there else 'lost'}"
        for name, mm, there in zip(data.markers, size, data.seen[k], strict=True)
    ]
    force = float(np.linalg.norm(data.wrench[k, :3]))
    return f"{force:.5g} N: {', '.join(moved)}. {cell.arm.words(data.q[k])}."
