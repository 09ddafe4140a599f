"""What the study of noise leaves beside its report: the first dataset, and the sweep under gravity."""

from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import is_least_squares
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.bench.truths import member, true_cell
from testbench.data.csvfile import write_csv
from testbench.studies.noise_sensitivity.fits import reread
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA
from testbench.studies.noise_sensitivity.report import NoiseReport
from testbench.studies.noise_sensitivity.tables import MODEL, RMS, SIGMA, distinct
from testbench.studies.noise_sensitivity.trial import HEAVY, Settings
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Sweep, points


def write(run: Run[Settings, NoiseReport]) -> None:
    """dataset.csv and recording.rrd."""
    seed = run.seeds[0]
    cell = true_cell(build_cell(find_arm(HEAVY)), member(run.settings.true_arm, seed), seed)
    clean = simulate(cell, Scenario(arm=HEAVY, noise=False), seed).identification
    write_csv(reread(clean, FLAT_SIGMA, stream(seed, 1)), cell.arm, run.folder / "dataset.csv")
    write_recording(run)


def write_recording(run: Run[Settings, NoiseReport]) -> None:
    """Error over the workspace against noise, the KR 500 under its payload."""
    rows = distinct(run.report.sweeps["gravity"])
    y = replace(RMS, heading=f"{RMS.heading} over the workspace")
    looks = {row.model: look(row.structure, row.constraint, row.prior) for row in rows}
    theirs = [r.model for r in rows if is_least_squares(r.structure, r.constraint, prior=r.prior)]
    sweep = Sweep(SIGMA, y, points(rows, MODEL, SIGMA, y), looks, against=theirs)
    header = Header(run.report.scenario, run.parameters, run.seeds[0])
    words = run.words.summary(run.tables["gravity_short"])
    write_sweep(run.folder / "recording.rrd", header, sweep, words)
