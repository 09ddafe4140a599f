"""The paper's own optimiser of Eq. (19) against local solves and a conic program with a certificate."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.solver_comparison import figure, recording, rows, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Minimise F_M by several solvers on the data of section 5.2, and certify what each of them found.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(20, 2),
    arms=lambda _: [find_arm(trial.ARM)],
    row=rows.TrialRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("short",),
    figures={"solver_comparison.png": figure.solver_comparison},
    write=recording.write,
)
