"""What the study of the default method leaves beside its report: a dataset, and methods over poses."""

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell, draw_poses, simulate_at
from testbench.bench.truths import true_cell
from testbench.data.csvfile import write_csv
from testbench.studies.study import Run
from testbench.studies.which_model.report import WhichModelReport
from testbench.studies.which_model.trial import Settings, read, scenario

SHOWN = "cast"  #: The true arm whose readings are left as a dataset.


def write(run: Run[Settings, WhichModelReport]) -> None:
    """dataset.csv of the first seed."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    poses = draw_poses(cell, scenario(asked), seed)
    campaign = simulate_at(true_cell(cell, SHOWN, seed), scenario(asked), seed, poses)
    write_csv(read(campaign)[-1], cell.arm, run.folder / "dataset.csv")
