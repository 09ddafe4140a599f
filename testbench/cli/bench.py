"""testbench bench ENTRY.py ...: rank estimators in frozen tasks, beside the default of identify and ours."""

from dataclasses import replace
from pathlib import Path

from testbench.report.terminal import plain_console
from testbench.studies.bench import STUDY, BenchOptions
from testbench.studies.run import run
from testbench.workflows.options import Common, takes


@takes(Common, BenchOptions, draws=True)
def command(common: Common, options: BenchOptions) -> None:
    """Rank estimators in frozen tasks."""
    run(STUDY, replace(common, out=common.out or Path("runs/bench")), options, plain_console())
