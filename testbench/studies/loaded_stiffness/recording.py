"""What the study of Eq. (7) leaves beside its report: every error of the first seed, and a recording."""

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path

from testbench.arm.folder import Arm, load_arm
from testbench.arm.library import find_arm
from testbench.studies.loaded_stiffness.summary import MEDIAN, NAMES, P05, P95, LoadedReport
from testbench.studies.loaded_stiffness.trial import Method, PoseRow, Settings, Truth, trials
from testbench.studies.study import Run
from testbench.views.colours import GREENS, LOAD, ORANGES, Colour
from testbench.views.recording import Point, Sweep, write_sweep

COLOURS: dict[Method, tuple[Colour, Colour]] = {
    "linear": (ORANGES[0], ORANGES[1]),
    "secant": (LOAD, (150, 80, 120)),
    "integrated": (GREENS[0], GREENS[1]),
}
"""Of the weightless arm, and of the one with its own weight."""
TRUTHS: dict[Truth, str] = {"weightless": "weightless", "own weight": "sagged"}
"""In a word."""


def write(run: Run[Settings, LoadedReport]) -> None:
    """errors.csv and recording.rrd."""
    [rows] = trials(run.settings, run.seeds[:1])
    write_errors(run.folder / "errors.csv", load_arm(find_arm(run.settings.arm)), rows)
    write_sweep(run.folder / "recording.rrd", sweep(run))


def sweep(run: Run[Settings, LoadedReport]) -> Sweep:
    """Error of Eq. (6) and (7) against the hung weight; what is exact is no line worth looking at."""
    report, words = run.report, run.words
    cases = {
        f"{NAMES[method]}, {whose}": (report.line(truth, method), COLOURS[method][shade])
        for shade, (truth, whose) in enumerate(TRUTHS.items())
        for method in NAMES
    }
    drawn = {name: case for name, case in cases.items() if not all(row.exact for row in case[0])}
    return Sweep(
        scenario=report.scenario,
        parameters=json.loads(run.parameters),
        seed=run.seeds[0],
        question=words.block("question"),
        answer=words.block("answer"),
        swept="load",
        swept_unit="N",
        measured="error of the tool's deflection",
        unit=MEDIAN.unit,
        points=[
            Point(row.load_N, name, MEDIAN.value(row), P05.value(row), P95.value(row))
            for name, (line, _) in drawn.items()
            for row in line
        ],
        colours={name: colour for name, (_, colour) in drawn.items()},
        remarks=words.block("statements"),
    )


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
