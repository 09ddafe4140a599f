"""Eq. (7): what a linear model loses under load."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.loaded_stiffness import figure, recording, summary, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Hang weights on the arm over its whole workspace; compare Eq. (6) and (7) with the truth.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(1, 10_000),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.PoseRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=summary.tables,
    printed=("by_load",),
    figures={"loaded_stiffness.png": figure.loaded_stiffness},
    write=recording.write,
    data="errors.csv",
)
