"""What the study of noise leaves beside its report: the first dataset, and the sweep under gravity."""

from testbench.arm.library import find_arm
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.data.csvfile import write_csv
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA
from testbench.studies.noise_sensitivity.report import NoiseReport
from testbench.studies.noise_sensitivity.tables import MODEL, RMS, SIGMA
from testbench.studies.noise_sensitivity.trial import HEAVY, Settings, reread
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.recording import Sweep, write_sweep
from testbench.views.recording.sweep import points


def write(run: Run[Settings, NoiseReport]) -> None:
    """dataset.csv and recording.rrd."""
    seed = run.seeds[0]
    cell = build_cell(find_arm(HEAVY))
    clean = simulate(cell, Scenario(arm=HEAVY, noise=False), seed).identification
    joints = tuple(j.name for j in cell.arm.joints)
    write_csv(reread(clean, FLAT_SIGMA, stream(seed, 1)), joints, run.folder / "dataset.csv")
    write_sweep(run.folder / "recording.rrd", sweep(run))


def sweep(run: Run[Settings, NoiseReport]) -> Sweep:
    """Error over the workspace against noise, the KR 500 under its payload."""
    rows = run.report.sweeps["gravity"]
    return Sweep(
        scenario=run.report.scenario,
        parameters=run.parameters,
        seed=run.seeds[0],
        words=run.words.summary(run.tables["gravity_short"]),
        swept=SIGMA.heading,
        swept_unit=SIGMA.unit,
        measured=f"{RMS.heading} over the workspace",
        unit=RMS.unit,
        points=points(rows, MODEL, SIGMA, RMS),
        looks={row.model: look(row.structure, row.constraint, row.prior) for row in rows},
    )
