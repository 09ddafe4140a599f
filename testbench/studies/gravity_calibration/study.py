"""Section 6 in simulation: a heavy arm under a hung weight, three markers, LS against GCO."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.gravity_calibration import figure, recording, summary, trial
from testbench.studies.study import Study

STUDY = Study(
    name=trial.NAME,
    about="Calibrate the arm under gravity as section 6 of the paper does, and judge its models.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(1, 10_000),
    arms=lambda asked: [find_arm(asked.arm)],
    row=trial.ModelRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=summary.tables,
    printed=("short",),
    figures={"models.png": figure.models, "error_map.png": figure.places},
    write=recording.write,
    extra=("residuals.png",),
    size=4,
)
