"""Which poses to measure, and what they pay: plans by every criterion against random poses, simulated."""

from testbench.arm.catalogue import find_arm
from testbench.studies.pose_selection import plans, report, settings, trial
from testbench.studies.study import Study

STUDY = Study(
    name=settings.NAME,
    about="Plan 4 to 40 poses by six criteria, measure them, identify, and judge where the robot works.",
    options=settings.Options,
    settings=settings.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.Row,
    trials=trial.trials,
    report=report.report,
    printed=("criteria",),
    figures=report.figures,
    write=report.write,
    prepare=plans.prepare,
)
