"""Section 5.2, a seed at a time: the paper's models and two baselines under two truths, and the order m."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import typer

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import Campaign, Cell, Truth, build_cell
from testbench.campaign.evaluation import CampaignRow, campaign_rows, identify, judge
from testbench.campaign.models import JOINTS, Model, named_models
from testbench.campaign.own_estimator import hired
from testbench.campaign.own_process import Own
from testbench.campaign.pose_campaign import FullPose, simulate
from testbench.identify import gco, paper_gco
from testbench.studies.paper import every_order
from testbench.studies.rivals import plain_models

MODELS = ("MLS56", "MLS32", "MGCO147", "MGCO69", "MGCO56")  #: The models of Table I, in the paper's order.
TRUTHS: tuple[Truth, ...] = ("linear", "nonlinear")
TUBES = "tubes"  #: The true arm: links as the folder has them.
CLOSE = 0.05  #: Share by which two errors may differ and still be nearly the same.
ORDER_MODELS = ("MGCO69", "MGCO56")
ORDER_SEEDS, QUICK_ORDER_SEEDS = 20, 1
ORDER_STARTS, QUICK_ORDER_STARTS = 5, 2


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "arm_6r"
    per: Annotated[
        Literal["deflection", "reading"],
        typer.Option(help="What the noise of 25 um and 250 urad is that of."),
    ] = "deflection"
    magnification: Annotated[
        float, typer.Option(min=1, max=10_000, help="Of the deflections drawn in the recording.")
    ] = 10.0


@dataclass(frozen=True, kw_only=True)
class Settings(Options):
    """What is tried."""

    scenario: FullPose  #: What is measured; its truth is replaced by each in turn.
    first: int  #: The first seed.
    ordered: int  #: Seeds, from the first, in which the order m is studied too.
    starts: int  #: Local solves of every order m: below 6 there are local minima that are not global.


@dataclass(frozen=True)
class SixDofRow(CampaignRow):
    """One fit: of a model under one truth, or of one order m. Errors are of the check runs."""

    truth: Truth = "linear"  #: Kind of truth.
    m: int = 0  #: Order of the vector space of Eq. (16); 0 where the model's own method was used.
    f_m_over_optimum: float | None = None  #: F_M, the best of some local solves, over the least possible.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    share = math.sqrt(2) if options.per == "deflection" else 1.0
    scenario = FullPose(
        arm=find_arm(options.arm).resolve().name,
        sigma=25e-6 / share,
        sigma_rotation=250e-6 / share,
        least=9e-3,
        most=41e-3,
    )
    return Settings(
        **vars(options),
        scenario=scenario,
        first=seeds[0],
        ordered=min(len(seeds), QUICK_ORDER_SEEDS if quick else ORDER_SEEDS),
        starts=QUICK_ORDER_STARTS if quick else ORDER_STARTS,
    )


def trials(asked: Settings, seeds: Sequence[int], own: Sequence[Own] = ()) -> list[list[SixDofRow]]:
    """Rows of some seeds: all models under two truths, and in the first seeds every order m."""
    cell = build_cell(find_arm(asked.arm))
    every = [*models(cell), *hired(own)(cell, None)]
    return [list(_trial(cell, every, asked, seed)) for seed in seeds]


def models(cell: Cell) -> list[Model]:
    """The models of Table I, what holds their least squares down, and the incumbent; GCO is the paper's."""
    every = plain_models(cell, (*MODELS, JOINTS))
    return [replace(model, estimator=paper_gco) if model.estimator == gco else model for model in every]


def _trial(cell: Cell, models: Sequence[Model], asked: Settings, seed: int) -> Iterator[SixDofRow]:
    for truth in TRUTHS:
        campaign = simulate(cell, asked.scenario.model_copy(update={"truth": truth}), seed)
        results, linear = identify(cell, campaign, models, time.perf_counter), truth == "linear"
        for row in campaign_rows(cell, campaign, results, TUBES, placed=linear and seed == asked.first):
            yield SixDofRow(**vars(row), truth=truth)
        if linear and seed < asked.first + asked.ordered:
            for name in ORDER_MODELS:
                yield from _orders(cell, campaign, name, asked.starts)


def _orders(cell: Cell, campaign: Campaign, name: str, starts: int) -> Iterator[SixDofRow]:
    """F_M and check error of every order m of one model."""
    [model] = named_models(cell, [name])
    best = paper_gco(cell.vjm, model.structure, campaign.identification).f_m
    estimates = every_order(cell, model.structure, campaign.identification, starts, campaign.seed)
    results = [judge(cell, campaign, model, estimate, 0.0) for estimate in estimates]
    rows = campaign_rows(cell, campaign, results, TUBES, placed=False)
    for m, (row, estimate) in enumerate(zip(rows, estimates, strict=True), start=1):
        yield SixDofRow(**vars(row), m=m, f_m_over_optimum=estimate.f_m / best)
