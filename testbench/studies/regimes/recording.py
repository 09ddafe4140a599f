"""What the study of regimes leaves beside its report: a dataset, and the noise at one number of poses."""

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.data.csvfile import write_csv
from testbench.studies.regimes.report import RegimesReport
from testbench.studies.regimes.trial import Settings, first_runs
from testbench.studies.study import Run


def write(run: Run[Settings, RegimesReport]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.gravity.arm))
    runs = first_runs(cell, run.settings, run.seeds[0])
    write_csv(runs, cell.arm, run.folder / "dataset.csv")
