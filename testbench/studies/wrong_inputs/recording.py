"""What the study of wrong inputs leaves beside its report: a sound dataset."""

from testbench.data.csvfile import write_csv
from testbench.studies.study import Run
from testbench.studies.wrong_inputs.report import WrongInputsReport
from testbench.studies.wrong_inputs.trial import SOUND, Settings, cases, cells_of


def write(run: Run[Settings, WrongInputsReport]) -> None:
    """dataset.csv."""
    sound = dict(cases(run.settings, cells_of(), run.report.shown))[SOUND]
    write_csv(sound.data, sound.cell.arm, run.folder / "dataset.csv")
