"""What the trials say: errors by load, truth and method over all poses, and which method is best."""

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.arm.folder import load_arm
from testbench.campaign.rows import MM, UM
from testbench.errors import Array
from testbench.report.columns import ROUNDING_UM, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials
from testbench.studies.loaded_stiffness.trial import Settings
from testbench.studies.study import Run
from testbench.views.colours import GCO, LEAST_SQUARES, NOMINAL, SERIES, Look
from testbench.views.figure import Figure, sweeps
from testbench.views.markdown import Markdown
from testbench.views.schema import Best, Table, best_of, pivot

NAMES = {"linear": "Eq. (6)", "secant": "Eq. (7) once", "integrated": "Eq. (7) integrated"}
LIGHT, HEAVY = "weightless", "own weight"
SHADES = {LIGHT: (LEAST_SQUARES, NOMINAL, GCO), HEAVY: (SERIES[6], SERIES[5], SERIES[4])}
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
    "the arm that has not."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Errors over the poses of all seeds."""
    rows = [
        Row(load_N=load, truth=truth, method=method, prediction=f"{NAMES[method]}, {truth}", **_errors(own))
        for (load, truth, method), own in trials.groups("load_N", "truth", "method")
    ]
    loads = trials.values("load_N")
    light, heavy = (
        {r.method: r for r in rows if (r.truth, r.load_N) == (truth, loads[-1])} for truth in (LIGHT, HEAVY)
    )
    under = trials.where(load_N=loads[-1], method="linear")
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=find_arm(asked.arm).resolve().name,
        poses=asked.poses * len(seeds),
        loads_N=loads,
        rows=rows,
        joints=[_joints(under.where(truth=own["linear"].truth), own["linear"]) for own in (light, heavy)],
        best={
            own["linear"].truth: best_of({m: max(row.rms_um, ROUNDING_UM) for m, row in own.items()}).names
            for own in (light, heavy)
        },
    )
    ordered = [row for name in LOOKS for row in rows if row.prediction == name]
    by_load = Table((), ordered, "RMS error of the tool's deflection by hung weight, um")
    seeds_told = f"{len(seeds)} seeds" if len(seeds) > 1 else f"seed {seeds[0]}"
    return Report(
        scenario="loaded_stiffness",
        question=say("{arm}: how far off are Eq. (6) and Eq. (7) as the hung weight grows?", f),
        title=say(
            "{arm}, {poses} poses, {n} hung weights of {least:.4g} to {most:.4g} N; true compliances, no "
            f"noise; {seeds_told}",
            f | {"n": len(loads), "least": loads[0], "most": loads[-1]},
        ),
        answer=lines(_answer(f, light)),
        worst=say(
            "Worst with own weight, which no method knows, under {load_N:.4g} N: Eq. (6) errs "
            "{rms_um:.2f} um RMS, {max_um:.2f} um in the worst pose.",
            heavy["linear"],
        ),
        claims=list(_claims(f, heavy)),
        numbers=f,
        tables={"by_load": replace(pivot(by_load, *BY_LOAD), looks=LOOKS)},
        body=["by_load", READING],
    )


def _errors(own: Trials) -> Row:
    """Errors of one load, truth and method over all poses."""
    error, moved = (np.linalg.norm(own[name].tolist(), axis=1) for name in ("error_m", "deflection_m"))
    rms, deflection = _rms(error), _rms(moved)
    return Row(
        deflection_rms_mm=MM * deflection,
        rms_um=UM * rms,
        max_um=UM * error.max(),
        rms_percent=100 * rms / deflection,
    )


def _joints(own: Trials, linear: Row) -> Row:
    """What joint stiffness alone leaves of the same deflections, fitted to them without noise."""
    rms_um = UM * _rms(own["joints_error_m"])
    share = 100 * rms_um / (UM / MM * linear.deflection_rms_mm)
    return Row(truth=linear.truth, rms_um=rms_um, rms_percent=share, over_linear=rms_um / linear.rms_um)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _answer(f: Row, light: Methods) -> Iterator[str]:
    """The best of the weightless arm, then the linear model and joint stiffness alone."""
    yield say("Least error under {load:.4g} N: {best}, {off}.", load=f.loads_N[-1], **_best(f, LIGHT, light))
    yield say(
        "The linear model, Eq. (6): {off}; joint stiffness only {rms_um:.0f} um, {over_linear:ratio} times "
        "that.",
        f.joints[0],
        off=_off(light["linear"]),
    )


def _claims(f: Row, heavy: Methods) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield say(
        "An arm that sags under its own weight, which no method knows: least error by {best}, {off}. "
        "Eq. (6): {linear}.",
        linear=_off(heavy["linear"]),
        **_best(f, HEAVY, heavy),
    )
    weightless, sagging = f.joints
    yield say(
        "Rigid links cost {how} than neglecting the load: joint stiffness alone, fitted to these very "
        "deflections, leaves {rms_percent:.1f} % of the deflection, with own weight {sagging:.1f} %.",
        weightless,
        how="more" if weightless.over_linear > 1 else "less",
        sagging=sagging.rms_percent,
    )


def _best(f: Row, truth: str, own: Methods) -> dict[str, str]:
    """The methods of least error, and how far off they are."""
    methods = f.best[truth]
    return {"best": Best(tuple(NAMES[m] for m in methods), 0.0).words, "off": _off(own[methods[0]])}


def _off(row: Row) -> Markdown:
    if row.rms_um < ROUNDING_UM:
        return Markdown("exact to rounding")
    return say("{rms_um:.2f} um RMS, {rms_percent:.2f} % of the deflection", row)


def figures(found: Report) -> dict[str, Figure]:
    """RMS error of Eq. (6) and (7) against the load: weightless solid, with the arm's own weight dashed."""
    f = Row(found.numbers)
    exact = [name for name in LOOKS if all(r.rms_um < ROUNDING_UM for r in f.rows if r.prediction == name)]
    light = {r.method: r for r in f.rows if (r.load_N, r.truth) == (f.loads_N[-1], LIGHT)}
    words = ", ".join(say("{name} {off}", name=NAMES[m], off=_off(row)) for m, row in light.items())
    return {
        "loaded_stiffness.png": sweeps(
            {"": Table(BY_LOAD, [row for row in f.rows if row.prediction not in exact], looks=LOOKS)},
            say("{arm} without weight under {load:.4g} N: {words}", f, load=f.loads_N[-1], words=words),
            f"RMS of the tool's error over {f.poses} poses, from the true compliances; dashed: with the "
            "arm's own weight." + f" Exact to rounding, not drawn: {'; '.join(exact)}." * bool(exact),
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
