"""What a real arm's vices cost a model that does not know them."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.model_error import figure, recording, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Identify an arm that does what the model does not know, with noise and without.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.CaseRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("calm_short", "noisy_short"),
    figures={"model_error.png": figure.disturbances},
    write=recording.write,
    size=2,
)
