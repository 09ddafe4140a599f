"""testbench demo: the calibration of section 6 with seed 1, into runs/demo."""

from dataclasses import replace
from pathlib import Path

from rich.console import Console

from testbench.shell.options import Common, takes
from testbench.studies.gravity_calibration.study import STUDY
from testbench.studies.gravity_calibration.trial import Options
from testbench.studies.run import run


@takes(Common, Options)
def command(common: Common, options: Options) -> None:
    """Run the study."""
    run(STUDY, replace(common, out=common.out or Path("runs/demo")), options, Console(highlight=False))
