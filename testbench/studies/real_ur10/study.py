"""A real UR10: what explains its readings, and what foretells those that were never fitted."""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.real_ur10 import figure, recording, settings, summary, tables, trained, trial
from testbench.studies.real_ur10.readings import ARM
from testbench.studies.real_ur10.rows import SubsetRow
from testbench.studies.study import TypedStudy

STUDY = TypedStudy(
    name=settings.NAME,
    about="Public readings of a UR10: geometry, springs, links and joint errors, series against series.",
    folder=Path(__file__).parent,
    options=settings.Options,
    settings=settings.settings,
    seeds=(20, 1),
    arms=lambda _: [find_arm(ARM)],
    row=SubsetRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("short",),
    figures={"real_ur10.png": figure.real_ur10, "spectra.png": figure.spectra},
    write=recording.write,
    data="errors.csv",
    size=4,
    prepare=trained.prepare,
)
