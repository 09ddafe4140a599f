"""What the study of noise leaves beside its report: the first dataset, and the sweep under gravity."""

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.bench.truths import member, true_cell
from testbench.data.csvfile import write_csv
from testbench.studies.noise_sensitivity.fits import reread
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA
from testbench.studies.noise_sensitivity.report import NoiseReport
from testbench.studies.noise_sensitivity.trial import HEAVY, Settings
from testbench.studies.study import Run


def write(run: Run[Settings, NoiseReport]) -> None:
    """dataset.csv of the first seed."""
    seed = run.seeds[0]
    cell = true_cell(build_cell(find_arm(HEAVY)), member(run.settings.true_arm, seed), seed)
    clean = simulate(cell, Scenario(arm=HEAVY, noise=False), seed).identification
    write_csv(reread(clean, FLAT_SIGMA, stream(seed, 1)), cell.arm, run.folder / "dataset.csv")
