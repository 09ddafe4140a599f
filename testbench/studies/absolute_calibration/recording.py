"""What the study of absolute calibration leaves beside its report: the first trial's readings, on the arm."""

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
from testbench.views.absolute.page import seen
from testbench.views.page.page import Seen


def write(run: Run[Settings, AbsoluteCalibrationReport]) -> Seen:
    """dataset.csv: the campaign of the first trial; what is drawn: how cross-validation explains it."""
    seed = run.seeds[0]
    cell = build_cell(find_arm(run.settings.arm_of(seed)))
    own = measure(cell, Asked(REAL, ABSOLUTE, run.settings.featured), seed)
    write_series(run.folder / "dataset.csv", cell.arm, own.series)
    return seen(cell, reported(Calibrated(explain(own.gathered, MODELS[CHOSEN]), own.series, ())))
