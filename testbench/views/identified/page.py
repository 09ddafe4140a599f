"""The page of an identified model: the arm in its runs and over the workspace, what models leave there."""

from dataclasses import replace

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Cell
from testbench.bench.explained import Elsewhere, Explained, compared, longest
from testbench.bench.fit_rows import Fits, Fitted
from testbench.bench.rows import MM
from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array
from testbench.model.vjm import chain, generalised_load
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.views.colours import MEASURED, NOMINAL, look
from testbench.views.fits import COUNTS
from testbench.views.identified.report import IdentifiedReport, RunRow
from testbench.views.identified.words import tables
from testbench.views.scene import (
    Layer,
    Line,
    PlaceMap,
    Poses,
    RunChart,
    Scene,
    Seen,
    arrow_scale,
    of_all,
    picked,
)
from testbench.views.schema import Table, show

MOVED, LEFT = 0.12, 0.2  #: Length of most arrows of deflections and of errors over the reach [1].
LEFT_MM = "What is left in each run, at the target where it is worst (mm)"
NOWHERE = "no bound"


def seen(cell: Cell, made: Explained, report: IdentifiedReport) -> Seen:
    """What the page of an identified model draws; the arm as its folder has it."""
    data, fits = made.runs.every, made.found.fits
    some = picked(made.taken, np.flatnonzero(data.seen.any(axis=1)))
    models = compared(fits)
    groups, title = [], ""
    if len(some):
        runs, title = _runs(cell, made, report, models, some)
        groups.append(runs)
    elsewhere = _in_order(made, report)
    if elsewhere is not None:
        groups.append(_places(cell, elsewhere))
    lines = [_line(m, MM * longest(made.left[m.name])[some]) for m in models]
    labels, note = [str(data.run[k]) for k in some], of_all(len(some), made.runs.total, "runs")
    chart = RunChart(LEFT_MM, 0, labels, lines, report.noise_p95_mm, note)
    return Seen(
        scene=Scene(cell, title, groups) if groups else None,
        map=None if elsewhere is None else _map(models, elsewhere, len(groups) - 1),
        runs=[chart] if len(some) else [],
        tables=_tables(fits, report),
    )


def _line(model: Fitted, values: Array) -> Line:
    return Line(model.name, look(model.structure, model.constraint, model.prior), values)


def _runs(
    cell: Cell, made: Explained, report: IdentifiedReport, models: list[Fitted], some: Ids
) -> tuple[Poses, str]:
    """The arm bent by the model to take, targets as read and as each model has them; what is magnified."""
    data, reach = made.runs.every, cell.vjm.reach
    hidden = np.where(data.seen[some][..., None], 0.0, np.nan)
    moved, left = data.deflection[some] + hidden, {m.name: made.left[m.name][some] + hidden for m in models}
    M, A = arrow_scale(moved, MOVED * reach), arrow_scale(left[report.recommended], LEFT * reach)
    before = data.before[some] + hidden
    at = before + M * moved
    theta = _bent(cell, data, made.found.taken.C_theta, some)
    rows = [report.residuals[k] for k in some]
    poses = Poses(
        name="Runs, against their readings",
        names=[f"Run {row.where}" for row in rows],
        words=[_said(row, models, cell.arm.words(data.q[k])) for row, k in zip(rows, some, strict=True)],
        rigid=rigid_frames(cell.room, data.q[some]),
        bent=elastic_frames(cell.plant, data.q[some], M * theta),
        layers=[
            Layer("targets read unloaded", NOMINAL, "dots", before),
            Layer("read under load", MEASURED, "dots", at),
            Layer("deflection as read", MEASURED, "lines", before, at),
            *(
                Layer(f"error of {m.name}", _line(m, at).look.colour, "arrows", at, at - A * left[m.name])
                for m in models
            ),
        ],
        first=int(made.taken[some].argmax()),
    )
    return poses, f"Deflections x {M:g}, arrows of errors from reading to model x {A:g}."


def _bent(cell: Cell, data: Dataset, C_theta: Array, some: Ids) -> Array:
    """Virtual joints under the load of each run, Eq. (6), (runs, n_theta) [m, rad]."""
    load = generalised_load(chain(cell.vjm, data.q[some]), data.wrench[some], data.point[some])
    return np.asarray((C_theta @ load).T)


def _said(row: RunRow, models: list[Fitted], joints: str) -> str:
    left = ", ".join(f"{m.name} {show(row.residual_mm[m.name])} mm" for m in models)
    return f"Pose {row.pose}, moves {show(row.deflection_mm)} mm. Left at the worst target: {left}. {joints}."


def _in_order(made: Explained, report: IdentifiedReport) -> Elsewhere | None:
    """The places in the order of the report."""
    if made.elsewhere is None or report.map is None:
        return None
    return made.elsewhere.of(np.array(report.map.errors.run) - 1)


def _places(cell: Cell, found: Elsewhere) -> Poses:
    """The arm all over the workspace."""
    sizes = zip(MM * found.deflection, MM * found.half, found.q, strict=True)
    return Poses(
        name="Workspace, under the largest load",
        names=[f"Place {k} of {len(found.q)}" for k in range(1, len(found.q) + 1)],
        words=[
            f"The tool moves {size:.3f} mm, {f'+- {half:.3f} mm' if np.isfinite(half) else NOWHERE} (95 %). "
            f"{cell.arm.words(q)}."
            for size, half, q in sizes
        ],
        rigid=rigid_frames(cell.room, found.q),
        bent=None,
        layers=[Layer("tool", MEASURED, "dots", found.position[:, None])],
        first=int(np.where(np.isfinite(found.half), found.half, 0).argmax()),
    )


def _map(models: list[Fitted], found: Elsewhere, group: int) -> PlaceMap:
    """A map a model; joints alone have none: what they leave out is in no half width."""
    shown = [m for m in models if m.name in found.models and (m.structure != JOINTS or m is models[-1])]
    half = [MM * found.models[m.name].half for m in shown]
    return PlaceMap(
        f"Half width of the 95 % interval of the tool's deflection under the largest load (mm); {COUNTS}",
        group,
        found.position,
        [_line(m, np.where(np.isfinite(mm), mm, np.nan)) for m, mm in zip(shown, half, strict=True)],
        heading="How sure it is elsewhere",
        without="" if np.isfinite(half).all() else NOWHERE,
    )


def _tables(fits: Fits, report: IdentifiedReport) -> list[Table]:
    """Models and their intervals, what is left in every run, what the runs tell."""
    every = tables(fits, report)
    headline = "check.rms_mm" if fits.models[0].check else "identification.rms_mm"
    models = replace(every["models"], title="Models", headline=headline)
    runs = replace(every["runs"], title="What is left in each run")
    told = replace(every["seen"], title="What the runs tell of each link and joint")
    return [models, *(table for name, table in every.items() if name == "intervals"), runs, told]
