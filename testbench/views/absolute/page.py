"""The page of a calibration: readings on the arm, how far and where it was off, as drawn and calibrated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from testbench.bench.absolute_report import AbsoluteReport
from testbench.bench.absolute_summary import Reported
from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Ids
from testbench.data.series import Series, select_rows
from testbench.errors import Array
from testbench.identify.absolute.state import State, Told, targets, tell
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.views.absolute.words import tables
from testbench.views.colours import GCO, MEASURED, NOMINAL, Look
from testbench.views.magnified import arrow_scale
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene
from testbench.views.picked import of_all, picked
from testbench.views.schema import Table

LONGEST, BENT = 0.3, 0.12  #: Length of most arrows and of most sags over the reach [1].
DRAWN, CALIBRATED = Look(NOMINAL, 1, prior=True), Look(GCO, 0, prior=True)
NAMES = "as drawn", "calibrated"
LEFT_MM = "Distance of the reading from the arm as drawn and calibrated, at the worst target (mm)"


@dataclass(frozen=True)
class _Rows:
    """Some rows of all series; of a target that was lost, or that another series has more, NaN."""

    series: Sequence[str]  #: Name of the series of each.
    row: Ids  #: Number in its file.
    q: Array  #: (rows, n) [rad, m].
    tool: Array  #: By the calibrated arm, (rows, 3) [m].
    sag: Array  #: Virtual joints that load and own weight bend, by the calibrated arm, (rows, n_theta).
    read: Array  #: Targets, (rows, m, 3) [m].
    before: Array  #: Reading minus arm as drawn, (rows, m, 3) [m].
    after: Array  #: Reading minus calibrated arm, (rows, m, 3) [m].

    @property
    def errors_mm(self) -> tuple[Array, Array]:
        """Of the worst target before and after, (rows,)."""
        before, after = (MM * np.nanmax(np.linalg.norm(x, axis=2), axis=1) for x in (self.before, self.after))
        return before, after


def seen(cell: Cell, reported: Reported) -> Seen:
    """What the page of a calibration draws."""
    rows, total = _rows(reported)
    made = _poses(cell, rows)
    labels = [str(k) for k in rows.row]
    both = zip(NAMES, (DRAWN, CALIBRATED), rows.errors_mm, strict=True)
    lines = [Line(*one) for one in both]
    note = of_all(len(rows.q), total, "poses")
    return Seen(
        scene=made,
        map=PlaceMap(LEFT_MM, 0, rows.tool, lines),
        runs=[RunChart("Pose by pose (mm)", 0, labels, lines, note=note)],
        tables=_tables(reported.report),
    )


def _rows(reported: Reported) -> tuple[_Rows, int]:
    """The farthest rows and others evenly; and how many there are."""
    series, state = reported.found.series, reported.found.calibration.state
    m = max(len(one.markers) for one in series)
    after = np.concatenate([_seen(one, x, m) for one, x in zip(series, reported.after, strict=True)])
    before = np.concatenate([_seen(one, x, m) for one, x in zip(series, reported.before, strict=True)])
    size = np.linalg.norm(after, axis=2)
    known = np.flatnonzero(np.isfinite(size).any(axis=1))
    some = picked(np.nan_to_num(size).max(axis=1), known)
    names = [one.name for one in series for _ in range(one.rows)]
    ends = np.cumsum([0, *(one.rows for one in series)])
    places = [some[(a <= some) & (some < b)] - a for a, b in pairwise(ends)]
    shown = [select_rows(one, at) for one, at in zip(series, places, strict=True)]
    told = [tell(state, one.q, one.wrench, one.point) for one in shown]
    left = [x[at] for x, at in zip(reported.after, places, strict=True)]
    read = [_read(state, *three, m) for three in zip(shown, told, left, strict=True)]
    found = _Rows(
        series=[names[k] for k in some],
        row=np.concatenate([one.row for one in series])[some],
        q=np.concatenate([one.q for one in series])[some],
        tool=np.concatenate([one.where.position for one in told]),
        sag=np.concatenate([(state.C_theta @ one.u).T for one in told]),
        read=np.concatenate(read),
        before=before[some],
        after=after[some],
    )
    return found, len(known)


def _seen(series: Series, values: Array, m: int) -> Array:
    """Values of targets, (rows, own, 3), as (rows, m, 3); NaN where one was lost or is none."""
    found = np.full((series.rows, m, 3), np.nan)
    found[:, : len(series.markers)] = np.where(series.seen[..., None], values, np.nan)
    return found


def _read(state: State, series: Series, told: Told, after: Array, m: int) -> Array:
    """Where targets were read, in base axes, (rows, m, 3) [m]."""
    return _seen(series, targets(told, state.mount(series)) + after, m)


def _poses(cell: Cell, rows: _Rows) -> Scene:
    """The arm in every row, and from where it should have its targets to where they were read, enlarged."""
    reach = cell.vjm.reach
    A = arrow_scale(rows.before, LONGEST * reach)
    straight, soft = rigid_frames(cell.room, rows.q), bool(rows.sag.any())
    moved = elastic_frames(cell.plant, rows.q, rows.sag).positions - straight.positions
    M = arrow_scale(moved[:, -1], BENT * reach)
    errors = zip(NAMES, (NOMINAL, GCO), (rows.before, rows.after), strict=True)
    before, after = (x.tolist() for x in rows.errors_mm)
    group = Poses(
        name="Readings",
        names=[f"{name}, row {row}" for name, row in zip(rows.series, rows.row, strict=True)],
        words=[
            f"{b:.3f} mm as drawn, {a:.3f} mm calibrated. {cell.arm.words(q)}."
            for b, a, q in zip(before, after, rows.q, strict=True)
        ],
        rigid=straight,
        bent=elastic_frames(cell.plant, rows.q, M * rows.sag) if soft else None,
        layers=[
            *(
                Layer(f"error {name}", colour, "arrows", rows.read - A * error, rows.read)
                for name, colour, error in errors
            ),
            Layer("target as read", MEASURED, "dots", rows.read),
        ],
        first=int(np.argmax(after)),
    )
    title = f"Arrows from where the arm should have its target to the reading x {A:g}."
    return Scene(cell, f"{title} Sag of the calibrated arm x {M:g}." if soft else title, [group])


def _tables(report: AbsoluteReport) -> list[Table]:
    """What pays, then the series, then what was found; of those that have rows."""
    every = tables(report)
    kept = {row.name: Look(GCO, 0, prior=row.kept) for row in report.ladder}
    found = [
        replace(every["steps"], title="What pays: held-out readings", headline="after_mm", looks=kept),
        replace(every["series"], title="Series", headline="after.mean_mm"),
        replace(every["compliances"], title="Compliances"),
        replace(every["geometry"], title="Errors of geometry"),
        replace(every["spectrum"], title="Periodic errors of the joints"),
        replace(every["outliers"], title="Readings that hardly count"),
    ]
    return [table for table in found if table.rows]
