"""testbench bench ENTRY.py ...: rank estimators in frozen tasks, beside the default of identify and ours."""

from dataclasses import replace
from pathlib import Path

from testbench.shell.options import Common, takes
from testbench.studies.bench.study import STUDY
from testbench.studies.bench.trial import Options
from testbench.studies.run import run
from testbench.views.terminal import plain_console


@takes(Common, Options)
def command(common: Common, options: Options) -> None:
    """Rank estimators in frozen tasks."""
    run(STUDY, replace(common, out=common.out or Path("runs/bench")), options, plain_console())
