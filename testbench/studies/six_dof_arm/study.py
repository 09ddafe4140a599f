"""Section 5.2: the illustrative 6R arm, full poses under single-axis loads, LS against GCO, the order m."""

from testbench.arm.catalogue import find_arm
from testbench.studies.six_dof_arm import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name="six_dof_arm",
    about="Identify the models of Table I and two baselines from 108 runs, and check them on 120 others.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 5),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.SixDofRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
)
