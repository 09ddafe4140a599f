"""testbench identify ARM DATA --out DIR: stiffness models from measured runs."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import Cell, build_cell
from testbench.campaign.campaign_flags import Readings
from testbench.campaign.doubt import Doubt
from testbench.campaign.fits import fit
from testbench.campaign.model_folder import DOCUMENT, FITS
from testbench.campaign.model_selection import default_models, with_priors
from testbench.campaign.models import Model, named_models
from testbench.campaign.own_estimator import EstimatorOptions, hired
from testbench.campaign.runs import files_read, read_runs
from testbench.cli.arguments import plain
from testbench.commands.identify import COMMAND, PICTURE, printed, tell
from testbench.errors import BenchError
from testbench.identify import robust
from testbench.identify.prior import Strength, cad_prior
from testbench.output.place import claim_folder
from testbench.report.leave import MAP
from testbench.shell.options import Force, of_flag, takes
from testbench.views import terminal

OLD = frozenset((FITS,))  #: All that earlier versions left.


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/identify")
    model: Annotated[list[str] | None, typer.Option(help="Model to fit; may be given again.")] = None
    check_pose: Annotated[list[int] | None, typer.Option(help="Pose to hold back; again for more.")] = None
    full_pose: Annotated[
        bool, typer.Option("--full-pose", help="Insist on both terms of Eq. 19, positions and orientations.")
    ] = False
    prior: Annotated[
        bool,
        typer.Option(help="Use the arm's folder as CAD prior for what the data do not show."),
    ] = True
    uncertainty_percent: Annotated[
        float | None,
        typer.Option(
            min=1e-4, max=1e8, help="Of the prior; default: learnt from the readings, 30 with --robust."
        ),
    ] = None
    robust: Annotated[bool, typer.Option("--robust", help="Look for outliers and fit without them.")] = False
    intervals: Annotated[bool, typer.Option(help="95 % intervals of the predicted deflections.")] = True
    strict: Annotated[bool, typer.Option("--strict", help="Fail if there is any warning.")] = False
    force: Force = False


@takes(Readings, Options, EstimatorOptions)
def command(readings: Readings, asked: Options, tried: EstimatorOptions) -> None:
    """Fit, judge, say which model to take, and write it."""
    arm = find_arm(readings.arm)
    inputs, own = [arm, *files_read(readings)], tried.own
    with claim_folder(asked.out, COMMAND, own=OLD, inputs=inputs, force=asked.force):
        cell = build_cell(readings.arm)
        if asked.uncertainty_percent is not None and not asked.prior:
            raise BenchError("--uncertainty-percent: expected a prior with it, got --no-prior")
        filed = cell
        cell, runs = read_runs(filed, readings, asked.check_pose or (), full_pose=asked.full_pose)
        models = _models(cell, asked)
        models += hired(own)(cell, cad_prior(cell.arm) if asked.prior else None)
        found = fit(cell, models, runs, time.perf_counter, widths=asked.intervals)
        if asked.strict:
            from testbench.campaign.arm_check import check  # here: it reads the arm once more

            check_strictly((*check(readings.arm).doubts, *found.fits.doubts))
        flags, out = plain(readings, asked, read="dataset", without=("arm",)), asked.out
        flags |= {"estimators": {each.name: asdict(each) for each in own}} if own else {}
        said, console = tell((filed, cell), found, flags, out), terminal.plain_console()
        console.print(terminal.as_plain(said.title))
        lines = [
            f"model      {out / DOCUMENT}: {found.fits.recommended}; all others: {out / FITS}",
            f"report     {out / 'report.md'}, {out / 'report.json'}",
            f"figures    {', '.join(str(out / name) for name in (PICTURE, MAP) if (out / name).exists())}",
            *terminal.looked_at(out),
        ]
        terminal.print_words(console, said, [printed(said)], lines)


def check_strictly(said: Sequence[Doubt]) -> None:
    """Refuse runs with a doubt, all of them in one line."""
    if said:
        count = "1 doubt" if len(said) == 1 else f"{len(said)} doubts"
        raise BenchError(f"--strict: {count}: {'; '.join(doubt.sentence for doubt in said)}")


def _models(cell: Cell, asked: Options) -> list[Model]:
    """The models that were asked for, with the prior where it fits them, or those of the default."""
    prior, percent = cad_prior(cell.arm) if asked.prior else None, asked.uncertainty_percent
    strength = None if percent is None else Strength(percent / 100)
    if not asked.model:
        models = default_models(cell, prior, strength)
    else:
        with of_flag("--model"):
            models = named_models(cell, asked.model)
        if prior is not None:
            models = [
                with_priors(cell.arm, [m], prior, strength)[0] if m.structure.whole else m for m in models
            ]
    if asked.robust:
        models = [replace(m, estimator=robust(m.estimator)) for m in models]
    return models
