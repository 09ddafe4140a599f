"""A real UR10: what explains its readings, and what foretells those that were never fitted."""

from testbench.arm.catalogue import find_arm
from testbench.studies.real_ur10 import recording, report, trained, trial
from testbench.studies.real_ur10.readings import ARM
from testbench.studies.study import Study

STUDY = Study(
    name="real_ur10",
    about="Public readings of a UR10: geometry, springs, links and joint errors, series against series.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(20, 1),
    arms=lambda _: [find_arm(ARM)],
    row=trial.SubsetRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=recording.write,
    data="errors.csv",
    size=4,
    prepare=trained.prepare,
)
