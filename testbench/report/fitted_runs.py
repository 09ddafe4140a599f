"""Pictures of fits to a user's runs: the arm in its runs and over the workspace, residuals, half widths."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.data.dataset import in_order
from testbench.errors import Array, Ids
from testbench.model.laws import for_load_history, model_for
from testbench.model.vjm import chain, generalised_load, joint_law_rotations
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.colours import MEASURED, NOMINAL, look
from testbench.report.loads import loads, on_tool, read_along
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PlaceMap,
    PoseGroup,
    RunChart,
    Scene,
    arrow_scale,
    at_one_target,
    largest_and_even,
    of_all,
    workspace,
)
from testbench.runs.rows import Row
from testbench.workflows.cell import Cell
from testbench.workflows.fit_numbers import COUNTS, compared_models, largest_vector
from testbench.workflows.fits import IdentifyResult
from testbench.workflows.rows import MM
from testbench.workflows.workspace_errors import ErrorPlaces

MOVED, LEFT = 0.12, 0.2  #: Length of most arrows of deflections and of errors over the reach [1].
LEFT_MM = "What is left in each run, at the target where it is worst (mm)"
NOWHERE = "no bound"
NEXT = "Measure next"  #: What is written where the chosen model is least sure.


def seen(cell: Cell, identified: IdentifyResult, f: Row, left: Mapping[str, Array]) -> PageContent:
    """Collect what page, picture and recording draw.

    Args:
        cell: The arm as its folder has it.
        identified: The fits.
        f: Their numbers, `fit_numbers.numbers`, with the badge of the report.
        left: Residuals by model, (runs, m, 3) [m].

    Returns:
        The content.
    """
    data = identified.runs.every
    names = compared_models(f.models, f.recommended)
    rival = [f.badge.rival] if f.badge and f.badge.rival not in names else []
    names = [*rival, *names]
    some = largest_and_even(largest_vector(left[names[-1]]), np.flatnonzero(data.seen.any(axis=1)))
    groups: list[PoseGroup] = []
    title, charts = "", []
    if len(some):
        runs, title = _runs(cell, identified, f, {name: left[name] for name in names}, some)
        groups.append(runs)
        lines = [_line(f, name, MM * largest_vector(left[name])[some]) for name in names]
        labels, note = [str(data.run[k]) for k in some], of_all(len(some), identified.runs.every.runs, "runs")
        charts = [RunChart(LEFT_MM, 0, "run", labels, lines, f.noise_p95_mm, note)]
    if f.map is not None:
        groups.append(_places(cell, f.map.errors, f.recommended))
    return PageContent(
        scene=Scene(cell, title, groups) if groups else None,
        map=None if f.map is None else _map(f, len(groups) - 1),
        runs=charts,
    )


def _line(f: Row, name: str, values: Array) -> ModelLine:
    own = next(model for model in f.models if model.name == name)
    return ModelLine(name, look(own.structure, own.constraint, own.prior), values)


def _runs(
    cell: Cell, identified: IdentifyResult, f: Row, left: Mapping[str, Array], some: Ids
) -> tuple[PoseGroup, str]:
    """Bend the arm by the model to take, with targets as read and modelled; say what is magnified."""
    data, reach, taken = identified.runs.every, cell.vjm.reach, f.recommended
    hidden = np.where(data.seen[some][..., None], 0.0, np.nan)
    moved, off = data.deflection[some] + hidden, {name: own[some] + hidden for name, own in left.items()}
    M, A = arrow_scale(moved, MOVED * reach), arrow_scale(off[taken], LEFT * reach)
    before = data.before[some] + hidden
    at = before + M * moved
    start, one = at_one_target(at, off, taken)
    vjm = model_for(cell.vjm, identified.taken.structure)
    where = chain(for_load_history(vjm, data.taken_off, some), data.q[some])
    load = generalised_load(where, data.wrench[some], data.point[some])
    theta = joint_law_rotations(vjm, (identified.taken.C_theta @ load).T)  # Eq. (6)
    rows = [f.residuals[k] for k in some]
    bent = elastic_frames(cell.plant, data.q[some], M * theta)
    looks = {name: _line(f, name, at).look for name in one}
    errors = [
        Layer(f"error of {name}", looks[name].colour, looks[name].stroke, start, start - A * own)
        for name, own in one.items()
    ]
    poses = PoseGroup(
        name="Runs, against their readings",
        names=[f"Run {row.which_run}" for row in rows],
        words=[_said(row, list(left), cell.arm.words(data.q[k])) for row, k in zip(rows, some, strict=True)],
        rigid=rigid_frames(cell.room, data.q[some]),
        bent=bent,
        layers=[
            *loads(on_tool(cell, bent, data.point[some]), data.wrench[some, :3], reach),
            *read_along(in_order(data, some), where.position, reach),
            Layer("targets read unloaded", NOMINAL, "dots", before),
            Layer("read under load", MEASURED, "dots", at),
            Layer("deflection as read", MEASURED, "lines", before, at),
            *errors,
        ],
        first=int(largest_vector(left[taken])[some].argmax()),
    )
    arrows = "arrows from reading to model, where the chosen model errs most"
    return poses, f"Deflections x {M:g}; {arrows}, x {A:g}."


def _said(row: Row, names: list[str], joints: str) -> str:
    left = ", ".join(f"{name} {row.residual_mm[name]:.3f} mm" for name in names)
    return f"Pose {row.pose}, moves {row.moved_mm:.3f} mm. Left at the worst target: {left}. {joints}."


def _places(cell: Cell, errors: ErrorPlaces, taken: str) -> PoseGroup:
    """Show the arm all over the workspace."""
    half, q = errors.errors(taken), np.array(errors.q)
    sizes = zip(errors.deflection_mm, half, errors.joints, strict=True)
    words = [f"The tool moves {moved:.3f} mm, {_bound(mm)} (95 %). {joints}." for moved, mm, joints in sizes]
    tool = Layer("tool", MEASURED, "dots", np.array(errors.position_m)[:, None])
    first = int(np.nan_to_num(half).argmax())
    words[first] = f"{NEXT}: here the model is least sure. {words[first]}"
    poses = workspace(cell, q, words, [tool], first)
    return replace(poses, name="Workspace, under the largest load", fixed=True)


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
        worst_is="next: +-",
    )
