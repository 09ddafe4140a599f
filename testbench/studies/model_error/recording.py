"""What the study of model error leaves beside its report: a dataset of the disturbed arm, cases as dots."""

from testbench.arm.library import find_arm
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.data.csvfile import write_csv
from testbench.studies.model_error.cases import ALL, cases
from testbench.studies.model_error.report import ModelErrorReport
from testbench.studies.model_error.tables import CASE, MODEL, RMS
from testbench.studies.model_error.trial import Settings, disturbed
from testbench.studies.noise_sensitivity.trial import reread
from testbench.studies.study import Run
from testbench.trials.spread import ends, middle
from testbench.views.colours import look
from testbench.views.recording import Point, Sweep, write_sweep


def write(run: Run[Settings, ModelErrorReport]) -> None:
    """dataset.csv and recording.rrd."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False, workspace_poses=1), seed)
    clean, _ = disturbed(cell, campaign, cases(asked.scale, asked.only)[ALL], seed)
    joints = tuple(j.name for j in cell.arm.joints)
    write_csv(reread(clean, asked.sigma, stream(seed, 1)), joints, run.folder / "dataset.csv")
    write_sweep(run.folder / "recording.rrd", sweep(run))


def sweep(run: Run[Settings, ModelErrorReport]) -> Sweep:
    """Error over the workspace by disturbance, with noise."""
    names = list(run.report.sizes)
    noisy = [cell for cell in run.report.cells if cell.noise_um > 0]
    return Sweep(
        scenario=run.report.scenario,
        parameters=run.parameters,
        seed=run.seeds[0],
        words=run.words.summary(run.tables["noisy_short"]),
        swept=CASE.heading,
        swept_unit="",
        measured=f"{RMS.heading} over the workspace with noise of {run.report.sigma_um:g} um",
        unit=RMS.unit,
        points=[Point(names.index(c.case), MODEL.cell(c), middle(c.rms_um), *ends(c.rms_um)) for c in noisy],
        looks={c.model: look(c.structure, c.constraint, c.prior) for c in noisy},
        labels=dict(enumerate(names)),
    )
