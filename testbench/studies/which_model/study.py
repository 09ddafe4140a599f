"""Which method an engineer should use by default, whatever the true arm and the prior are."""

from testbench.arm.catalogue import find_arm
from testbench.studies.study import Study
from testbench.studies.which_model import report, trial

STUDY = Study(
    name="which_model",
    about="Identify a family of true arms with every method, from few and many poses and with wrong priors.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(102, 6),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.FitRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
)
