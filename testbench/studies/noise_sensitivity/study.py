"""What noise costs, by method and structure, and what better instruments are worth."""

from testbench.arm.catalogue import find_arm
from testbench.studies.noise_sensitivity import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name=trial.NAME,
    about="Identify from readings of ever more noise, and judge by the true deflections.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 4),
    arms=lambda _: [find_arm(trial.LIGHT), find_arm(trial.HEAVY)],
    row=trial.NoiseRow,
    trials=trial.trials,
    report=report.report,
    printed=("gravity_short", "six_dof_short"),
    figures=report.figures,
    write=report.write,
)
