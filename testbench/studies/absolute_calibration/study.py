"""What absolute readings tell of an arm: which errors hide behind which, how many poses, what a mix gains."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.absolute_calibration import figure, recording, rows, settings, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=settings.NAME,
    about="Calibrate simulated arms by absolute readings: what hides, how many poses, what loaded pairs add.",
    folder=Path(__file__).parent,
    options=settings.Options,
    settings=settings.settings,
    seeds=(100, settings.QUICK),
    arms=lambda asked: [find_arm(name) for name in asked.arms],
    row=rows.Row,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("short",),
    figures={"absolute_calibration.png": figure.curves},
    write=recording.write,
)
