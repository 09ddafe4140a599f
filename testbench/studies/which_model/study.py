"""Which method an engineer should use by default, whatever the true arm and the prior are."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.study import TypedStudy
from testbench.studies.which_model import figure, recording, rows, summary, tables, trial

STUDY = TypedStudy(
    name=trial.NAME,
    about="Identify a family of true arms with every method, from few and many poses and with wrong priors.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(102, 6),
    arms=lambda asked: [find_arm(asked.arm)],
    row=rows.FitRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("family_short",),
    figures={"which_model.png": figure.methods},
    write=recording.write,
)
