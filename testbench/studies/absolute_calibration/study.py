"""What absolute readings tell of an arm: which errors hide behind which, how many poses, what a mix gains."""

from testbench.arm.catalogue import find_arm
from testbench.studies.absolute_calibration import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name=trial.NAME,
    about="Calibrate simulated arms by absolute readings: what hides, how many poses, what loaded pairs add.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, trial.QUICK),
    arms=lambda asked: [find_arm(name) for name in asked.arms],
    row=trial.FitRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
)
