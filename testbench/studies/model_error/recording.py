"""What the study of model error leaves beside its report: a dataset of the disturbed arm, cases as dots."""

from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import is_least_squares
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.bench.truths import member, true_cell
from testbench.data.csvfile import write_csv
from testbench.studies.model_error.cases import ALL, NONE, cases
from testbench.studies.model_error.report import ModelErrorReport
from testbench.studies.model_error.summary import distinct
from testbench.studies.model_error.tables import CASE, MODEL, RMS
from testbench.studies.model_error.trial import Settings, disturbed
from testbench.studies.noise_sensitivity.fits import reread
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Table, pivot


def write(run: Run[Settings, ModelErrorReport]) -> None:
    """dataset.csv and recording.rrd."""
    asked, seed = run.settings, run.seeds[0]
    cell = true_cell(build_cell(find_arm(asked.arm)), member(asked.true_arm, seed), seed)
    campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False, workspace_poses=1), seed)
    clean, _ = disturbed(cell, campaign, cases(asked.scale, asked.only)[ALL], seed)
    write_csv(reread(clean, asked.sigma, stream(seed, 1)), cell.arm, run.folder / "dataset.csv")
    write_recording(run)


def write_recording(run: Run[Settings, ModelErrorReport]) -> None:
    """Error over the workspace by disturbance, with noise."""
    report, names = run.report, list(run.report.sizes)
    noisy = [cell for cell in distinct(report.cells) if cell.noise_um > 0]
    noise = f"{RMS.heading} over the workspace with noise of {report.sigma_um:g} um"
    sweep = Sweep(
        CASE,
        replace(RMS, heading=noise),
        [Point(names.index(c.case), MODEL.cell(c), c.rms_um) for c in noisy],
        {c.model: look(c.structure, c.constraint, c.prior) for c in noisy},
        labels=dict(enumerate(map(CASE.text, names))),
        against=[c.model for c in noisy if is_least_squares(c.structure, c.constraint, prior=c.prior)],
    )
    header = Header(report.scenario, run.parameters, run.seeds[0])
    shown = {NONE, names[int(sweep.widest.best.x)], ALL}
    table = pivot(Table((), [c for c in noisy if c.case in shown]), MODEL, CASE, replace(RMS, exact=True))
    words = run.words.summary(f"RMS error over the workspace ({RMS.unit}), medians:", table)
    write_sweep(run.folder / "recording.rrd", header, sweep, words)
