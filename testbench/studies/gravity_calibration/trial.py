"""One campaign a seed: poses, loads, readings, and every model identified from them and judged."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.catalogue import find_arm
from testbench.arm.folder import load_arm
from testbench.bench.baselines import JOINTS, equal_fit
from testbench.bench.campaign import (
    Campaign,
    Cell,
    Scenario,
    build_cell,
    draw_poses,
    of_arm,
    simulate_at,
    stream,
)
from testbench.bench.default import with_priors
from testbench.bench.error_places import Places, kept_mm, places_of
from testbench.bench.judged import Result, identify
from testbench.bench.models import named_models
from testbench.bench.rows import (
    DatasetRow,
    JudgedRow,
    NormalityRow,
    dataset_row,
    fit_row,
    judged_row,
    normality_row,
)
from testbench.bench.truths import FAMILY, TrueArmName, member, true_cell
from testbench.bench.wrong_prior import wrong_prior
from testbench.identify.evaluate import Normality, normality
from testbench.identify.prior import aggregate
from testbench.model.structure import template56

NAME = "gravity_calibration"
QUICK_WORKSPACE = 40
SAME = 1e-9  #: Entry of a compliance of unit diagonal below which it is zero.
WITHOUT_PRIOR = (JOINTS, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""The incumbent and the paper's models; beside MLS56 stands what is conservative and fits as well."""
WITH_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68", "ALL153")
"""Models that are fitted with a prior, which learns from the readings how wrong it is."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    payload_kg: Annotated[
        float | None, typer.Option(min=0.001, max=10_000, help="Hung mass; what the arm states if not given.")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, help="Noise of a reading along an axis.")
    ] = 50.0
    truth: Annotated[Literal["nonlinear", "linear"], typer.Option(help="Kind of truth.")] = "nonlinear"
    true_arm: Annotated[
        TrueArmName, typer.Option(help="The true arm; in the family the next one each seed.")
    ] = "family"
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
    true_arm: str = FAMILY  #: A name of `TRUTHS`, or all of them in turn.
    first: int = 1  #: The first seed: its errors are kept pose by pose.


@dataclass(frozen=True)
class Measured(DatasetRow):
    """What was measured."""

    poses: int
    identification_runs: int
    identification_points: int
    check_runs: int
    check_points: int
    workspace_poses: int


@dataclass(frozen=True)
class Residuals:
    """Residual components of the runs that were fitted, and of those that were not."""

    identification: NormalityRow
    check: NormalityRow


@dataclass(frozen=True)
class Judged(JudgedRow):
    """The same with its residuals."""

    residuals: Residuals


@dataclass(frozen=True)
class ModelRow(Judged):
    """The same with what it was measured from."""

    measured: Measured
    true_arm: str  #: Its name in `TRUTHS`; model and prior are those of the folder.
    template_is_true: bool  #: Whether the beam template holds the true compliances exactly.
    places: Places | None  #: Poses of the workspace; None but in the first seed.
    place_mm: tuple[float, ...] | None  #: Error in each of them.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    scenario = Scenario(
        arm=find_arm(options.arm).resolve().name,
        payload=options.payload_kg,
        sigma=options.sigma_um / 1e6,
        truth=options.truth,
        noise=options.noise,
        workspace_poses=QUICK_WORKSPACE if quick else 200,
    )
    scenario = of_arm(load_arm(options.arm), scenario)
    return Settings(options.arm, scenario, options.magnification, options.true_arm, seeds[0])


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[ModelRow]]:
    """Rows of some seeds, one a model."""
    cell = build_cell(find_arm(asked.arm))
    found = []
    for seed in seeds:
        true, campaign = calibrate(cell, asked, seed)
        arm = member(asked.true_arm, seed)
        found.append(rows(true, campaign, results(true, campaign), arm, mapped=seed == asked.first))
    return found


def calibrate(cell: Cell, asked: Settings, seed: int) -> tuple[Cell, Campaign]:
    """The same model of the true arm of a seed, and its campaign."""
    true = true_cell(cell, member(asked.true_arm, seed), seed)
    return true, simulate_at(true, asked.scenario, seed, draw_poses(cell, asked.scenario, seed))


def results(cell: Cell, campaign: Campaign) -> list[Result]:
    """The baselines and the paper's models, then structures with a prior that is wrong."""
    plain = named_models(cell, WITHOUT_PRIOR)
    plain.insert(WITHOUT_PRIOR.index("MLS56") + 1, equal_fit(cell))
    filled = with_priors(named_models(cell, WITH_PRIOR), wrong_prior(cell, campaign.seed))
    return identify(cell, campaign, [*plain, *filled], time.perf_counter)


def rows(
    cell: Cell, campaign: Campaign, results: Sequence[Result], arm: str, *, mapped: bool
) -> list[ModelRow]:
    """All models of one campaign of a true arm; `mapped` with their errors pose by pose."""
    pairs, data, exact = normalities(campaign, results), measured(campaign), template_is_true(cell)
    places = places_of(cell, campaign.truth) if mapped else None
    return [
        ModelRow(
            **vars(_judged(result, normal)),
            measured=data,
            true_arm=arm,
            template_is_true=exact,
            places=places,
            place_mm=kept_mm(result.places) if mapped else None,
        )
        for result, normal in zip(results, pairs, strict=True)
    ]


def _judged(result: Result, normal: tuple[Normality, Normality]) -> Judged:
    """One model of one campaign."""
    prior = result.estimate.belief is not None
    fit = fit_row(result.model.name, result.estimate, result.seconds, prior=prior)
    return Judged(**vars(judged_row(fit, result)), residuals=Residuals(*map(normality_row, normal)))


def template_is_true(cell: Cell) -> bool:
    """Whether MGCO56 holds the true links, joints put into them: then its structure cannot err."""
    structure = template56(cell.arm)
    C = aggregate(cell.plant.arm.C_theta, cell.vjm, structure)
    inside = structure.block_of >= 0
    missed = (C - structure.matrix(structure.entries(C)))[np.ix_(inside, inside)]
    scale = np.sqrt(np.diag(C)[inside])
    return bool(np.abs(missed / np.outer(scale, scale)).max() < SAME)


def normalities(campaign: Campaign, results: Sequence[Result]) -> list[tuple[Normality, Normality]]:
    """Of every model's residuals in the runs that were fitted, and in those that were not."""
    rng = stream(campaign.seed, 2)
    used = np.isin(campaign.measured.pose, campaign.identification.pose)
    fitted, others = (
        normality(np.array([result.residuals[runs].ravel() for result in results]), rng)
        for runs in (used, ~used)
    )
    return list(zip(fitted, others, strict=True))


def measured(campaign: Campaign) -> Measured:
    """Counts and deflections of a campaign."""
    every, fitted, check = campaign.measured, campaign.identification, campaign.check
    return Measured(
        **vars(dataset_row(every)),
        poses=len(np.unique(every.pose)),
        identification_runs=fitted.runs,
        identification_points=fitted.points,
        check_runs=check.runs,
        check_points=check.points,
        workspace_poses=campaign.truth.runs,
    )
