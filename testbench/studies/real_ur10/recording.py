"""Positions that were not fitted: errors.csv, and the arm amid its errors."""

import csv

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.rows import MM, UM
from testbench.data.series import Series
from testbench.errors import Array
from testbench.plant.shapes import origins, rigid_frames
from testbench.studies.real_ur10.figure import LOOKS
from testbench.studies.real_ur10.ladder import TWO
from testbench.studies.real_ur10.readings import read, split
from testbench.studies.real_ur10.trained import SHOWN
from testbench.studies.real_ur10.trial import Settings
from testbench.studies.study import Run
from testbench.views.magnified import arrow_scale
from testbench.views.page.charts import Line, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene
from testbench.views.picked import of_all, picked

LONGEST = 0.3  #: Most arrows of errors over the reach [1].


def write(run: Run[Settings]) -> Seen:
    """errors.csv; what is drawn: the arm amid its errors."""
    readings = read(run.settings.thin)
    judged = [one.series for one in split(SHOWN, readings.series).judged]
    errors = [np.concatenate([_left(run.settings, one, model.name) for one in judged]) for model in TWO]
    write_errors(run, readings.cell, judged, errors)
    return seen(readings.cell, judged, errors)


def _left(asked: Settings, series: Series, name: str) -> Array:
    """Readings minus a model, base axes, (rows, 3) [m]."""
    own = next(
        row.left_um for row in asked.ladder if (row.split, row.name, row.judged) == (SHOWN, name, series.name)
    )
    return np.array(own).reshape(-1, 3) / UM


def write_errors(run: Run[Settings], cell: Cell, judged: list[Series], errors: list[Array]) -> None:
    """A line a position: series, row of its file, joints, reading minus model in base axes by both models."""
    names = [f"{joint.name}_rad" for joint in cell.arm.joints]
    vectors = [f"{what}_{x}_um" for what in ("springs", "joint_errors") for x in "xyz"]
    with (run.folder / "errors.csv").open("w", encoding="utf-8", newline="") as text:
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(["series", "run", *names, *vectors])
        rows = [(one.name, int(one.row[k]), *one.q[k].tolist()) for one in judged for k in range(one.rows)]
        for row, *off in zip(rows, *errors, strict=True):
            lines.writerow([*row, *(round(UM * float(x), 2) for vector in off for x in vector)])


def seen(cell: Cell, judged: list[Series], errors: list[Array]) -> Seen:
    """The arm amid its errors by both models, from where each has the target to the reading."""
    q, sizes = np.concatenate([one.q for one in judged]), [MM * np.linalg.norm(e, axis=1) for e in errors]
    some = picked(sizes[-1], np.arange(len(q)))
    rigid = rigid_frames(cell.room, q[some])
    at = origins(cell.room, cell.arm.markers, rigid)
    A = arrow_scale(errors[0][some], LONGEST * cell.vjm.reach)
    names = [f"Series {one.name}, run {row}" for one in judged for row in one.row]
    models = [(model.name, LOOKS[model.name]) for model in TWO]
    group = Poses(
        name="Positions that were not fitted",
        names=[names[k] for k in some],
        words=[
            ", ".join(f"{name} {mm[k]:.3f} mm" for (name, _), mm in zip(models, sizes, strict=True)) + "."
            for k in some
        ],
        rigid=rigid,
        bent=None,
        layers=[
            Layer(f"error of {name}", look.colour, "arrows", at, at + A * error[some, None])
            for (name, look), error in zip(models, errors, strict=True)
        ],
        first=int(sizes[-1][some].argmax()),
    )
    lines = [Line(name, look, mm[some]) for (name, look), mm in zip(models, sizes, strict=True)]
    note = of_all(len(some), len(q), "positions")
    chart = RunChart("Error at each position (mm)", 0, [names[k] for k in some], lines, note=note)
    return Seen(scene=Scene(cell, f"Errors x {A:g}.", [group]), runs=[chart])
