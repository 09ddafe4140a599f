"""What `testbench compensate` draws: the path as programmed and corrected, and the arm that follows it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from testbench.campaign.campaign import Cell
from testbench.campaign.program import CorrectedProgram
from testbench.commands.compensate_rows import AFTER, BEFORE, CORRECTED, LOOKS, within
from testbench.correct.rest import rest
from testbench.errors import Array, Ids
from testbench.model.vjm import turns
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.report import Report
from testbench.report.table import Row
from testbench.views.colours import GCO, LOAD, MEASURED, TASK, Colour
from testbench.views.scene import Layer, Line, Poses, RunChart, Scene, Seen, arrow_scale, of_all, picked

TOLERANCE = "tolerance"
SHARE, LEAST = 0.15, 0.3  #: Length of most errors over the size of the path, which counts this at least [m].
FORCE = 0.25  #: Length of the force's arrow over that size [1].
FAINT = (150, 205, 190)  #: Of intervals: pale green.


def seen(cell: Cell, found: CorrectedProgram, said: Report) -> Seen:
    """The path, where loads draw the tool off it, and the arm that does so."""
    points = said.numbers["rows"]
    some = picked(np.linalg.norm(found.found.before, axis=1), np.arange(len(points)), far=1)
    rows = [points[k] for k in some]
    before, half, after = (
        np.array([row[key] for row in rows], dtype=float) for key in ("before_mm", "half_95_mm", "after_mm")
    )
    errors = [
        Line(BEFORE, LOOKS[BEFORE], before, (np.maximum(before - half, 0), before + half)),
        Line(AFTER, LOOKS[AFTER], after + half),  # the solver's own residual is no success
    ]
    tolerance = said.numbers["tolerance"]
    note, labels = of_all(len(some), len(points), "points"), [row.label for row in rows]
    off = "How far the loaded tool is off at each point (mm)"
    chart = RunChart(off, 0, "point", labels, errors, tolerance and tolerance.mm, note, limit_is=TOLERANCE)
    scale, groups = _groups(cell, found, rows, some)
    return Seen(Scene(cell, f"What is off, and how the arm bends, x {scale:g}.", groups), runs=[chart])


def _groups(cell: Cell, found: CorrectedProgram, rows: Sequence[Row], some: Ids) -> tuple[float, list[Poses]]:
    """The arm along its program, seen from near and as a whole; how much is magnified."""
    own, q = found.found, found.found.start[some]
    asked = own.target.position[some]
    size = max(LEAST, float(np.linalg.norm(np.ptp(asked, axis=0))))
    M = arrow_scale(own.before[some], SHARE * size)
    off, back = (asked + M * metres[some] for metres in (own.before, own.after))
    force = np.sum([load.wrench[some, :3] for load in found.loads], axis=0)
    most = float(np.linalg.norm(force, axis=1).max()) or 1.0
    ways = {"path asked": (asked, TASK), BEFORE: (off, MEASURED), f"{CORRECTED}, by the model": (back, GCO)}
    half = M * np.where(np.isfinite(own.half[some]), own.half[some], np.nan)
    spans = half[:, None, :] * np.eye(3)  # along each axis of the world
    low, high = ((back[:, None] + side * spans).reshape(1, -1, 3) for side in (-1, 1))
    near = Poses(
        name="Path, from near",
        names=[f"Point {row.label}, line {row.line}" for row in rows],
        words=[_words(row) for row in rows],
        rigid=rigid_frames(cell.room, q),
        bent=elastic_frames(cell.plant, q, M * _bent(found, some)),
        layers=[
            Layer("where it may be, 95 %", FAINT, "lines", low, high),
            *(Layer(name, colour, "lines", x[None, :-1], x[None, 1:]) for name, (x, colour) in ways.items()),
            Layer("tool asked", TASK, "dots", asked[:, None]),
            Layer("tool drawn off", MEASURED, "arrows", asked[:, None], off[:, None]),
            Layer("force", LOAD, "arrows", (off - FORCE * size / most * force)[:, None], off[:, None]),
            *_judged(rows, asked),
        ],
        first=int(np.argmax([row.before_mm for row in rows])),
        near=np.vstack([asked, off, asked.mean(axis=0) + LEAST / 2 * np.vstack([np.eye(3), -np.eye(3)])]),
    )
    return M, [replace(near, bent=None), replace(near, name="Whole arm", near=None)]


def _judged(rows: Sequence[Row], asked: Array) -> list[Layer]:
    """Those of the path, (n, 3) [m], that keep the tolerance once corrected, small; others are large."""
    kinds: tuple[tuple[Literal["specks", "dots"], str, Colour], ...] = (
        ("specks", "pass", GCO),
        ("dots", "fail", MEASURED),
    )
    return [
        Layer(f"{CORRECTED}, points that {verdict}", colour, kind, asked[None, own])
        for kind, verdict, colour in kinds
        if (own := [k for k, row in enumerate(rows) if row.verdict == verdict])
    ]


def _bent(found: CorrectedProgram, some: Ids) -> Array:
    """Virtual joints as programmed, less what the program knows of, (points, n_theta) [m, rad]."""
    state, q = found.model.state, found.found.start[some]
    loaded = rest(state, q, [load.of(some) for load in found.loads]).theta
    own = loaded if found.found.asked == "drawn" else loaded - rest(state, q).theta
    return turns(state.vjm, own)


def _words(row: Row) -> str:
    """What is said of a point."""
    after = "nothing bounds what is left" if row.half_95_mm is None else f"{within(row.half_95_mm)} (95 %)"
    after = f"left as it is: {row.reason}" if row.reason else after
    judged = f" Tolerance: {row.verdict}." if row.verdict else ""
    return f"{row.before_mm:.3f} mm off as programmed; {after}.{judged}"
