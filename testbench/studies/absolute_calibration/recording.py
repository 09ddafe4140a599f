"""What the study of absolute calibration leaves beside its report: the first trial's readings, on the arm."""

from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.absolute import Calibrated
from testbench.bench.absolute_summary import reported
from testbench.bench.campaign import build_cell
from testbench.data.series_csv import write_series
from testbench.identify.absolute.fit import explain
from testbench.studies.absolute_calibration.measure import Asked, measure
from testbench.studies.absolute_calibration.report import AbsoluteCalibrationReport
from testbench.studies.absolute_calibration.settings import ABSOLUTE, CHOSEN, MODELS, REAL, Settings
from testbench.studies.study import Run
from testbench.views.absolute.scene import scene
from testbench.views.recording.absolute import write_absolute
from testbench.views.recording.stream import Header


def write(run: Run[Settings, AbsoluteCalibrationReport]) -> None:
    """dataset.csv and recording.rrd: the campaign of the first trial, as cross-validation explains it."""
    seed = run.seeds[0]
    cell = build_cell(find_arm(run.settings.arm_of(seed)))
    own = measure(cell, Asked(REAL, ABSOLUTE, run.settings.featured), seed)
    write_series(run.folder / "dataset.csv", cell.arm, own.series)
    found = Calibrated(explain(own.gathered, MODELS[CHOSEN]), own.series, ())
    made = scene(cell, reported(found))
    words = run.words.summary(run.tables["recorded"], run.words.block("reading", scale=made.scale))
    header = Header(run.report.scenario, run.parameters, seed)
    write_absolute(run.folder / "recording.rrd", header, replace(made, summary=words))
