"""Where the cone pays by itself."""

from testbench.arm.catalogue import find_arm
from testbench.studies.regimes import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name="regimes",
    about="Map where GCO beats least squares of the same structure: noise, poses, structure, truth, prior.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(grid.arm) for grid in asked.grids.values()],
    row=trial.CellRow,
    trials=trial.trials,
    report=report.report,
    printed=("gravity_short", "full_pose_short"),
    figures=report.figures,
    write=report.write,
)
