"""What the study leaves beside its report: dataset of the first seed, and error over poses as a recording."""

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell, simulate
from testbench.data.csvfile import write_csv
from testbench.studies.identifiability.summary import IdentifiabilityReport
from testbench.studies.identifiability.trial import Settings
from testbench.studies.study import Run


def write(run: Run[Settings, IdentifiabilityReport]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.arm))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.measured, cell.arm, run.folder / "dataset.csv")
