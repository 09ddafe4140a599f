"""testbench identify ARM DATA --out DIR: stiffness models from measured runs."""

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from testbench import files
from testbench.bench.campaign import MODELS, Cell, Model, build_cell, named_models
from testbench.bench.fit import recommend
from testbench.cli.arguments import ArmName
from testbench.cli.arguments import Dataset as File
from testbench.data.csvfile import read_csv
from testbench.data.dataset import Dataset, split
from testbench.errors import BenchError, InputError
from testbench.identify import robust, with_prior
from testbench.identify.evaluate import predict, score
from testbench.identify.plausibility import doubts
from testbench.identify.prior import Strength, cad_prior
from testbench.shell.options import takes
from testbench.views import tables
from testbench.views.report import fit_report


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    arm: ArmName
    dataset: File
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/identify")
    model: Annotated[list[str] | None, typer.Option(help="Model to fit; may be given again.")] = None
    check_pose: Annotated[list[int] | None, typer.Option(help="Pose to hold back; again for more.")] = None
    full_pose: Annotated[
        bool, typer.Option("--full-pose", help="Insist on both terms of Eq. 19, positions and orientations.")
    ] = False
    prior: Annotated[
        bool,
        typer.Option("--prior", help="Fill what the data cannot see with the arm's folder as CAD prior."),
    ] = False
    uncertainty_percent: Annotated[
        float | None,
        typer.Option(help="Of the prior; cross-validated over poses if not given, 30 with --robust."),
    ] = None
    robust: Annotated[bool, typer.Option("--robust", help="Look for outliers and fit without them.")] = False


@takes(Options)
def command(asked: Options) -> None:
    """Fit, judge, write models.json, and say which model to take."""
    console = Console(highlight=False)
    cell = build_cell(asked.arm)
    if asked.uncertainty_percent is not None and not asked.prior:
        raise BenchError("--uncertainty-percent: expected --prior with it")
    chosen = _models(cell, asked)
    data = read_csv(asked.dataset, cell.arm)
    if asked.full_pose and data.rotation_before is None:
        problem = "expected rotation_before_*_rad, rotation_after_*_rad and sigma_rad for the rotation term"
        raise InputError(asked.dataset, "header", f"{problem} (--full-pose); it has positions only")
    check, used = _held_back(data, asked.check_pose)
    fits = []
    for entry in chosen:
        start = time.perf_counter()
        estimate = entry.estimator(cell.vjm, entry.structure, used)
        seconds = time.perf_counter() - start
        sets = {"identification": used} if check is None else {"identification": used, "check": check}
        scores = {
            k: score(predict(cell.vjm, estimate, d)[d.seen], d.deflection[d.seen]) for k, d in sets.items()
        }
        outliers = [asdict(reading) for reading in estimate.rejected]
        fits.append(fit_report(entry.name, estimate, scores, seconds, cell.arm) | {"rejected": outliers})
    with files.whole_folder(asked.out) as folder:
        whole = {"dataset": asked.dataset.name, "arm": cell.arm.name, "models": fits}
        files.write_json(whole, folder / "models.json")
    console.print(tables.fits(fits))
    for sentence in doubts(cell.vjm, data):
        console.print(f"- DOUBT: {sentence}")
    if len(chosen) > 1 and len(np.unique(used.pose)) > 1:
        name, candidates = recommend(cell, chosen, used)
        listed = ", ".join(f"{c.name} {c.error:.2f} +- {c.standard_error:.2f}" for c in candidates)
        console.print(
            f"- recommended: {name}, the simplest within one standard error of the best; F_M on poses and "
            f"load levels held out in turn: {listed}"
        )
    if check is None:
        console.print("- no pose was held back (--check-pose): how well a model fits is not how it predicts")
    for sentence in dict.fromkeys(text for row in fits for text in row["advice"]):
        console.print(f"- {sentence}")
    console.print(f"models     {asked.out / 'models.json'}", soft_wrap=True)


def _models(cell: Cell, asked: Options) -> list[Model]:
    """The models that were asked for, or all that the method can fit."""
    models = named_models(cell, asked.model or tuple(MODELS))
    if asked.prior:
        filled, percent = cad_prior(cell.arm), asked.uncertainty_percent
        strength = None if percent is None else Strength(percent / 100)
        kept = [m for m in models if asked.model or m.structure.whole]
        models = [replace(m, estimator=with_prior(m.estimator, filled, strength)) for m in kept]
    if asked.robust:
        models = [replace(m, estimator=robust(m.estimator)) for m in models]
    return models


def _held_back(data: Dataset, check_pose: list[int] | None) -> tuple[Dataset | None, Dataset]:
    """The runs in the poses held back, None if there are none, and those to fit.

    Raises:
        BenchError: When a pose is not in the data, none is left on one side, or no target was read in those
            held back.
    """
    if not check_pose:
        return None, data
    check, used = split(data, np.array(check_pose))
    if not check.seen.any():
        raise BenchError(f"--check-pose: expected readings in pose {check_pose}, every target was lost there")
    return check, used
