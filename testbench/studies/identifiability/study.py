"""What the data cannot see, and what a prior is worth."""

from testbench.arm.catalogue import find_arm
from testbench.studies.identifiability import report, trial
from testbench.studies.identifiability.fits import TrialRow
from testbench.studies.study import Study

STUDY = Study(
    name="identifiability",
    about="Identify with and without a prior, and judge in 200 poses that were never measured.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 10),
    arms=lambda asked: [find_arm(asked.arm), find_arm(trial.SIX_DOF)],
    row=TrialRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
    size=2,
)
