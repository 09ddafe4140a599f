"""What the study of model error leaves beside its report: a dataset of the disturbed arm, cases as dots."""

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.bench.truths import member, true_cell
from testbench.data.csvfile import write_csv
from testbench.studies.model_error.cases import ALL, cases
from testbench.studies.model_error.report import ModelErrorReport
from testbench.studies.model_error.trial import Settings, disturbed
from testbench.studies.noise_sensitivity.fits import reread
from testbench.studies.study import Run


def write(run: Run[Settings, ModelErrorReport]) -> None:
    """dataset.csv of the first seed."""
    asked, seed = run.settings, run.seeds[0]
    cell = true_cell(build_cell(find_arm(asked.arm)), member(asked.true_arm, seed), seed)
    campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False, workspace_poses=1), seed)
    clean, _ = disturbed(cell, campaign, cases(asked.scale, asked.only)[ALL], seed)
    write_csv(reread(clean, asked.sigma, stream(seed, 1)), cell.arm, run.folder / "dataset.csv")
