"""What the solver comparison leaves beside its report: dataset and recording of the first seed."""

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.full_pose import simulate
from testbench.data.csvfile import write_csv
from testbench.studies.solver_comparison.looks import COLOURS
from testbench.studies.solver_comparison.report import SolverComparisonReport
from testbench.studies.solver_comparison.tables import COLUMNS
from testbench.studies.solver_comparison.trial import ARM, Settings
from testbench.studies.study import Run
from testbench.views.markdown import grid
from testbench.views.recording.chart import dots
from testbench.views.recording.solver import TIMELINE, Race, write_solver
from testbench.views.recording.stream import Header
from testbench.views.schema import Column, Table

TIMES = ("seconds_to_1_percent", "seconds")


def write(run: Run[Settings, SolverComparisonReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(ARM))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.identification, cell.arm, run.folder / "dataset.csv")
    header = Header(run.report.scenario, run.parameters, run.report.convergence.seed)
    write_solver(run.folder / "recording.rrd", header, race(run))


def race(run: Run[Settings, SolverComparisonReport]) -> Race:
    """Words and numbers of the recording; times to within 1 % of the optimum, then to the end."""
    report, words = run.report, run.words
    summary = words.summary(
        run.tables["recorded"],
        "\n".join(f"- {row.title}" for row in report.solvers),
        f"Medians of {len(report.seed)} seeds; ways and gap are those of seed {report.convergence.seed}. "
        "Gap: F_M over its proven lower bound, minus 1.",
        "**Colours** Green: the conic program (d). The other solvers have a colour of their own.",
        f"**Scrub** `{TIMELINE}` counts the improvements of F_M of every solver (tab Iterations).",
        then=(),
    )
    columns = (Column("name", "solver"), *(c for c in COLUMNS if c.key in TIMES))
    times = Table(columns, [vars(row) | {"name": f"({row.key})"} for row in report.solvers])
    return Race(
        summary=summary,
        notes="\n\n".join([words.block("statements"), grid(run.tables["minima"])]),
        ways={key: np.array(way) for key, way in report.convergence.points.items()},
        colours=COLOURS,
        bold="d",
        times=dots(times, [COLOURS[row.key] for row in report.solvers]),
    )
