"""Pictures of fits to a user's runs: the arm in its runs and over the workspace, residuals, half widths."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.errors import Array, Ids
from testbench.model.laws import as_loaded, vjm_of
from testbench.model.vjm import chain, generalised_load, turns
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.colours import MEASURED, NOMINAL, look
from testbench.report.scene import (
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
    workspace,
)
from testbench.runs.rows import Row
from testbench.workflows.cell import Cell
from testbench.workflows.fit_numbers import COUNTS, compared, longest
from testbench.workflows.fits import Identified
from testbench.workflows.rows import MM
from testbench.workflows.workspace_errors import ErrorPlaces

MOVED, LEFT = 0.12, 0.2  #: Length of most arrows of deflections and of errors over the reach [1].
LEFT_MM = "What is left in each run, at the target where it is worst (mm)"
ASIDE = 0.012  #: Arrows of two models start so far apart over the reach, as one would hide the other [1].
NOWHERE = "no bound"


def seen(cell: Cell, found: Identified, f: Row, left: Mapping[str, Array]) -> Seen:
    """Collect what page, picture and recording draw.

    Args:
        cell: The arm as its folder has it.
        found: The fits.
        f: Their numbers, `fit_numbers.numbers`, with the badge of the report.
        left: Residuals by model, (runs, m, 3) [m].
    """
    data = found.runs.every
    names = compared(f.models, f.recommended)
    rival = [f.badge.rival] if f.badge and f.badge.rival not in names else []
    names = [*rival, *names]
    some = picked(longest(left[names[-1]]), np.flatnonzero(data.seen.any(axis=1)))
    groups: list[Poses] = []
    title, charts = "", []
    if len(some):
        runs, title = _runs(cell, found, f, {name: left[name] for name in names}, some)
        groups.append(runs)
        lines = [_line(f, name, MM * longest(left[name])[some]) for name in names]
        labels, note = [str(data.run[k]) for k in some], of_all(len(some), found.runs.every.runs, "runs")
        charts = [RunChart(LEFT_MM, 0, "run", labels, lines, f.noise_p95_mm, note)]
    if f.map is not None:
        groups.append(_places(cell, f.map.errors, f.recommended))
    return Seen(
        scene=Scene(cell, title, groups) if groups else None,
        map=None if f.map is None else _map(f, len(groups) - 1),
        runs=charts,
    )


def _line(f: Row, name: str, values: Array) -> Line:
    own = next(model for model in f.models if model.name == name)
    return Line(name, look(own.structure, own.constraint, own.prior), values)


def _runs(cell: Cell, found: Identified, f: Row, left: Mapping[str, Array], some: Ids) -> tuple[Poses, str]:
    """Bend the arm by the model to take, with targets as read and modelled; say what is magnified."""
    data, reach, taken = found.runs.every, cell.vjm.reach, f.recommended
    hidden = np.where(data.seen[some][..., None], 0.0, np.nan)
    moved, off = data.deflection[some] + hidden, {name: own[some] + hidden for name, own in left.items()}
    M, A = arrow_scale(moved, MOVED * reach), arrow_scale(off[taken], LEFT * reach)
    before = data.before[some] + hidden
    at = before + M * moved
    vjm = vjm_of(cell.vjm, found.taken.structure)
    where = chain(as_loaded(vjm, data.taken_off, some), data.q[some])
    load = generalised_load(where, data.wrench[some], data.point[some])
    theta = turns(vjm, (found.taken.C_theta @ load).T)  # Eq. (6)
    rows = [f.residuals[k] for k in some]
    aside = ASIDE * reach * np.eye(3)[0] * (np.arange(len(off)) - (len(off) - 1) / 2)[:, None]
    errors = [
        Layer(
            f"error of {name}",
            (drawn := _line(f, name, at).look).colour,
            drawn.stroke,
            start,
            start - A * own,
        )
        for (name, own), start in zip(off.items(), at + aside[:, None, None], strict=True)
    ]
    poses = Poses(
        name="Runs, against their readings",
        names=[f"Run {row.which_run}" for row in rows],
        words=[_said(row, list(left), cell.arm.words(data.q[k])) for row, k in zip(rows, some, strict=True)],
        rigid=rigid_frames(cell.room, data.q[some]),
        bent=elastic_frames(cell.plant, data.q[some], M * theta),
        layers=[
            Layer("targets read unloaded", NOMINAL, "dots", before),
            Layer("read under load", MEASURED, "dots", at),
            Layer("deflection as read", MEASURED, "lines", before, at),
            *errors,
        ],
        first=int(longest(left[taken])[some].argmax()),
    )
    return poses, f"Deflections x {M:g}, arrows of errors from reading to model x {A:g}."


def _said(row: Row, names: list[str], joints: str) -> str:
    left = ", ".join(f"{name} {row.residual_mm[name]:.3f} mm" for name in names)
    return f"Pose {row.pose}, moves {row.moved_mm:.3f} mm. Left at the worst target: {left}. {joints}."


def _places(cell: Cell, errors: ErrorPlaces, taken: str) -> Poses:
    """Show the arm all over the workspace."""
    half, q = errors.errors(taken), np.array(errors.q)
    sizes = zip(errors.deflection_mm, half, errors.joints, strict=True)
    words = [f"The tool moves {moved:.3f} mm, {_bound(mm)} (95 %). {joints}." for moved, mm, joints in sizes]
    tool = Layer("tool", MEASURED, "dots", np.array(errors.position_m)[:, None])
    first = int(np.nan_to_num(half).argmax())
    return replace(workspace(cell, q, words, [tool], first), name="Workspace, under the largest load")


def _bound(mm: float) -> str:
    return f"+- {mm:.3f} mm" if np.isfinite(mm) else NOWHERE


def _map(f: Row, group: int) -> PlaceMap:
    """Map each model; joints alone have no map: what they leave out is in no half width."""
    errors = f.map.errors
    half = {name: errors.errors(name) for name in errors.compared}
    return PlaceMap(
        f"Half width of the 95 % interval of the tool's deflection under the largest load (mm); {COUNTS}",
        group,
        np.array(errors.position_m),
        [_line(f, name, mm) for name, mm in half.items()],
        heading="How sure it is elsewhere",
        without="" if all(np.isfinite(mm).all() for mm in half.values()) else NOWHERE,
    )
