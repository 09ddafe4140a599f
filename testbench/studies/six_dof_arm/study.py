"""Section 5.2: the illustrative 6R arm, full poses under single-axis loads, LS against GCO, the order m."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.six_dof_arm import figure, recording, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Identify the models of Table I and two baselines from 108 runs, and check them on 120 others.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 5),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.SixDofRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("short", "short_nonlinear"),
    figures={"six_dof_arm.png": figure.six_dof_arm, "error_map.png": figure.places},
    write=recording.write,
)
