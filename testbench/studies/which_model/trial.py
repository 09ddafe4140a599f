"""One trial: every truth of the family with one prior each, and every method in few and in many poses.

The KR 500 under its payload as in section 6, readings of 50 um, non-linear truth. All truths of a trial stand
in the same poses, and fewer poses are the first of them. Over as many trials as there are priors every truth
meets every prior once: a Latin square.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, equal_fit
from testbench.bench.campaign import Campaign, Cell, Scenario, build_cell, draw_poses, simulate_at, stream
from testbench.bench.default import choose, with_priors
from testbench.bench.judged import identify_each
from testbench.bench.models import MODELS, Model, named_models
from testbench.bench.truths import TRUTHS, true_cell
from testbench.bench.wrong_prior import PRIORS, prior_of
from testbench.data.dataset import Dataset, select
from testbench.identify import Constraint, Estimate, least_squares
from testbench.identify.prior import Prior
from testbench.studies.factorial.trial import reread
from testbench.studies.which_model.judge import Case, Cover, Doubted, Error, case_of, cover, doubted, errors
from testbench.trials.spread import Share

POSES = (8, 12, 20)  #: From how many is identified; the last one is how many there are.
CHECK_POSES = 3
RUNS = 2  #: In every pose.
QUICK_WORKSPACE = 40
CHOSEN = "default"  #: What `bench.default` chooses from the readings.
COVERED = (CHOSEN, JOINTS, "MGCO56 + prior", "ALL153 + prior")
"""Whose intervals are judged; those of joints alone show what noise alone would promise."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    stiffer: Annotated[
        float, typer.Option(min=0.01, max=1e4, help="How many times stiffer the true links are.")
    ] = 1.0


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 200  #: Poses in which the models are judged.
    stiffer: float = 1.0  #: How many times stiffer the true links are than the folder's.


@dataclass(frozen=True)
class Fit:
    """A method's estimate in one case."""

    method: str
    estimate: Estimate
    chosen: str | None = None  #: Of the default: the method that it chose.


@dataclass(frozen=True)
class FitRow:
    """One method in one case; the case as in `Case`."""

    true_arm: str
    prior_error: str
    off_tubes_percent: float
    cad_mm: float
    wrong: str | None
    link_share: float | None
    poses: int  #: From how many was identified.
    name: str  #: Of the method.
    structure: str
    constraint: Constraint
    prior: bool  #: Whether it knows the prior.
    workspace: Error
    check_true: Error
    misfit: float  #: F_M over the floor to expect of noise [1].
    conservative: Share
    solved: Share  #: Whether the method found what it looks for.
    chosen: str | None  #: Of the default: the method that it chose.
    cover: Cover | None  #: Of the methods whose intervals are judged.
    doubted: Doubted | None  #: Of the default.


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for."""
    workspace = QUICK_WORKSPACE if quick else Settings.workspace
    return Settings(options.arm, workspace=workspace, stiffer=options.stiffer)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[FitRow]]:
    """Rows of some seeds, one a truth, method and number of poses."""
    cell = build_cell(find_arm(asked.arm))
    plain, bare = without_prior(cell), to_fill(cell)
    found = []
    for seed in seeds:
        poses = draw_poses(cell, scenario(asked), seed)
        rows: list[FitRow] = []
        for truth, name in pairs(seed):
            true, prior = true_cell(cell, truth, seed, asked.stiffer), prior_of(cell, name, seed)
            campaign = simulate_at(true, scenario(asked), seed, poses)
            fits = identified(true, [*plain, *with_priors(bare, prior)], read(campaign), prior)
            case = case_of(true, (truth, name), campaign, fits[0].estimate)
            rows += _rows(true, case, campaign, fits, prior)
        found.append(rows)
    return found


def without_prior(cell: Cell) -> list[Model]:
    """Methods that know of no prior."""
    joints, mls56, *others = named_models(cell, (JOINTS, "MLS56", "MGCO56", "MGCO68"))
    return [joints, mls56, equal_fit(cell), *others]


def to_fill(cell: Cell) -> list[Model]:
    """Methods that are fitted with a prior, learnt from the readings."""
    mgco56 = MODELS["MGCO56"](cell)
    return [
        MODELS[JOINTS](cell),
        replace(mgco56, name="MLS56", estimator=least_squares),
        mgco56,
        MODELS["MGCO68"](cell),
        MODELS["ALL153"](cell),
    ]


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


def identified(cell: Cell, models: Sequence[Model], data: Sequence[Dataset], prior: Prior) -> list[Fit]:
    """What is chosen by default, then every method, from few and from many poses."""
    found = []
    for runs in data:
        own = choose(cell, runs, prior)
        found.append(Fit(CHOSEN, own.estimate, own.name))
    for model in models:
        found += [Fit(model.name, estimate) for estimate in identify_each(cell, model, data)]
    return found


def _rows(cell: Cell, case: Case, campaign: Campaign, fits: Sequence[Fit], prior: Prior) -> Iterator[FitRow]:
    estimates = [fit.estimate for fit in fits]
    workspace, check = (errors(cell, estimates, own) for own in (campaign.truth, campaign.check))
    for k, (fit, estimate) in enumerate(zip(fits, estimates, strict=True)):
        yield FitRow(
            **vars(case),
            poses=POSES[k % len(POSES)],
            name=fit.method,
            structure=estimate.structure.name,
            constraint=estimate.constraint,
            prior=estimate.belief is not None,
            workspace=workspace[k],
            check_true=check[k],
            misfit=estimate.f_m / estimate.f_m_floor,
            conservative=estimate.conservative,
            solved=estimate.status == "solved",
            chosen=fit.chosen,
            cover=cover(cell, estimate, campaign.truth) if fit.method in COVERED else None,
            doubted=None if fit.chosen is None else doubted(cell, case, estimate, prior),
        )
