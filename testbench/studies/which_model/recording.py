"""What the study of the default method leaves beside its report: a dataset, and methods over poses."""

from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import is_least_squares
from testbench.bench.campaign import build_cell, draw_poses, simulate_at
from testbench.bench.truths import true_cell
from testbench.data.csvfile import write_csv
from testbench.studies.study import Run
from testbench.studies.which_model.report import WhichModelReport
from testbench.studies.which_model.tables import ACROSS, ERROR, METHOD, look_of
from testbench.studies.which_model.trial import Settings, read, scenario
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Sweep, points

SHOWN = "cast"  #: The true arm whose readings are left as a dataset.


def write(run: Run[Settings, WhichModelReport]) -> None:
    """dataset.csv and recording.rrd."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    poses = draw_poses(cell, scenario(asked), seed)
    campaign = simulate_at(true_cell(cell, SHOWN, seed), scenario(asked), seed, poses)
    write_csv(read(campaign)[-1], cell.arm, run.folder / "dataset.csv")
    write_recording(run)


def write_recording(run: Run[Settings, WhichModelReport]) -> None:
    """Error over the workspace by number of poses, over the family."""
    report = run.report
    sweep = Sweep(
        ACROSS,
        replace(ERROR, heading=f"{ERROR.heading} over the workspace"),
        points(report.family, METHOD, ACROSS, ERROR),
        {m.method: look_of(m) for m in report.family},
        against=[
            m.method for m in report.family if is_least_squares(m.structure, m.constraint, prior=m.filled)
        ],
    )
    header = Header(report.scenario, run.parameters, run.seeds[0])
    words = run.words.summary(run.tables["family_short"])
    write_sweep(run.folder / "recording.rrd", header, sweep, words)
