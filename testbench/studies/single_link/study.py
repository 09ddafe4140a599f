"""Section 5.1: one link, least squares with 36 free entries against GCO."""

from testbench.arm.catalogue import find_arm
from testbench.studies.single_link import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name=trial.NAME,
    about="Identify the single link of section 5.1 by least squares and by GCO, over many draws of noise.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 100),
    arms=lambda _: [find_arm(trial.NAME)],
    row=trial.LinkRow,
    trials=trial.trials,
    report=report.report,
    printed=("errors", "shape"),
    figures=report.figures,
    write=report.write,
    size=10,
)
