"""Positions that were not fitted: errors.csv, and the arm amid its errors."""

import csv

import numpy as np

from testbench.bench.absolute_report import OrderRow, SpectrumRow
from testbench.bench.campaign import Cell
from testbench.bench.rows import UM
from testbench.data.series import Series
from testbench.errors import Array
from testbench.plant.shapes import rigid_frames
from testbench.report.report import Report
from testbench.report.table import Row
from testbench.studies.real_ur10.figure import LOOKS
from testbench.studies.real_ur10.ladder import JOINTS, TWO, WAVES
from testbench.studies.real_ur10.readings import read, split
from testbench.studies.real_ur10.trained import SHOWN
from testbench.studies.real_ur10.trial import Settings
from testbench.studies.study import Run
from testbench.views.markdown import grid
from testbench.views.recording.absolute import AbsoluteScene, Arrows, write_absolute
from testbench.views.recording.arm import origins

POSES, ARROWS = 300, 800  #: Poses that are shown, and errors that stand still, at most, evenly spaced.
HOW = """**Colours** Arrows lead from model to reading, times {scale:g}: blue is small, orange is
{most:.2g} mm or more, the same on both sides. Vermillion: the pose in sight. Grey: the arm.

**Scrub** the time bar below: `worst_first` begins where {before} errs most, `run` keeps the order of
the readings."""


def write(run: Run[Settings, Report]) -> None:
    """errors.csv and recording.rrd."""
    readings = read(run.settings.thin)
    judged = [one.series for one in split(SHOWN, readings.series).judged]
    errors = [np.concatenate([_left(run.settings, one, model.name) for one in judged]) for model in TWO]
    write_errors(run, readings.cell, judged, errors)
    write_recording(run, readings.cell, judged, errors)


def _left(asked: Settings, series: Series, name: str) -> Array:
    """Readings minus a model, base axes, (rows, 3) [m]."""
    own = next(
        row.left_um for row in asked.ladder if (row.split, row.name, row.judged) == (SHOWN, name, series.name)
    )
    return np.array(own).reshape(-1, 3) / UM


def write_errors(run: Run[Settings, Report], cell: Cell, judged: list[Series], errors: list[Array]) -> None:
    """A line a position: series, row of its file, joints, reading minus model in base axes by both models."""
    names = [f"{joint.name}_rad" for joint in cell.arm.joints]
    vectors = [f"{what}_{x}_um" for what in ("springs", "joint_errors") for x in "xyz"]
    with (run.folder / "errors.csv").open("w", encoding="utf-8", newline="") as text:
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(["series", "run", *names, *vectors])
        rows = [(one.name, int(one.row[k]), *one.q[k].tolist()) for one in judged for k in range(one.rows)]
        for row, *off in zip(rows, *errors, strict=True):
            lines.writerow([*row, *(round(UM * float(x), 2) for vector in off for x in vector)])


def write_recording(
    run: Run[Settings, Report], cell: Cell, judged: list[Series], errors: list[Array]
) -> None:
    """The arm amid its errors, without and with joint errors."""
    q = np.concatenate([one.q for one in judged])
    still, some = (np.unique(np.linspace(0, len(q) - 1, min(n, len(q))).astype(int)) for n in (ARROWS, POSES))
    places = tuple(origins(cell, cell.arm.markers, rigid_frames(cell.room, q)))
    before, after = (Arrows(places, tuple(error[:, None])) for error in errors)
    names = [f"Series {one.name}, run {row}" for one in judged for row in one.row]
    mm = [1e3 * one.longest for one in (before, after)]
    words = [f"- {{:.3f}} mm, {model.name}" for model in TWO]
    made = AbsoluteScene(
        cell=cell,
        q=q[some],
        number=some + 1,
        drawn=before.of(some),
        calibrated=after.of(some),
        still=(before.of(still), after.of(still)),
        pose_words=[
            "\n".join([f"**{names[k]}**", "", *(w.format(x[k]) for w, x in zip(words, mm, strict=True))])
            for k in some
        ],
        summary=run.report.summary(run.tables["short"]),
        tables=grid(run.tables["ladder"]),
        geometry="\n\n".join(grid(run.tables[name]) for name in ("compliances", "waves", "joints")),
        spectrum=[_spectrum(joint) for joint in Row(run.report.numbers).joints],
        models={
            kind: (model.name, LOOKS[model.name].colour)
            for kind, model in (("drawn", JOINTS), ("calibrated", WAVES))
        },
        kind="ladder",
        opens="drawn",
    )
    how = HOW.format(scale=made.scale, most=made.top_mm, before=JOINTS.name)
    write_absolute(run.folder / "recording.rrd", run.header, made.saying(how))


def _spectrum(joint: Row) -> SpectrumRow:
    orders = [OrderRow(k + 1, y, 0.0) for k, y in enumerate(joint.amplitude_both_urad)]
    return SpectrumRow(joint.joint, joint.rms_both_urad, orders)
