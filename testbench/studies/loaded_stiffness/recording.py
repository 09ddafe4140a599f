"""What the study of Eq. (7) leaves beside its report: every error of the first seed, and a recording."""

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.arm.folder import Arm, load_arm
from testbench.studies.loaded_stiffness.summary import MEDIAN, NAMES, P05, P95, LoadedReport
from testbench.studies.loaded_stiffness.trial import Method, PoseRow, Settings, Truth, trials
from testbench.studies.study import Run
from testbench.trials.spread import Spread
from testbench.views.colours import GCO, LEAST_SQUARES, SERIES, Colour, Look
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Column

COLOURS: dict[Method, tuple[Colour, Colour]] = {
    "linear": (LEAST_SQUARES, SERIES[6]),
    "secant": (SERIES[1], SERIES[5]),
    "integrated": (GCO, SERIES[4]),
}
"""Of the weightless arm, and of the one with its own weight."""
TRUTHS: tuple[Truth, ...] = ("weightless", "own weight")


def write(run: Run[Settings, LoadedReport]) -> None:
    """errors.csv and recording.rrd."""
    [rows] = trials(run.settings, run.seeds[:1])
    write_errors(run.folder / "errors.csv", load_arm(find_arm(run.settings.arm)), rows)
    write_recording(run)


def write_recording(run: Run[Settings, LoadedReport]) -> None:
    """Error of Eq. (6) and (7) against the hung weight; what is exact is no line worth looking at."""
    points: list[Point] = []
    looks: dict[str, Look] = {}
    for shade, truth in enumerate(TRUTHS):
        for method, name in NAMES.items():
            line, own = run.report.line(truth, method), f"{name}, {truth}"
            if not all(row.exact for row in line):
                looks[own] = Look(COLOURS[method][shade], len(looks), prior=False)
                points += [Point(row.load_N, own, error(row)) for row in line]
    y = replace(MEDIAN, heading="error of the tool's deflection")
    sagged = [name for name in looks if name.endswith(TRUTHS[1])]
    linear = [name for name in sagged if name.startswith(NAMES["linear"])]
    sweep = Sweep(Column("load_N", "load", "N"), y, points, looks, against=linear, among=sagged)
    header = Header(run.report.scenario, run.parameters, run.seeds[0])
    write_sweep(run.folder / "recording.rrd", header, sweep, run.words.summary(sweep.words.block("medians")))


def error(row: object) -> Spread:
    """Of the tool's deflection over the poses, in the unit of its columns."""
    return Spread(MEDIAN.value(row), P05.value(row), P95.value(row))


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
