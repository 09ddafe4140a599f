"""What noise costs, by method and structure, and what better instruments are worth."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.noise_sensitivity import figure, recording, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Identify from readings of ever more noise, and judge by the true deflections.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 4),
    arms=lambda _: [find_arm(trial.LIGHT), find_arm(trial.HEAVY)],
    row=trial.NoiseRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("gravity_short", "six_dof_short"),
    figures={"noise_sensitivity.png": figure.sensitivity},
    write=recording.write,
)
