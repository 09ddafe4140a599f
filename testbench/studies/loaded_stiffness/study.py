"""Eq. (7): what a linear model loses under load."""

from testbench.arm.catalogue import find_arm
from testbench.studies.loaded_stiffness import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name="loaded_stiffness",
    about="Hang weights on the arm over its whole workspace; compare Eq. (6) and (7) with the truth.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(1, 10_000),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.PoseRow,
    trials=trial.trials,
    report=report.report,
    printed=("by_load",),
    figures=report.figures,
    write=report.write,
    data="errors.csv",
)
