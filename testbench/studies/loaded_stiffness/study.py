"""Eq. (7): what a linear model loses under load."""

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm, load_arm
from testbench.campaign.models import JOINTS
from testbench.campaign.rows import MM, UM
from testbench.report import campaigns
from testbench.report.badge import Badge, of_rivals
from testbench.report.columns import ROUNDING_UM, columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials
from testbench.studies.loaded_stiffness import trial
from testbench.studies.loaded_stiffness.trial import Settings
from testbench.studies.study import Run, Study
from testbench.views.colours import GCO, LEAST_SQUARES, NOMINAL, SERIES, Look, look
from testbench.views.figure import Figure, sweeps
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Best, Table, best_of, pivot

NAMES = {
    "linear": "Eq. (6)",
    "secant": "Eq. (7) once",
    "integrated": "Eq. (7) integrated",
    "joints": "joint stiffness only",
}
LIGHT, HEAVY = "weightless", "own weight"
ALONE = look(JOINTS, "none").colour
SHADES = {LIGHT: (LEAST_SQUARES, NOMINAL, GCO, ALONE), HEAVY: (SERIES[6], SERIES[5], SERIES[4], ALONE)}
LOOKS = {
    f"{name}, {truth}": Look(shade, place, prior=truth == HEAVY)
    for truth, shades in SHADES.items()
    for place, (name, shade) in enumerate(zip(NAMES.values(), shades, strict=True))
}
"""Of predictions: dashed and filled with own weight."""
BY_LOAD = columns("prediction load_N rms_um")
Methods = Mapping[str, Row]  #: Errors under the heaviest weight, by method.
READING = Markdown(
    "Eq. (6) is J C_theta J^T w, all at theta = 0. Eq. (7) once takes K_w at theta = 0 as one stiffness for "
    "the whole load. Eq. (7) integrated goes from no load to the whole: equilibrium under load. Errors are "
    "distances at the tool's origin between predicted and true deflection; below 0.001 um they are rounding: "
    "exact. With its own weight the true arm has sagged before the load comes, and every method starts from "
    "the arm that has not. Joint stiffness only: links rigid, joints fitted to these very deflections."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Errors over the poses of all seeds."""
    rows = [
        Row(load_N=load, truth=truth, method=method, prediction=f"{NAMES[method]}, {truth}", **_errors(own))
        for (load, truth, method), own in trials.groups("load_N", "truth", "method")
    ]
    loads = trials.values("load_N")
    f = Row(
        seed=campaigns.seeds_of(seeds),
        arm=find_arm(asked.arm).resolve().name,
        poses=asked.poses * len(seeds),
        loads_N=loads,
        rows=rows,
    )
    light, heavy = (_heaviest(f, truth) for truth in (LIGHT, HEAVY))
    f |= {"best": {LIGHT: _best(light).names, HEAVY: _best(heavy).names}}
    ordered = [row for name in LOOKS for row in rows if row.prediction == name]
    by_load = Table((), ordered, "RMS error of the tool's deflection by hung weight, um")
    return Report(
        scenario=STUDY.name,
        question=say("{arm}: how far off are Eq. (6) and Eq. (7) as the hung weight grows?", f),
        title=say(
            "{arm}, {poses} poses, {n} hung weights of {least:.4g} to {most:.4g} N; true compliances, no "
            "noise; {seeds}",
            f,
            n=len(loads),
            least=loads[0],
            most=loads[-1],
            seeds=counted(len(seeds), "seed") if len(seeds) > 1 else f"seed {seeds[0]}",
        ),
        answer=say(
            "Least error under {load:.4g} N: {best}. The linear model, Eq. (6): {off}; joint stiffness only "
            "{rms_um:.0f} um, {over:ratio} times that.",
            light["joints"],
            load=loads[-1],
            best=_best_told(light),
            off=_off(light["linear"]),
            over=light["joints"].rms_um / light["linear"].rms_um,
        ),
        worst=say(
            "Worst with own weight, which no method knows, under {load_N:.4g} N: Eq. (6) errs "
            "{rms_um:.2f} um RMS, {max_um:.2f} um in the worst pose.",
            heavy["linear"],
        ),
        claims=list(_claims(light, heavy)),
        numbers=f,
        tables={"by_load": replace(pivot(by_load, *BY_LOAD), looks=LOOKS)},
        body=["by_load", READING],
        badge=_badge(trials, loads[-1]),
    )


def _badge(trials: Trials, load: float) -> Badge | None:
    """Pose by pose under the heaviest weight, without own weight: the best of Eq. (6) and (7)."""
    own = trials.where(load_N=load, truth=LIGHT)
    names = [f"{NAMES[method]}, {LIGHT}" for method in own["method"]]
    error = np.linalg.norm(own["error_m"].tolist(), axis=1)
    pose = [" ".join(map(str, both)) for both in zip(own["seed"], own["pose"], strict=True)]
    own = own.keep("load_N").add(name=names, seed=pose, error_m=error)
    first, *rivals = sorted(set(names), key=lambda name: float(np.sum(own.where(name=name)["error_m"] ** 2)))
    return of_rivals(own, first, rivals, "error_m", "case")


def _errors(own: Trials) -> Row:
    """Errors of one load, truth and method over all poses."""
    error, moved = (np.linalg.norm(own[name].tolist(), axis=1) for name in ("error_m", "deflection_m"))
    rms, deflection = (float(np.sqrt(np.mean(size**2))) for size in (error, moved))
    return Row(
        deflection_rms_mm=MM * deflection,
        rms_um=UM * rms,
        max_um=UM * error.max(),
        rms_percent=100 * rms / deflection,
    )


def _heaviest(f: Row, truth: str) -> Methods:
    """Errors under the heaviest weight, by method."""
    return {row.method: row for row in f.rows if (row.truth, row.load_N) == (truth, f.loads_N[-1])}


def _best(own: Methods) -> Best:
    """The methods of least error; what is rounding is alike."""
    return best_of({method: max(row.rms_um, ROUNDING_UM) for method, row in own.items()})


def _best_told(own: Methods) -> Markdown:
    best = _best(own)
    words = Best(tuple(NAMES[method] for method in best.names), best.value).words
    return say("{words}, {off}", words=words, off=_off(own[best.names[0]]))


def _claims(light: Methods, heavy: Methods) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield say(
        "An arm that sags under its own weight, which no method knows: least error by {best}. Eq. (6): "
        "{linear}.",
        best=_best_told(heavy),
        linear=_off(heavy["linear"]),
    )
    yield say(
        "Rigid links cost {how} than neglecting the load: joint stiffness alone, fitted to these very "
        "deflections, leaves {rms_percent:.1f} % of the deflection, with own weight {sagging:.1f} %.",
        light["joints"],
        how="more" if light["joints"].rms_um > light["linear"].rms_um else "less",
        sagging=heavy["joints"].rms_percent,
    )


def _off(row: Row) -> Markdown:
    if row.rms_um < ROUNDING_UM:
        return Markdown("exact to rounding")
    return say("{rms_um:.2f} um RMS, {rms_percent:.2f} % of the deflection", row)


def figures(found: Report) -> dict[str, Figure]:
    """RMS error of Eq. (6) and (7) against the load: weightless solid, with the arm's own weight dashed."""
    f = Row(found.numbers)
    rows = [Row(row, rms_um=max(row.rms_um, ROUNDING_UM)) for row in f.rows]
    light = _heaviest(f, LIGHT)
    words = ", ".join(say("{name} {off}", name=NAMES[m], off=_off(row)) for m, row in light.items())
    return {
        "loaded_stiffness.png": sweeps(
            {"": Table(BY_LOAD, rows, looks=LOOKS)},
            say("{arm} without own weight under {load:.4g} N: {words}", f, load=f.loads_N[-1], words=words),
            f"RMS of the tool's error over {f.poses} poses, from the true compliances; dashed: with the "
            f"arm's own weight. At {ROUNDING_UM:g} um and below: exact to rounding.",
        )
    }


def write(run: Run[Settings]) -> None:
    """errors.csv of the first seed: a line for each pose, load, truth and method.

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
    options=trial.Options,
    settings=trial.settings,
    seeds=(1, 10_000),
    row=trial.PoseRow,
    trials=trial.trials,
    report=report,
    printed=("by_load",),
    figures=figures,
    write=write,
    data="errors.csv",
)
