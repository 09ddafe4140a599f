"""One campaign a seed: poses, loads, readings, and every model identified from them and judged."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.library import find_arm
from testbench.bench.campaign import (
    Campaign,
    Cell,
    Result,
    Scenario,
    build_cell,
    identify,
    named_models,
    simulate,
)
from testbench.bench.rows import MM, UM, ErrorRow, FitRow, NormalityRow, error_row, fit_row, normality_row
from testbench.bench.wrong_prior import with_wrong_prior
from testbench.trials.spread import Number

NAME = "gravity_calibration"
QUICK_WORKSPACE = 40
WITH_PRIOR = ("MLS56", "MGCO47", "MGCO56", "MGCO68")
"""Models that are fitted with the prior too; MLS32 is no structure of whole blocks."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    payload_kg: Annotated[float, typer.Option(help="Hung mass.")] = 460.3
    sigma_um: Annotated[float, typer.Option(help="Noise of a reading along an axis.")] = 50.0
    truth: Annotated[Literal["nonlinear", "linear"], typer.Option(help="Kind of truth.")] = "nonlinear"
    noise: Annotated[bool, typer.Option(help="Noisy readings.")] = True
    magnification: Annotated[
        float, typer.Option(min=1, max=10_000, help="Of the deflections drawn in the recording.")
    ] = 50.0


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    scenario: Scenario  #: The campaign.
    magnification: float  #: Of the drawn deflections [1].


@dataclass(frozen=True)
class Measured:
    """What was measured: counts, and the least and largest deflection of a marker."""

    runs: int
    points: int
    poses: int
    identification_runs: int
    identification_points: int
    check_runs: int
    check_points: int
    workspace_poses: int
    deflection_min_mm: Number
    deflection_max_mm: Number
    sigma_um: float


@dataclass(frozen=True)
class Residuals:
    """Residual components of the runs that were fitted, and of those that were not."""

    identification: NormalityRow
    check: NormalityRow


@dataclass(frozen=True)
class Judged(FitRow):
    """A model judged: against readings at fitted and check poses, against the truth over the workspace."""

    identification: ErrorRow
    check: ErrorRow
    workspace: ErrorRow
    residuals: Residuals


@dataclass(frozen=True)
class ModelRow(Judged):
    """The same with what it was measured from."""

    measured: Measured


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for."""
    scenario = Scenario(
        arm=find_arm(options.arm).resolve().name,
        payload=options.payload_kg,
        sigma=options.sigma_um / 1e6,
        truth=options.truth,
        noise=options.noise,
        workspace_poses=QUICK_WORKSPACE if quick else 200,
    )
    return Settings(options.arm, scenario, options.magnification)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[ModelRow]]:
    """Rows of some seeds, one a model."""
    cell = build_cell(find_arm(asked.arm))
    found = []
    for seed in seeds:
        campaign = simulate(cell, asked.scenario, seed)
        found.append([row(campaign, result) for result in results(cell, campaign)])
    return found


def results(cell: Cell, campaign: Campaign) -> list[Result]:
    """The paper's models, then the same structures with a prior that is wrong."""
    models = with_wrong_prior(cell, named_models(cell), WITH_PRIOR, campaign.seed)
    return identify(cell, campaign, models, time.perf_counter)


def row(campaign: Campaign, result: Result) -> ModelRow:
    """One model of one campaign."""
    prior = result.estimate.belief is not None
    return ModelRow(
        **vars(fit_row(result.model.name, result.estimate, result.seconds, prior=prior)),
        identification=error_row(result.identification),
        check=error_row(result.check),
        workspace=error_row(result.workspace),
        residuals=Residuals(normality_row(result.fit_normality), normality_row(result.check_normality)),
        measured=measured(campaign),
    )


def measured(campaign: Campaign) -> Measured:
    """Counts and deflections of a campaign."""
    every, fitted, check = campaign.measured, campaign.identification, campaign.check
    size = MM * np.linalg.norm(every.deflection, axis=-1)
    return Measured(
        runs=every.runs,
        points=every.points,
        poses=len(np.unique(every.pose)),
        identification_runs=fitted.runs,
        identification_points=fitted.points,
        check_runs=check.runs,
        check_points=check.points,
        workspace_poses=campaign.workspace.runs,
        deflection_min_mm=float(size.min()),
        deflection_max_mm=float(size.max()),
        sigma_um=UM * every.sigma,
    )
