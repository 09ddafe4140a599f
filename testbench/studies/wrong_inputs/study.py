"""Are wrong inputs found out, and sound ones left alone?"""

from pathlib import Path

from testbench.arm.catalogue import find_arm
from testbench.studies.study import TypedStudy
from testbench.studies.wrong_inputs import figure, recording, summary, tables, trial
from testbench.studies.wrong_inputs.sound import PAYLOAD

STUDY = TypedStudy(
    name=trial.NAME,
    about="Plant mistakes in readings, loads and folders one by one; see whether the right doubt names each.",
    folder=Path(__file__).parent,
    options=trial.Options,
    settings=trial.settings,
    seeds=(500, trial.QUICK),
    arms=lambda _: [find_arm(name) for name in PAYLOAD],
    row=trial.SetRow,
    trials=trial.trials,
    summary=summary.summary,
    tables=tables.tables,
    printed=("kinds",),
    figures={"wrong_inputs.png": figure.bars},
    write=recording.write,
)
