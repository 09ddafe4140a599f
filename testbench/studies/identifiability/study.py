"""What the data cannot see, and what a prior is worth."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.identifiability import figure, recording, summary, tables, trial
from testbench.studies.study import TypedStudy
from testbench.views.identifiability.figure import shares

STUDY = TypedStudy(
    name=trial.NAME,
    about="Identify with and without a prior, and judge in 200 poses that were never measured.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 10),
    arms=lambda asked: [find_arm(asked.arm), find_arm(trial.SIX_DOF)],
    row=trial.TrialRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("short",),
    figures={"identifiability.png": figure.errors, "shares.png": lambda report: shares(report.seen)},
    write=recording.write,
    size=2,
)
