"""The paper's own optimiser of Eq. (19) against local solves and a conic program with a certificate."""

from testbench.arm.catalogue import find_arm
from testbench.studies.solver_comparison import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name="solver_comparison",
    about="Minimise F_M by several solvers on the data of section 5.2, and certify what each of them found.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(20, 2),
    arms=lambda _: [find_arm(trial.ARM)],
    row=trial.TrialRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
)
