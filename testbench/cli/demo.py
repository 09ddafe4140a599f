"""testbench demo: the calibration of section 6 with seed 1 and cast links, into runs/demo."""

from dataclasses import dataclass, replace
from pathlib import Path

from testbench.report.terminal import plain_console
from testbench.studies.campaign.gravity_calibration import STUDY, Options
from testbench.studies.run import run
from testbench.studies.study import TrueArmFlag
from testbench.workflows.options import Common, takes
from testbench.workflows.own_estimator import EstimatorOptions


@dataclass(frozen=True)
class Demo(Options):
    """Hold the flags of the study, the true links cast."""

    true_arm: TrueArmFlag = "cast"


@takes(Common, Demo, EstimatorOptions, draws=True)
def command(common: Common, options: Demo, estimators: EstimatorOptions) -> None:
    """Run the study."""
    asked = replace(common, out=common.out or Path("runs/demo"))
    run(STUDY, asked, options, plain_console(), estimators)
