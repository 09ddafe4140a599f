"""Positions that were not fitted: errors.csv, and the arm amid its errors."""

import csv

import numpy as np

from testbench.campaign.rows import MM, UM
from testbench.plant.shapes import origins, rigid_frames
from testbench.report.table import Trials
from testbench.studies.real_ur10.report import LOOKS
from testbench.studies.real_ur10.trial import BLOCKS, TWO, Settings, read, split
from testbench.studies.study import Run
from testbench.views.scene import Layer, Line, Poses, RunChart, Scene, Seen, arrow_scale, of_all, picked

LONGEST = 0.3  #: Most arrows of errors over the reach [1].


def write(run: Run[Settings]) -> Seen:
    """errors.csv, a line a position: row of its file, joints, reading minus both models in base axes.

    Returns:
        The arm amid its errors, from where each model has the target to the reading.
    """
    cell, series = read(run.settings.thin)
    judged = [one.series for one in split(BLOCKS, series)[1]]
    trials = Trials.read(run.folder / "trials.parquet").where(split=BLOCKS, judged=("A", "C"))
    left = [np.concatenate([*map(np.array, trials.where(name=name)["left_um"])]) for name in TWO]
    errors = [own.reshape(-1, 3) / UM for own in left]
    q = np.concatenate([one.q for one in judged])
    named = [(one.name, int(row)) for one in judged for row in one.row]
    with (run.folder / "errors.csv").open("w", encoding="utf-8", newline="") as text:
        rows = csv.writer(text, lineterminator="\n")
        vectors = [f"{what}_{x}_um" for what in ("springs", "joint_errors") for x in "xyz"]
        rows.writerow(["series", "run", *(f"{joint.name}_rad" for joint in cell.arm.joints), *vectors])
        for name, angles, *off in zip(named, q.tolist(), *(UM * error for error in errors), strict=True):
            rows.writerow([*name, *angles, *(round(x, 2) for own in off for x in own.tolist())])
    sizes = [MM * np.linalg.norm(error, axis=1) for error in errors]
    some = picked(sizes[-1], np.arange(len(q)))
    rigid = rigid_frames(cell.room, q[some])
    at = origins(cell.room, cell.arm.markers, rigid)
    A = arrow_scale(errors[0][some], LONGEST * cell.vjm.reach)
    names = [f"Series {named[k][0]}, run {named[k][1]}" for k in some]
    lines = [Line(name, LOOKS[name], mm[some]) for name, mm in zip(TWO, sizes, strict=True)]
    group = Poses(
        name="Positions that were not fitted",
        names=names,
        words=[
            f"{', '.join(f'{name} {mm[k]:.3f} mm' for name, mm in zip(TWO, sizes, strict=True))}."
            for k in some
        ],
        rigid=rigid,
        bent=None,
        layers=[
            Layer(f"error of {name}", LOOKS[name].colour, "arrows", at, at + A * error[some, None])
            for name, error in zip(TWO, errors, strict=True)
        ],
        first=int(sizes[-1][some].argmax()),
    )
    note = of_all(len(some), len(q), "positions")
    chart = RunChart("Error at each position (mm)", 0, "position", names, lines, note=note)
    return Seen(scene=Scene(cell, f"Errors x {A:g}.", [group]), runs=[chart])
