"""One trial: every truth of the family with one prior each, and every method in few and in many poses.

The KR 500 under its payload as in section 6, readings of 50 um, non-linear truth. All truths of a trial stand
in the same poses, and fewer poses are the first of them. Over as many trials as there are priors every truth
meets every prior once: a Latin square.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import (
    Campaign,
    Cell,
    Model,
    Scenario,
    build_cell,
    draw_poses,
    identify_each,
    simulate_at,
    stream,
)
from testbench.bench.rows import MM
from testbench.bench.truths import TRUTHS, distance_from_tubes, true_cell
from testbench.bench.wrong_prior import PRIORS, prior_of
from testbench.data.dataset import Dataset, select
from testbench.identify import Constraint, Estimate
from testbench.identify.evaluate import predict_all, score
from testbench.studies.noise_sensitivity.fits import reread
from testbench.studies.which_model.methods import filled, to_fill, without_prior
from testbench.trials.spread import Share

NAME = "which_model"
POSES = (8, 12, 20)  #: From how many is identified; the last one is how many there are.
CHECK_POSES = 3
RUNS = 2  #: In every pose.
QUICK_WORKSPACE = 40


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 200  #: Poses in which the models are judged.


@dataclass(frozen=True)
class Case:
    """A true arm, and a prior that is known of it."""

    truth: str  #: Its name.
    prior: str  #: Name of the prior, which not every method knows.
    off_tubes: float  #: Median distance of the true links from tubes [1].
    #: RMS error over the workspace of the folder's compliances as they are [mm].
    cad_mm: float


@dataclass(frozen=True)
class FitRow:
    """One method in one case."""

    case: Case
    poses: int  #: From how many was identified.
    method: str
    structure: str
    constraint: Constraint
    filled: bool  #: Whether it knows the prior.
    workspace_mm: float  #: RMS error over the workspace, against the truth.
    check_mm: float  #: RMS error at check poses, against the truth.
    misfit: float  #: F_M over the floor to expect of noise [1].
    conservative: Share
    solved: Share  #: Whether the method found what it looks for.


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for."""
    return Settings(options.arm, workspace=QUICK_WORKSPACE if quick else Settings.workspace)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[FitRow]]:
    """Rows of some seeds, one a truth, method and number of poses."""
    cell = build_cell(find_arm(asked.arm))
    plain, bare = without_prior(cell), to_fill(cell)
    found = []
    for seed in seeds:
        poses = draw_poses(cell, scenario(asked), seed)
        rows: list[FitRow] = []
        for truth, prior in pairs(seed):
            true = true_cell(cell, truth, seed)
            campaign = simulate_at(true, scenario(asked), seed, poses)
            models = [*plain, *filled(bare, prior_of(cell, prior, seed))]
            rows += _fits(true, models, campaign, (truth, prior))
        found.append(rows)
    return found


def pairs(seed: int) -> list[tuple[str, str]]:
    """The truths of a trial, each with its prior: a row of a Latin square."""
    priors = list(PRIORS)
    return [(truth, priors[(k + seed) % len(priors)]) for k, truth in enumerate(TRUTHS)]


def scenario(asked: Settings) -> Scenario:
    """What is measured, without noise."""
    return Scenario(
        arm=find_arm(asked.arm).name,
        noise=False,
        sigma=asked.sigma,
        identification_poses=POSES[-1],
        identification_runs=RUNS * POSES[-1],
        check_poses=CHECK_POSES,
        check_runs=CHECK_POSES,
        workspace_poses=asked.workspace,
    )


def read(campaign: Campaign) -> list[Dataset]:
    """The runs in few and in many poses, with noise."""
    every = reread(campaign.identification, campaign.scenario.sigma, stream(campaign.seed, 1))
    return [select(every, every.pose <= poses) for poses in POSES]


def _fits(
    cell: Cell, models: Sequence[Model], campaign: Campaign, names: tuple[str, str]
) -> Iterator[FitRow]:
    data = read(campaign)
    fits = [(model, identify_each(cell, model, data)) for model in models]
    as_it_is = replace(fits[0][1][0], C_theta=cell.arm.C_theta)
    case = Case(*names, _off_tubes(cell), *_errors_mm(cell, [as_it_is], campaign.truth))
    for model, found in fits:
        workspace, check = (_errors_mm(cell, found, own) for own in (campaign.truth, campaign.check))
        for k, estimate in enumerate(found):
            yield FitRow(
                case,
                poses=POSES[k],
                method=model.name,
                structure=estimate.structure.name,
                constraint=estimate.constraint,
                filled=estimate.belief is not None,
                workspace_mm=workspace[k],
                check_mm=check[k],
                misfit=estimate.f_m / estimate.f_m_floor,
                conservative=estimate.conservative,
                solved=estimate.status == "solved",
            )


def _errors_mm(cell: Cell, estimates: Sequence[Estimate], truth: Dataset) -> list[float]:
    """RMS errors against true deflections [mm]."""
    moved = predict_all(cell.vjm, estimates, truth)
    return [MM * score(own, truth.deflection).rms for own in moved]


def _off_tubes(cell: Cell) -> float:
    return float(np.median([distance_from_tubes(link.compliance) for link in cell.plant.arm.links]))
