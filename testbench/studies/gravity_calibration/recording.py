"""What a calibration leaves beside its report: dataset, residual figure and recording of the first seed."""

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import distinct
from testbench.bench.campaign import build_cell
from testbench.data.csvfile import write_csv
from testbench.studies.gravity_calibration import figure, trial
from testbench.studies.gravity_calibration.summary import GravityReport
from testbench.studies.gravity_calibration.trial import Settings
from testbench.studies.study import Run
from testbench.views.page.calibration import Calibrated, calibration_seen
from testbench.views.page.page import Seen
from testbench.views.recording.calibration import write_calibration
from testbench.views.recording.drawing import Calibration
from testbench.views.recording.stream import Header


def write(run: Run[Settings, GravityReport]) -> Seen:
    """dataset.csv, residuals.png and recording.rrd; what the page draws."""
    cell, campaign = trial.calibrate(build_cell(find_arm(run.settings.arm)), run.settings, run.seeds[0])
    names = {m.name for m in distinct(run.report.models)}
    results = [result for result in trial.results(cell, campaign) if result.model.name in names]
    write_csv(campaign.measured, cell.arm, run.folder / "dataset.csv")
    figure.residuals(campaign, results, run.report.take).savefig(run.folder / "residuals.png")
    drawn = about(run)
    write_calibration(run.folder / "recording.rrd", drawn, cell, campaign, results)
    models = {m.name: m for m in run.report.models}
    named = [models[result.model.name] for result in results]
    return calibration_seen(
        Calibrated(cell, campaign, results, named, run.report.map, run.settings.magnification)
    )


def about(run: Run[Settings, GravityReport]) -> Calibration:
    """Words and models: what is compared, the one to take, which sorts the runs."""
    report = run.report
    models = distinct(report.models)
    names = [m.name for m in models]
    best = names.index(report.take) if report.take else 0
    shown = dict.fromkeys([*report.map.compared, names[best]])
    return Calibration(
        header=Header(report.scenario, run.parameters, run.seeds[0]),
        summary=run.words.summary(run.tables["recorded"]),
        notes=run.words.block("title"),
        errors=run.tables["errors"],
        models=models,
        best=best,
        shown=tuple(names.index(name) for name in shown if name in names),
        map=report.map,
        magnification=run.settings.magnification,
    )
