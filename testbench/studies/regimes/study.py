"""Where the cone pays by itself."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.regimes import figure, recording, summary, tables, trial
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=trial.NAME,
    about="Map where GCO beats least squares of the same structure: noise, poses, structure, truth, prior.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(grid.arm) for grid in asked.grids.values()],
    row=trial.CellRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("gravity_short", "full_pose_short"),
    figures={"regimes.png": figure.maps},
    write=recording.write,
)
