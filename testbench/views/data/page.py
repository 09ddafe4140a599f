"""The page of measured runs: the arm run by run, its targets as read and as they should be."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array
from testbench.model.vjm import tool_pose
from testbench.plant.shapes import rigid_frames
from testbench.views.colours import LOAD, MEASURED, NOMINAL, Look
from testbench.views.data.nominal import magnification, nominal_markers, stations
from testbench.views.data.words import CheckedRuns, columns
from testbench.views.page.charts import Line, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene
from testbench.views.picked import of_all, picked

ARROW = 0.2  #: Length of a load's arrow over the reach [1].
MOVED = "How far loads moved each target (mm)"
AWAY = "Unloaded reading from where the arm without sag has the target (mm)"


def seen(cell: Cell, runs: CheckedRuns) -> Seen:
    """What the page of measured runs draws; the arm with the targets that were found."""
    data = runs.registered.data
    hidden = np.where(data.seen, 0.0, np.nan)
    nominal = nominal_markers(cell, data)
    moved = MM * np.linalg.norm(data.deflection, axis=2) + hidden
    away = MM * np.linalg.norm(data.before - nominal, axis=2) + hidden
    rows = np.flatnonzero(data.seen.any(axis=1))
    some = picked(np.nan_to_num(moved).max(axis=1), rows)
    if not len(some):
        return Seen(tables=[columns(runs.found)])
    labels, note = [str(data.run[k]) for k in some], of_all(len(some), data.runs, "runs")
    M = magnification(data, nominal)
    group = _runs(cell, runs, some, M)
    charts = [
        RunChart(title, 0, labels, _lines(data, values[some]), note=note)
        for title, values in ((MOVED, moved), (AWAY, away))
    ]
    scale = f"Deflections x {M:g}; loads are arrows of one length."
    return Seen(scene=Scene(cell, scale, [group]), runs=charts, tables=[columns(runs.found)])


def _lines(data: Dataset, values: Array) -> list[Line]:
    """A line a target, (runs, m) [mm]: one colour, a shape each."""
    return [Line(name, Look(MEASURED, k, prior=True), values[:, k]) for k, name in enumerate(data.markers)]


def _runs(cell: Cell, runs: CheckedRuns, some: Ids, M: float) -> Poses:
    """The arm in its runs, its targets where they should be, were read, and went under load."""
    data = runs.registered.data
    q, force = data.q[some], data.wrench[some, :3]
    hidden = np.where(data.seen[some], 0.0, np.nan)[..., None]
    nominal, before = nominal_markers(cell, data)[some] + hidden, data.before[some] + hidden
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
    at = stations(runs.registered)
    if len(at):
        names = [f"tracker {k + 1}" for k in range(len(at))]
        layers.append(Layer("tracker", MEASURED, "dots", at[None], labels=names))
    return Poses(
        name="Runs",
        names=[f"Run {run}, pose {pose}" for run, pose in zip(data.run[some], data.pose[some], strict=True)],
        words=[_said(cell, data, int(k)) for k in some],
        rigid=rigid_frames(cell.room, q),
        bent=None,
        layers=layers,
    )


def _said(cell: Cell, data: Dataset, k: int) -> str:
    size = MM * np.linalg.norm(data.deflection[k], axis=1)
    moved = [
        f"{name} {f'moves {mm:.3f} mm' if there else 'lost'}"
        for name, mm, there in zip(data.markers, size, data.seen[k], strict=True)
    ]
    force = float(np.linalg.norm(data.wrench[k, :3]))
    return f"{force:.5g} N: {', '.join(moved)}. {cell.arm.words(data.q[k])}."
