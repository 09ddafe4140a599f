"""What a corrected robot removes: identified, compensated, executed on the true elastic arm, measured."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.compensation import figure, plans, recording, rows, settings, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=settings.NAME,
    about="Correct a drilling pattern and a milling path by identified models; judge them on the true arm.",
    folder=Path(__file__).parent,
    options=settings.Options,
    settings=settings.settings,
    seeds=(100, 6),
    arms=lambda asked: [find_arm(asked.arm)],
    row=rows.Row,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("short",),
    figures={"compensation.png": figure.removed},
    write=recording.write,
    prepare=plans.prepare,
)
