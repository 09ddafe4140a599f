"""What the study leaves beside its report: dataset of the first seed, and error over poses as a recording."""

from testbench.arm.library import find_arm
from testbench.bench.campaign import build_cell, simulate
from testbench.data.csvfile import write_csv
from testbench.studies.identifiability.summary import IdentifiabilityReport
from testbench.studies.identifiability.tables import POSES, rms
from testbench.studies.identifiability.trial import Settings
from testbench.studies.study import Run
from testbench.trials.spread import ends, middle
from testbench.views.colours import look
from testbench.views.recording import Point, Sweep, write_sweep


def write(run: Run[Settings, IdentifiabilityReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(run.settings.arm))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.measured, tuple(j.name for j in cell.arm.joints), run.folder / "dataset.csv")
    write_sweep(run.folder / "recording.rrd", sweep(run))


def sweep(run: Run[Settings, IdentifiabilityReport]) -> Sweep:
    """Error over the workspace against the number of poses, with and without a prior."""
    report, words = run.report, run.words
    models = [m for m in report.models if m.name in report.poses[0]]
    return Sweep(
        scenario=report.scenario,
        parameters=run.parameters,
        seed=run.seeds[0],
        question=words.block("question"),
        answer=words.block("answer"),
        swept=POSES.heading,
        swept_unit="",
        measured="RMS error over the workspace",
        unit=rms("").unit,
        points=[
            Point(middle(row["poses"]), m.name, middle(row[m.name]), *ends(row[m.name]))
            for row in report.poses
            for m in models
        ],
        colours={},
        looks={m.name: look(m.structure, m.constraint, m.prior) for m in models},
        remarks="\n\n".join([words.block("statements"), words.block("seen")]),
    )
