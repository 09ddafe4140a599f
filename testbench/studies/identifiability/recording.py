"""What the study leaves beside its report: dataset of the first seed, and error over poses as a recording."""

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import distinct, is_least_squares
from testbench.bench.campaign import build_cell, simulate
from testbench.data.csvfile import write_csv
from testbench.studies.identifiability.summary import IdentifiabilityReport
from testbench.studies.identifiability.tables import POSES, rms
from testbench.studies.identifiability.trial import Settings
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Column


def write(run: Run[Settings, IdentifiabilityReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(run.settings.arm))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.measured, cell.arm, run.folder / "dataset.csv")
    write_recording(run)


def write_recording(run: Run[Settings, IdentifiabilityReport]) -> None:
    """Error over the workspace against the number of poses, with and without a prior."""
    rows = run.report.poses
    models = [m for m in distinct(run.report.models) if m.name in rows[0]]
    sweep = Sweep(
        POSES,
        Column("", "RMS error over the workspace", rms("").unit),
        [Point(POSES.value(row), m.name, row[m.name]) for row in rows for m in models],
        {m.name: look(m.structure, m.constraint, m.prior, m.filling) for m in models},
        against=[m.name for m in models if is_least_squares(m.structure, m.constraint, prior=m.prior)],
    )
    header = Header(run.report.scenario, run.parameters, run.seeds[0])
    words = run.words.summary(sweep.words.block("medians"), then=("statements", "seen"))
    write_sweep(run.folder / "recording.rrd", header, sweep, words)
