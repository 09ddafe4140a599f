"""Eq. (7): true deflections under heavy weights all over the workspace, and what the linear model loses."""

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.folder import find_arm, load_arm
from testbench.correct.newton import equilibrium
from testbench.errors import Array
from testbench.identify.posterior import elastic_state
from testbench.model.load import (
    Load,
    first_order_deflection,
    geometric_stiffness,
    massless_bodies,
    nonlinear_deflection,
    one_step_theta,
)
from testbench.model.structure import joints_only
from testbench.model.vjm import WorkArea, evaluate_chain, observation_matrix
from testbench.plant.build import Plant, weightless
from testbench.plant.equilibrium import solve_equilibrium
from testbench.report.badge import Badge, of_rivals
from testbench.report.colours import GCO, LEAST_SQUARES, NOMINAL, SERIES, Look, look
from testbench.report.figure import Figure, sweeps
from testbench.report.report import Report, say
from testbench.report.schema import ROUNDING_UM, Table, columns, pivot
from testbench.report.table import Row, Trials
from testbench.runs.rows import trial_rng
from testbench.studies import campaigns
from testbench.studies.paper.verdicts import comparison, verdict_table
from testbench.studies.run import READ, headline
from testbench.studies.study import ArmFlag, Run, Study
from testbench.workflows.cell import Cell, clear_poses
from testbench.workflows.models import JOINTS_ONLY
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import MM, UM

FULL, QUICK = (7, 200), (4, 30)  #: How many weights, and poses a seed.
WORKSPACE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))  #: Where the tool has to be.
AT_TOOL = np.zeros((1, 3))
NAMES = {
    "linear": "Eq. (6)",
    "secant": "Eq. (7) once",
    "integrated": "Eq. (7) integrated",
    "joints": "Joints-only",
}
LIGHT, HEAVY = "weightless", "own weight"
ALONE = look(JOINTS_ONLY, "none").colour
SHADES = {LIGHT: (LEAST_SQUARES, NOMINAL, GCO, ALONE), HEAVY: (SERIES[6], SERIES[5], SERIES[4], ALONE)}
LOOKS = {
    f"{name}, {truth}": Look(shade, place, prior=truth == HEAVY)
    for truth, shades in SHADES.items()
    for place, (name, shade) in enumerate(zip(NAMES.values(), shades, strict=True))
}
"""Of predictions: dashed and filled with own weight."""
BY_LOAD = columns("prediction load_N rms_um")

Truth = Literal["weightless", "own weight"]
Method = Literal["linear", "secant", "integrated", "joints"]
"""Eq. (6); Eq. (7) with K_w at theta = 0 for the whole load, or from no load to the whole; joints alone."""


@dataclass(frozen=True)
class LoadedStiffnessOptions:
    """Hold the flags of the study."""

    arm: ArmFlag = "kr500_l480"
    max_load_n: Annotated[
        float, typer.Option(min=1, max=100_000, metavar="N", help="Heaviest weight; the lightest is a tenth.")
    ] = 10_000.0


@dataclass(frozen=True, kw_only=True)
class LoadedStiffnessSettings(LoadedStiffnessOptions):
    """Describe what is tried."""

    loads: int = FULL[0]  #: How many weights, evenly spread on a log scale.
    poses: int = FULL[1]  #: How many poses a seed.

    @property
    def weights(self) -> list[float]:
        """Return the hung weights, ascending, (loads,) [N]."""
        return [float(w) for w in np.geomspace(self.max_load_n / 10, self.max_load_n, self.loads)]


@dataclass(frozen=True)
class PoseRow:
    """Hold one weight in one pose, by one truth and one method."""

    pose: int  #: Number of the pose, from 1.
    q_rad: tuple[float, ...]  #: Actuated joint angles, (n,).
    load_N: float  #: Hung weight.
    truth: Truth  #: With or without the arm's own weight.
    method: Method  #: What predicts.
    deflection_m: tuple[float, ...]  #: True deflection of the tool, world, (3,).
    error_m: tuple[float, ...]  #: Predicted minus true, world, (3,).


def _settings(options: LoadedStiffnessOptions, quick: bool, _: range) -> LoadedStiffnessSettings:
    """Make the settings of the flags."""
    loads, poses = QUICK if quick else FULL
    return LoadedStiffnessSettings(**vars(options), loads=loads, poses=poses)


def _trial(cell: Cell, asked: LoadedStiffnessSettings, seed: int, _: Models) -> Iterator[PoseRow]:
    """Make the rows of a seed, which has poses of its own."""
    q = clear_poses(cell, WORKSPACE, asked.poses, trial_rng(seed))
    plants: dict[Truth, Plant] = {"weightless": weightless(cell.plant), "own weight": cell.plant}
    for load in asked.weights:
        yield from _hang(cell, plants, q, load)


def _hang(cell: Cell, plants: Mapping[Truth, Plant], q: Array, load: float) -> list[PoseRow]:
    """Hang one weight in every pose: deflections true and predicted.

    Args:
        cell: The arm with its model and its truth.
        plants: The true arm by truth.
        q: Poses, (poses, n) [rad].
        load: The weight [N].

    Returns:
        The rows.
    """
    wrench = np.zeros((len(q), 6))
    wrench[:, 2] = -load
    point = np.tile(cell.vjm.load_point, (len(q), 1))
    predicted, rows = _predict(cell, q, wrench, point), []
    for truth, plant in plants.items():
        moved = (
            solve_equilibrium(plant, q, wrench, point).tool_positions
            - solve_equilibrium(plant, q).tool_positions
        )
        every = predicted | {"joints": joints_alone(cell, q, wrench, point, moved)}
        rows += [
            PoseRow(
                pose=i + 1,
                q_rad=tuple(angles.tolist()),
                load_N=load,
                truth=truth,
                method=method,
                deflection_m=tuple(moved[i].tolist()),
                error_m=tuple((foretold[i] - moved[i]).tolist()),
            )
            for method, foretold in every.items()
            for i, angles in enumerate(q)
        ]
    return rows


def _predict(cell: Cell, q: Array, wrench: Array, point: Array) -> dict[Method, Array]:
    """Predict the deflection of the tool by every method, with the true compliances.

    Args:
        cell: The arm with its model and its truth.
        q: Joint angles, (runs, n) [rad, m].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Point where the force acts in the tool's frame, (runs, 3) [m].

    Returns:
        Deflection by method, (poses, 3) [m].
    """
    unloaded, C_theta = evaluate_chain(cell.vjm, q), cell.arm.C_theta
    theta = equilibrium(
        elastic_state(cell.vjm, C_theta, massless_bodies(cell.arm)), q, [Load(wrench, point)]
    ).theta
    K_w = geometric_stiffness(unloaded, wrench, point)
    return {
        "linear": first_order_deflection(unloaded, one_step_theta(unloaded, C_theta, wrench, point), AT_TOOL)[
            :, 0
        ],
        "secant": first_order_deflection(
            unloaded, one_step_theta(unloaded, C_theta, wrench, point, K_w), AT_TOOL
        )[:, 0],
        "integrated": nonlinear_deflection(cell.vjm, q, theta, AT_TOOL)[:, 0],
    }


def joints_alone(cell: Cell, q: Array, wrench: Array, point: Array, moved: Array) -> Array:
    """Predict the deflection of the tool by joint compliances fitted to these very deflections.

    Linear as Eq. (6), links rigid, least squares without noise: no campaign leaves joints alone less.

    Args:
        cell: The arm with its model and its truth.
        q: Joint angles, (runs, n) [rad, m].
        wrench: Force and moment, world axes, (runs, 6) [N, N m].
        point: Point where the force acts in the tool's frame, (runs, 3) [m].
        moved: Deflections, (poses, 3) [m].

    Returns:
        Deflection, (poses, 3) [m].
    """
    A = observation_matrix(evaluate_chain(cell.vjm, q), joints_only(cell.arm), wrench, point, AT_TOOL)[:, 0]
    pi = np.linalg.lstsq(A.reshape(-1, A.shape[-1]), moved.ravel())[0]
    return np.asarray(A @ pi)


def _report(asked: LoadedStiffnessSettings, seeds: range, trials: Trials) -> Report:
    """Report the errors over the poses of all seeds, by load, truth and method."""
    rows = [
        Row(load_N=load, truth=truth, method=method, prediction=f"{NAMES[method]}, {truth}", **_errors(own))
        for (load, truth, method), own in trials.groups("load_N", "truth", "method")
    ]
    loads = trials.values("load_N")
    heaviest = trials.where(load_N=loads[-1], truth=LIGHT)
    f = Row(
        seed=campaigns.seeds_of(seeds),
        arm=find_arm(asked.arm).resolve().name,
        poses=asked.poses * len(seeds),
        loads_N=loads,
        rows=rows,
        claims=_statements(heaviest),
    )
    ordered = [row for name in LOOKS for row in rows if row.prediction == name]
    by_load = Table((), ordered, "RMS error of the tool's deflection by hung weight, um")
    badge = _badge(heaviest)
    return Report(
        scenario=STUDY.name,
        question=say(
            "How large are the errors of Eq. (6) and Eq. (7) for {arm} as the hung weight grows?", f
        ),
        title=say(
            "{arm}, {poses} poses, {n} hung weights of {least:.4g} to {most:.4g} N; no noise",
            f,
            n=len(loads),
            least=loads[0],
            most=loads[-1],
        ),
        answer=headline(
            badge, Table(columns("prediction rms_um"), [row for row in rows if row.load_N == loads[-1]])
        ),
        numbers=f,
        tables={
            "by_load": replace(pivot(by_load, *BY_LOAD), looks=LOOKS),
            "claims": verdict_table(f.claims),
        },
        body=["by_load", "claims", READ],
        badge=badge,
    )


def _badge(heaviest: Trials) -> Badge | None:
    """Pose by pose under the heaviest weight, without own weight: the best of Eq. (6) and (7)."""
    names = [f"{NAMES[method]}, {LIGHT}" for method in heaviest["method"]]
    pose = [" ".join(map(str, both)) for both in zip(heaviest["seed"], heaviest["pose"], strict=True)]
    own = heaviest.keep("load_N").add(name=names, seed=pose, error_m=_sizes(heaviest, "error_m"))
    first, *rivals = sorted(set(names), key=lambda name: float(np.sum(own.where(name=name)["error_m"] ** 2)))
    return of_rivals(own, first, rivals, "error_m", "case")


def _statements(heaviest: Trials) -> list[Row]:
    """What the paper says of Eq. (7), pose by pose under the heaviest weight."""
    linear, integrated, joints = (
        _sizes(heaviest.where(method=name), "error_m") for name in ("linear", "integrated", "joints")
    )
    return [
        comparison(claim, int((a < b).sum()), int((a > b).sum()), len(a))
        for claim, a, b in (
            ("Eq. (7) from no load to the whole is nearer the truth than Eq. (6)", integrated, linear),
            ("Eq. (6) errs less than Joints-only (not in the paper)", linear, joints),
        )
    ]


def _sizes(own: Trials, name: str) -> Array:
    """Lengths of vectors, (rows,) [m]."""
    return np.asarray(np.linalg.norm(own[name].tolist(), axis=1))


def _errors(own: Trials) -> Row:
    """Errors of one load, truth and method over all poses."""
    error, moved = _sizes(own, "error_m"), _sizes(own, "deflection_m")
    rms, deflection = (float(np.sqrt(np.mean(size**2))) for size in (error, moved))
    return Row(
        deflection_rms_mm=MM * deflection,
        rms_um=UM * rms,
        max_um=UM * error.max(),
        rms_percent=100 * rms / deflection,
    )


def _figures(found: Report) -> dict[str, Figure]:
    """Draw the RMS error of Eq. (6) and (7) against the load: with the arm's own weight dashed."""
    f = Row(found.numbers)
    rows = [Row(row, rms_um=max(row.rms_um, ROUNDING_UM)) for row in f.rows]
    return {
        "loaded_stiffness.png": sweeps(
            {"": Table(BY_LOAD, rows, looks=LOOKS)},
            f"{f.arm}: errors of the tool's deflection under a hung weight",
            f"RMS over {f.poses} poses, from the true compliances; dashed: with the arm's own weight. "
            f"At {ROUNDING_UM:g} um and below: exact to rounding.",
        )
    }


def _write(run: Run[LoadedStiffnessSettings]) -> None:
    """Write errors.csv of the first seed: a line for each pose, load, truth and method.

    Vectors are in world axes; the error is predicted minus true.
    """
    arm, first = load_arm(find_arm(run.settings.arm)), run.first
    loads = {load: k for k, load in enumerate(first.values("load_N"))}
    vectors = [f"{what}_{x}_m" for what in ("deflection", "error") for x in "xyz"]
    joints = [f"{joint.name}_rad" for joint in arm.joints]
    with (run.folder / "errors.csv").open("w", encoding="utf-8", newline="") as text:
        out = csv.writer(text, lineterminator="\n")
        out.writerow(["run", "pose", *joints, "load_N", "truth", "method", *vectors, "error_m"])
        keys = ("pose", "q_rad", "load_N", "truth", "method", "deflection_m", "error_m")
        for pose, q, load, truth, method, moved, error in zip(
            *(first[key].tolist() for key in keys), strict=True
        ):
            case = (loads[load] * run.settings.poses + pose, pose, *q, load, truth, method)
            out.writerow([*case, *moved, *error, math.hypot(*error)])


STUDY = Study(
    name="loaded_stiffness",
    about="Hang weights on the arm over its whole workspace; compare Eq. (6) and (7) with the truth.",
    options=LoadedStiffnessOptions,
    settings=_settings,
    seeds=(1, 10_000),
    row=PoseRow,
    trial=_trial,
    report=_report,
    printed=("by_load",),
    figures=_figures,
    write=_write,
    data="errors.csv",
)
