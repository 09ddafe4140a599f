"""Which poses to measure, and what they pay: plans by every criterion against random poses, simulated."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.pose_selection import figure, plans, recording, settings, summary, tables, trial
from testbench.studies.pose_selection.rows import Row
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=settings.NAME,
    about="Plan 4 to 40 poses by six criteria, measure them, identify, and judge where the robot works.",
    folder=Path(__file__).parent,
    options=settings.Options,
    settings=settings.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(asked.arm)],
    row=Row,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("criteria",),
    figures={"curves.png": figure.curves, "featured.png": figure.featured},
    write=recording.write,
    prepare=plans.prepare,
)
