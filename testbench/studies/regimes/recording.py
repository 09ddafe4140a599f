"""What the study of regimes leaves beside its report: a dataset, and the noise at one number of poses."""

from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.data.csvfile import write_csv
from testbench.studies.regimes.report import RegimesReport
from testbench.studies.regimes.tables import NOISE, OVER_LS
from testbench.studies.regimes.trial import Settings, first_runs
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Point, Sweep, points
from testbench.views.schema import Column

STRUCTURE = Column("structure", "structure")
EQUAL = "least squares"  #: What the others are over.


def write(run: Run[Settings, RegimesReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(run.settings.gravity.arm))
    runs = first_runs(cell, run.settings, run.seeds[0])
    write_csv(runs, cell.arm, run.folder / "dataset.csv")
    write_recording(run)


def write_recording(run: Run[Settings, RegimesReport]) -> None:
    """GCO over least squares by noise, the poses of section 6, a line a structure."""
    report = run.report
    rows = [cell for cell in report.cells["gravity"] if cell.poses == report.featured_poses]
    heading = f"error of GCO over that of least squares, {report.featured_poses} poses"
    y = replace(OVER_LS, heading=heading)
    looks = {row.structure: look(row.structure, "psd") for row in rows} | {EQUAL: look("MLS56", "none")}
    equal = [Point(noise, EQUAL, 1.0) for noise in sorted({row.noise_um for row in rows})]
    found = [*points(rows, STRUCTURE, NOISE, y), *equal]
    sweep = Sweep(NOISE, y, found, looks, against=[EQUAL])
    header = Header(report.scenario, run.parameters, run.seeds[0])
    words = run.words.summary(run.tables["gravity_short"])
    write_sweep(run.folder / "recording.rrd", header, sweep, words)
