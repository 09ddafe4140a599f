"""What the trials say: errors by load, truth and method over all poses, and which method is best."""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.arm.folder import Arm, load_arm
from testbench.bench.rows import MM, UM
from testbench.errors import Array
from testbench.report.columns import ROUNDING_UM, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials
from testbench.studies.loaded_stiffness.trial import PoseRow, Settings, trials
from testbench.studies.study import Run
from testbench.trials.spread import spread
from testbench.views.colours import GCO, LEAST_SQUARES, NOMINAL, SERIES, Look
from testbench.views.figure import Figure, over
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
BY_LOAD = "prediction load_N rms_um"
ROWS = (
    "prediction load_N deflection_rms_mm rms_um vertical_rms_um error_um max_um rms_percent error_percent "
    "max_percent"
)
Methods = Mapping[str, Row]  #: Errors under the heaviest weight, by method.
OF_METHODS = Markdown(
    "Eq. (6) is J C_theta J^T w, all at theta = 0. Eq. (7) once takes K_w at theta = 0 as one stiffness for "
    "the whole load. Eq. (7) integrated goes from no load to the whole: equilibrium under load. An error "
    "below 0.001 um is rounding: exact."
)
READING = Markdown(
    "Errors are distances at the tool's origin between predicted and true deflection: median, and 5 to 95 % "
    "of the poses. A percentage of one pose is of its own deflection; that of the RMS error is of the RMS "
    "deflection.\n\n"
    "With true compliances the weightless arm differs from a method by the method's own mathematics alone. "
    "With its own weight the true arm has sagged before the load comes, and every method starts from the arm "
    "that has not.\n\n"
    "Along the force, at its own point, the true deflection exceeds the linear one by 1.5 a in second order, "
    "with a = theta^T K_w theta. Eq. (7) with K_w at no load adds 1.0 a and leaves a third of the linear "
    "error there. Across the force its correction is not that of the true arm, and the distance error falls "
    "by less: compare the vertical RMS error with the RMS error."
)
OF_TANGENT = Markdown(
    "Compliance at the load's point, 3 x 3 against forces: Eq. (7) at the equilibrium against central "
    "differences of the true weightless arm. The difference is the largest over all poses, relative in the "
    "Frobenius norm; 1 ppm is a millionth. What is left is the tolerance of the true equilibria."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Errors over the poses of all seeds."""
    rows = [
        Row(load_N=load, truth=truth, method=method, prediction=f"{NAMES[method]}, {truth}", **_errors(own))
        for (load, truth, method), own in trials.groups("load_N", "truth", "method")
    ]
    loads = trials.values("load_N")
    heaviest = {
        truth: {r.method: r for r in rows if (r.truth, r.load_N) == (truth, loads[-1])}
        for truth in (LIGHT, HEAVY)
    }
    under = trials.where(load_N=loads[-1], method="linear")
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=find_arm(asked.arm).resolve().name,
        poses=asked.poses * len(seeds),
        loads_N=loads,
        rows=rows,
        tangent=[
            Row(load_N=load, tangent_difference_ppm=1e6 * own["tangent_difference"].max())
            for (load,), own in trials.groups("load_N")
        ],
        joints=[_joints(under.where(truth=truth), own["linear"]) for truth, own in heaviest.items()],
        best={
            truth: best_of({method: max(row.rms_um, ROUNDING_UM) for method, row in own.items()}).names
            for truth, own in heaviest.items()
        },
    )
    ordered = [row for name in LOOKS for row in rows if row.prediction == name]
    by_load = Table((), ordered, "RMS error of the tool's deflection by hung weight, um")
    tables = {
        "by_load": replace(pivot(by_load, *columns(BY_LOAD)), looks=LOOKS),
        "rows": Table(columns(ROWS), ordered, "Every number"),
        "tangent": Table(columns("load_N tangent_difference_ppm"), f.tangent, "The tangent under load"),
    }
    light, heavy = heaviest.values()
    return Report(
        scenario="loaded_stiffness",
        question=say("{arm}: how far off are Eq. (6) and Eq. (7) as the hung weight grows?", f),
        title=_title(f),
        answer=lines(_answer(f, light)),
        worst=say(
            "Worst with own weight, which no method knows, under {load_N:.4g} N: Eq. (6) errs "
            "{rms_um:.2f} um RMS, {max_um:.2f} um in the worst pose.",
            heavy["linear"],
        ),
        claims=list(_claims(f, light, heavy)),
        numbers=f,
        tables=tables,
        body=["by_load", OF_METHODS, "rows", READING, "tangent", OF_TANGENT],
    )


def _errors(own: Trials) -> Row:
    """Errors of one load, truth and method, in micrometres and as a share of each pose's deflection."""
    error, moved = (np.array(own[name].tolist()) for name in ("error_m", "deflection_m"))
    distance, size = np.linalg.norm(error, axis=1), np.linalg.norm(moved, axis=1)
    share = 100 * distance / size
    return Row(
        deflection_rms_mm=MM * _rms(size),
        rms_um=UM * _rms(distance),
        vertical_rms_um=UM * _rms(error[:, 2]),
        error_um=spread(UM * distance),
        max_um=UM * distance.max(),
        rms_percent=100 * _rms(distance) / _rms(size),
        error_percent=spread(share),
        max_percent=share.max(),
    )


def _joints(own: Trials, linear: Row) -> Row:
    """What joint stiffness alone leaves of the same deflections, fitted to them without noise."""
    rms_um = UM * _rms(own["joints_error_m"])
    share = 100 * rms_um / (UM / MM * linear.deflection_rms_mm)
    return Row(truth=linear.truth, rms_um=rms_um, rms_percent=share, over_linear=rms_um / linear.rms_um)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _title(f: Row) -> Markdown:
    """What was simulated."""
    seeds = f"{len(f.seed)} seeds" if isinstance(f.seed, list) else f"seed {f.seed}"
    return say(
        "{arm}, {poses} poses, {n} hung weights of {least:.4g} to {most:.4g} N; true compliances, no noise; "
        f"{seeds}",
        f,
        n=len(f.loads_N),
        least=f.loads_N[0],
        most=f.loads_N[-1],
    )


def _answer(f: Row, light: Methods) -> Iterator[str]:
    """The best of the weightless arm, then the linear model and joint stiffness alone."""
    yield say("Least error under {load:.4g} N: {best}, {off}.", load=f.loads_N[-1], **_best(f, LIGHT, light))
    yield say(
        "The linear model, Eq. (6): {off}; joints alone {rms_um:.0f} um, {over_linear:ratio} times that.",
        f.joints[0],
        off=_off(light["linear"]),
    )


def _claims(f: Row, light: Methods, heavy: Methods) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield say("Eq. (7) with K_w at no load, taken once for the whole load: {off}.", off=_off(light["secant"]))
    yield say(
        "An arm that sags under its own weight, which no method knows: least error by {best}, {off}. "
        "Eq. (6): {linear}.",
        linear=_off(heavy["linear"]),
        **_best(f, HEAVY, heavy),
    )
    weightless, sagging = f.joints
    yield say(
        "Rigid links cost {how} than neglecting the load: joint stiffness alone, fitted to these very "
        "deflections, leaves {over_linear:.3g} times the error of Eq. (6). That is {rms_percent:.1f} % of "
        "the deflection, with own weight {sagging:.1f} %.",
        weightless,
        how="more" if weightless.over_linear > 1 else "less",
        sagging=sagging.rms_percent,
    )
    yield say(
        "Under load, the tangent compliance of Eq. (7) is that of the true arm within {ppm:.2g} parts per "
        "million.",
        ppm=max(row.tangent_difference_ppm for row in f.tangent),
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
    f, (load, share) = Row(found.numbers), columns("load_N rms_percent")
    drawn = _drawn(f)
    ends = [row for row in f.rows if (row.load_N, row.truth) == (f.loads_N[-1], LIGHT)]
    words = [f"{NAMES[row.method]} {share.cell(row)}{' %' * (row.rms_um >= ROUNDING_UM)}" for row in ends]
    exact = "; ".join(name for name in LOOKS if name not in drawn)
    return {
        "loaded_stiffness.png": over(
            Table(columns(BY_LOAD), [row for rows in drawn.values() for row in rows], looks=LOOKS),
            f"{f.arm} without weight under {load.text(f.loads_N[-1])} N, error of what it deflects: "
            + ", ".join(words),
            f"RMS of the tool's error over {f.poses} poses, from the true compliances; dashed: with the "
            "arm's own weight." + f" Exact to rounding, not drawn: {exact}." * bool(exact),
        )
    }


def _drawn(f: Row) -> dict[str, list[Row]]:
    """Rows of every prediction that is not exact."""
    every = {name: [row for row in f.rows if row.prediction == name] for name in LOOKS}
    return {name: own for name, own in every.items() if any(row.rms_um >= ROUNDING_UM for row in own)}


def write(run: Run[Settings]) -> None:
    """errors.csv of the first seed."""
    [rows] = trials(run.settings, run.seeds[:1])
    write_errors(run.folder / "errors.csv", load_arm(find_arm(run.settings.arm)), rows)


def write_errors(file: Path, arm: Arm, rows: Sequence[PoseRow]) -> None:
    """A line for each pose, load, truth and method; world axes, error is predicted minus true."""
    names = [f"{joint.name}_rad" for joint in arm.joints]
    vectors = [f"{what}_{x}_m" for what in ("deflection", "error") for x in "xyz"]
    with file.open("w", encoding="utf-8", newline="") as text:
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(["run", "pose", *names, "load_N", "truth", "method", *vectors, "error_m"])
        poses, loads = max(row.pose for row in rows), list(dict.fromkeys(row.load_N for row in rows))
        for row in rows:
            run = loads.index(row.load_N) * poses + row.pose
            case = (run, row.pose, *row.q_rad, row.load_N, row.truth, row.method)
            lines.writerow([*case, *row.deflection_m, *row.error_m, math.hypot(*row.error_m)])
