"""Section 5.1: one link, least squares with 36 free entries against GCO."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.single_link import figure, recording, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Identify the single link of section 5.1 by least squares and by GCO, over many draws of noise.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 100),
    arms=lambda _: [find_arm(trial.NAME)],
    row=trial.LinkRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("errors", "shape"),
    figures={"single_link.png": figure.single_link},
    write=recording.write,
    size=10,
)
