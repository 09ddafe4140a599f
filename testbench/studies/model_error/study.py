"""What a real arm's vices cost a model that does not know them."""

from testbench.arm.catalogue import find_arm
from testbench.studies.model_error import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name=trial.NAME,
    about="Identify an arm that does what the model does not know, with noise and without.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.CaseRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
    size=2,
)
