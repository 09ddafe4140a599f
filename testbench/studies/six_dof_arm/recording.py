"""What section 5.2 leaves beside its report: dataset and recording of the first seed, linear truth."""

import time

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.full_pose import simulate
from testbench.bench.judged import identify
from testbench.data.csvfile import write_csv
from testbench.studies.six_dof_arm.report import SixDofReport
from testbench.studies.six_dof_arm.trial import Settings, models
from testbench.studies.study import Run
from testbench.views.markdown import grid
from testbench.views.page.calibration import Calibrated, calibration_seen
from testbench.views.page.page import Seen
from testbench.views.recording.calibration import write_calibration
from testbench.views.recording.drawing import Calibration
from testbench.views.recording.stream import Header


def write(run: Run[Settings, SixDofReport]) -> Seen:
    """dataset.csv and recording.rrd; what the page draws."""
    cell = build_cell(find_arm(run.settings.arm))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.identification, cell.arm, run.folder / "dataset.csv")
    results = identify(cell, campaign, models(cell), time.perf_counter)
    write_calibration(run.folder / "recording.rrd", about(run), cell, campaign, results)
    report, M = run.report, run.settings.magnification
    return calibration_seen(Calibrated(cell, campaign, results, report.models, report.map, M))


def about(run: Run[Settings, SixDofReport]) -> Calibration:
    """Words and models: the best of each method, the runs sorted by the best of all."""
    report, words = run.report, run.words
    names = [m.name for m in report.models]
    held = [name for name in report.best if report.models[names.index(name)].constraint == "psd"]
    best = names.index((held or report.best)[0])
    return Calibration(
        header=Header(report.scenario, run.parameters, run.seeds[0]),
        summary=words.summary(run.tables["recorded"], then=()),
        notes="\n\n".join([words.block("title"), grid(run.tables["claims"]), words.block("statements")]),
        errors=run.tables["errors"],
        models=report.models,
        best=best,
        shown=tuple(dict.fromkeys([*map(names.index, report.map.compared), best])),
        map=report.map,
        magnification=run.settings.magnification,
    )
