"""What the solver comparison leaves beside its report: dataset and recording of the first seed."""

import numpy as np

from testbench.arm.library import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.full_pose import simulate
from testbench.data.csvfile import write_csv
from testbench.studies.solver_comparison.looks import COLOURS
from testbench.studies.solver_comparison.summary import COLUMNS, SolverComparisonReport
from testbench.studies.solver_comparison.trial import ARM, Settings
from testbench.studies.study import Run
from testbench.trials.spread import ends, middle
from testbench.views.markdown import grid
from testbench.views.recording import write_solver
from testbench.views.recording.chart import Dot
from testbench.views.recording.solver import TIMELINE, Race

TIMES = ("seconds_to_1_percent", "seconds")
LEAST = 1e-12
"""A time below is drawn here [s]: the axis is logarithmic."""


def write(run: Run[Settings, SolverComparisonReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(ARM))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.identification, tuple(j.name for j in cell.arm.joints), run.folder / "dataset.csv")
    write_solver(run.folder / "recording.rrd", race(run))


def race(run: Run[Settings, SolverComparisonReport]) -> Race:
    """Words and numbers of the recording."""
    report, words = run.report, run.words
    parts = [
        f"### {words.block('question')}",
        f"#### **{words.block('answer')}**",
        grid(run.tables["recorded"]),
        "\n".join(f"- {row.title}" for row in report.solvers),
        f"Medians of {len(report.seed)} seeds; ways and gap are those of seed {report.convergence.seed}. "
        "Gap: F_M over its proven lower bound, minus 1.",
        "**Colours** Green: the conic program (d). The other solvers have a colour of their own.",
        f"**Scrub** `{TIMELINE}` counts the improvements of F_M of every solver (tab Iterations).",
    ]
    return Race(
        scenario=report.scenario,
        parameters=run.parameters,
        seed=report.convergence.seed,
        summary="\n\n".join(parts),
        notes="\n\n".join([words.block("statements"), grid(run.tables["minima"])]),
        ways={key: np.array(way) for key, way in report.convergence.points.items()},
        colours=COLOURS,
        bold="d",
        times=time_dots(report),
    )


def time_dots(report: SolverComparisonReport) -> list[Dot]:
    """Time to within 1 % of the optimum, then to the end, with their spread over seeds."""
    dots = []
    for column in (c for c in COLUMNS if c.key in TIMES):
        for row in report.solvers:
            value = column.value(row)
            if value is not None:
                low, mid, high = (max(x, LEAST) for x in (ends(value)[0], middle(value), ends(value)[1]))
                text = f"{column.cell(row)} {column.unit}"
                dots.append(Dot(f"{column.heading}: ({row.key})", low, mid, high, COLOURS[row.key], text))
    return dots
