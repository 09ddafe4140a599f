"""What a corrected robot removes: identified, compensated, executed on the true elastic arm, measured."""

from testbench.arm.catalogue import find_arm
from testbench.studies.compensation import plans, report, settings, trial
from testbench.studies.study import Study

STUDY = Study(
    name=settings.NAME,
    about="Correct a drilling pattern and a milling path by identified models; judge them on the true arm.",
    options=settings.Options,
    settings=settings.settings,
    seeds=(100, 6),
    arms=lambda asked: [find_arm(asked.arm)],
    row=settings.JobRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
    prepare=plans.prepare,
)
