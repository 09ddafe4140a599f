"""testbench bench ENTRY.py ...: rank estimators in frozen tasks, beside the default of identify and ours."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from testbench.errors import BenchError
from testbench.shell.options import Common, takes
from testbench.studies.bench.secret import commitment, first_seed, kept_secret
from testbench.studies.bench.study import STUDY
from testbench.studies.bench.trial import Options, settings
from testbench.studies.run import run
from testbench.views.terminal import plain_console


@dataclass(frozen=True)
class Judged(Options):
    """Flags of the study, and fresh seeds."""

    judge: Annotated[
        Path | None,
        typer.Option(help="Fresh seeds of the secret in this file, drawn where there is none."),
    ] = None


@takes(Common, Judged)
def command(common: Common, options: Judged) -> None:
    """Run the study; with --judge and no entry commit to a secret and end."""
    study, console = STUDY, plain_console()
    if options.judge is not None:
        if common.seed != Common.seed:
            raise BenchError("--seed is for development: expected it without --judge")
        secret = kept_secret(options.judge)
        console.print(f"commitment, SHA-256 of the secret: {commitment(secret)}", soft_wrap=True)
        if not options.entries:
            return
        study = replace(STUDY, settings=lambda *asked: replace(settings(*asked), secret=secret))
        common = replace(common, seed=first_seed(secret))
    run(study, replace(common, out=common.out or Path("runs/bench")), options, console)
