"""The page of a corrected program: the path, where loads draw the tool off it, and the arm that does so."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.compensate import CorrectedProgram
from testbench.bench.compensate_report import CompensationReport, PointRow
from testbench.correct.rest import rest
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.trials.spread import ENOUGH
from testbench.views.colours import GCO, LOAD, MEASURED, TASK, Look
from testbench.views.compensate.words import tables
from testbench.views.magnified import arrow_scale
from testbench.views.page.charts import Line, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene
from testbench.views.picked import of_all, picked
from testbench.views.schema import Column, Table

SHARE, LEAST = 0.15, 0.3  #: Length of most errors over the size of the path, which counts this at least [m].
FORCE = 0.25  #: Length of the force's arrow over that size [1].
BEFORE, AFTER = "as programmed", "corrected, within (95 %)"
LOOKS = {BEFORE: Look(MEASURED, 1, prior=True), AFTER: Look(GCO, 0, prior=True)}
OFF = "How far the loaded tool is off at each point (mm)"
SIZES = (
    Column("name", "tool"),
    Column("median", "median", "mm"),
    Column("p95", "95 %", "mm"),
    Column("max", "largest", "mm"),
)


def seen(cell: Cell, found: CorrectedProgram, report: CompensationReport) -> Seen:
    """What the page of a corrected program draws."""
    own, points = found.found, found.program.points
    some = picked(np.linalg.norm(own.before, axis=1), np.arange(points), far=1)
    rows = [report.rows[k] for k in some]
    before = np.array([row.before_mm for row in rows])
    half = np.array([np.nan if row.half_95_mm is None else row.half_95_mm for row in rows])
    lines = [Line(name, LOOKS[name], mm) for name, mm in ((BEFORE, before), (AFTER, half))]
    note = of_all(len(some), points, "points")
    scale, groups = _groups(cell, found, rows, some)
    return Seen(
        scene=Scene(cell, f"What is off, and how the arm bends, x {scale:g}.", groups),
        runs=[RunChart(OFF, 0, [row.label for row in rows], lines, note=note)],
        tables=_tables(report),
    )


def _groups(
    cell: Cell, found: CorrectedProgram, rows: list[PointRow], some: Ids
) -> tuple[float, list[Poses]]:
    """The arm along its program, seen from near and as a whole; how much is magnified."""
    own, q = found.found, found.found.start[some]
    asked = own.target.position[some]
    size = max(LEAST, float(np.linalg.norm(np.ptp(asked, axis=0))))
    M = arrow_scale(own.before[some], SHARE * size)
    off, back = (asked + M * metres[some] for metres in (own.before, own.after))
    force = np.sum([load.wrench[some, :3] for load in found.loads], axis=0)
    most = float(np.linalg.norm(force, axis=1).max()) or 1.0
    ways = {"path asked": (asked, TASK), BEFORE: (off, MEASURED), "corrected, by the model": (back, GCO)}
    half = M * np.where(np.isfinite(own.half[some]), own.half[some], np.nan)
    spans = half[:, None, :] * np.eye(3)  # along each axis of the world
    low, high = ((back[:, None] + side * spans).reshape(1, -1, 3) for side in (-1, 1))
    layers = [
        Layer("where it may be, 95 %", GCO, "lines", low, high),
        *(Layer(name, colour, "lines", x[None, :-1], x[None, 1:]) for name, (x, colour) in ways.items()),
        Layer("tool asked", TASK, "dots", asked[:, None]),
        Layer("tool drawn off", MEASURED, "arrows", asked[:, None], off[:, None]),
        Layer("force", LOAD, "arrows", (off - FORCE * size / most * force)[:, None], off[:, None]),
    ]
    near = Poses(
        name="Path, from near",
        names=[f"Point {row.label}, line {row.line}" for row in rows],
        words=[_said(row) for row in rows],
        rigid=rigid_frames(cell.room, q),
        bent=elastic_frames(cell.plant, q, M * _bent(found, some)),
        layers=layers,
        first=int(np.argmax([row.before_mm for row in rows])),
        near=np.vstack([asked, off, asked.mean(axis=0) + LEAST / 2 * np.vstack([np.eye(3), -np.eye(3)])]),
    )
    return M, [replace(near, bent=None), replace(near, name="Whole arm", near=None)]


def _bent(found: CorrectedProgram, some: Ids) -> Array:
    """Virtual joints as programmed, less what the program knows of, (points, n_theta) [m, rad]."""
    state, q = found.model.state, found.found.start[some]
    loaded = rest(state, q, [load.of(some) for load in found.loads]).theta
    return loaded if found.found.asked == "drawn" else loaded - rest(state, q).theta


def _said(row: PointRow) -> str:
    if row.reason:
        return f"{row.before_mm:.3f} mm off as programmed; left as it is: {row.reason}."
    sure = row.half_95_mm is not None
    half = f"corrected within {row.half_95_mm:.3f} mm (95 %)" if sure else "nothing bounds what is left"
    return f"{row.before_mm:.3f} mm off as programmed; {half}."


def _tables(report: CompensationReport) -> list[Table]:
    rows: list[Mapping[str, object]] = [{"name": BEFORE, **vars(report.before_mm)}]
    if report.half_95_mm is not None:
        rows.append({"name": AFTER, **vars(report.half_95_mm)})
    every, many = tables(report), report.loaded >= ENOUGH
    columns = tuple(column for column in SIZES if many or column.key != "p95")
    return [
        Table(columns, rows, "How far the loaded tool is off", headline="median", looks=LOOKS),
        replace(every["worst"], title="Worst points", headline="before_mm"),
        replace(every["joints"], title="Corrections of the joints"),
    ]
