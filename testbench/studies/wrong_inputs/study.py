"""Are wrong inputs found out, and sound ones left alone?"""

from testbench.arm.catalogue import find_arm
from testbench.studies.study import Study
from testbench.studies.wrong_inputs import report, trial
from testbench.studies.wrong_inputs.sound import PAYLOAD

STUDY = Study(
    name="wrong_inputs",
    about="Plant mistakes in readings, loads and folders one by one; see whether the right doubt names each.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(500, trial.QUICK),
    arms=lambda _: [find_arm(name) for name in PAYLOAD],
    row=trial.SetRow,
    trials=trial.trials,
    report=report.report,
    printed=("kinds",),
    figures=report.figures,
    write=report.write,
)
