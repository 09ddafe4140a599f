"""A real UR10: what explains its readings, and what foretells those that were never fitted."""

from testbench.arm.catalogue import find_arm
from testbench.studies.real_ur10 import drawn, report, trial
from testbench.studies.study import Study

STUDY = Study(
    name="real_ur10",
    about="Public readings of a UR10: geometry, springs, links and joint errors, series against series.",
    options=trial.Flags,
    settings=trial.settings,
    seeds=(20, 1),
    arms=lambda _: [find_arm(trial.ARM)],
    row=trial.FitRow,
    trials=trial.trials,
    report=report.report,
    printed=("models",),
    figures=report.figures,
    write=drawn.write,
    data="errors.csv",
)
