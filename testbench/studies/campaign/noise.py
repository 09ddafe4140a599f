"""Levels of noise by two ways of reading, and laser trackers near and far.

Every trial has a true arm of the family, the next one in turn; the model and the prior stay the folder's.
Three parts. `six_dof`: the 108 runs of section 5.2, both positions and orientations, linear truth. `gravity`:
the KR 500 under its payload, 8 poses, non-linear truth, judged all over the workspace. `instrument`: the same
poses read by laser trackers near and far, weighted or not, all identified by one model; weighted or not near
by also by the model that `identify` takes.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.errors import BenchError
from testbench.plant.tracker import trial_rng
from testbench.plant.true_arms import FAMILY, true_arm_of_seed
from testbench.studies.campaign.instruments import UNWEIGHTED, WEIGHTED, readings
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    TrialCase,
    each_seed,
    fitted,
    reread,
    score_cases,
    with_wrong_priors,
)
from testbench.workflows.campaign_flags import TrueArmFlag
from testbench.workflows.cell import Campaign, Cell, Scenario, build_cell, draw_poses, simulate_at, true_cell
from testbench.workflows.model_selection import DEFAULT
from testbench.workflows.models import JOINTS, Model
from testbench.workflows.own_estimator import Models
from testbench.workflows.pose_campaign import FullPose
from testbench.workflows.pose_campaign import simulate as simulate_full_pose
from testbench.workflows.rows import UM

LIGHT, HEAVY = "arm_6r", "kr500_l480"
SIX_DOF = (JOINTS, "MLS32", "MLS56", "MGCO56", "MGCO69", "MGCO147")
GRAVITY = (JOINTS, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""Without a prior: the incumbent, and the models of sections 5.2 and 6."""
SIX_DOF_PRIOR, GRAVITY_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO69"), (JOINTS, "MLS56", "MGCO56", "MGCO68")
"""Those that are fitted with a prior too."""
INSTRUMENT = "MGCO56 + prior"  #: Instruments are compared by this model alone.
MAX_UM = 10_000.0  #: Largest noise that an instrument can have [um].
FLAT_SIGMA = 50e-6  #: Noise of the instrument that reads all axes alike, wherever it stands [m].
NEAR = 4.0  #: Distance at which instruments are compared [m].


@dataclass(frozen=True)
class NoiseOptions:
    """Flags of the study."""

    sigma_um: Annotated[
        list[float] | None, typer.Option(metavar="UM", help="Noise per axis, beside 0; repeatable.")
    ] = None
    true_arm: TrueArmFlag = FAMILY


@dataclass(frozen=True)
class NoiseSettings:
    """What is tried."""

    first: int  #: The first seed of all: the parts with fewer trials have the first ones.
    sigmas: tuple[float, ...] = (0.0, 10e-6, 25e-6, 50e-6, 100e-6, 200e-6)  #: Of a reading along an axis [m].
    gravity_trials: int = 200  #: So many of the trials have the gravity part too.
    instrument_trials: int = 100  #: So many have the part of the instruments.
    distances: tuple[float, ...] = (2.0, 4.0, 8.0, 15.0)  #: Of the tracker from the work area [m].
    true_arm: str = FAMILY  #: One of TRUTHS, or the family in turn.


def settings(options: NoiseOptions, quick: bool, seeds: range) -> NoiseSettings:
    """What the flags ask for: levels ascending, no noise at all among them.

    Raises:
        BenchError: When a level is out of range or there twice, or none is above 0.
    """
    found = NoiseSettings(seeds[0], true_arm=options.true_arm)
    if quick:
        found = replace(found, gravity_trials=2, instrument_trials=1, distances=(4.0,))
    levels = options.sigma_um
    if not levels:
        return found
    for value in levels:
        if not 0 <= value <= MAX_UM or levels.count(value) > 1:
            raise BenchError(f"--sigma-um: expected different values of 0 to {MAX_UM:g}, got {value:g}")
    if max(levels) == 0:
        raise BenchError("--sigma-um: expected at least one level above 0")
    return replace(found, sigmas=tuple(value / 1e6 for value in sorted({0.0, *levels})))


@each_seed
def trials(asked: NoiseSettings, seed: int, own: Models) -> Iterator[CampaignFitRow]:
    """Rows of a seed, one a fit."""
    arm = true_arm_of_seed(asked.true_arm, seed)
    light, heavy = build_cell(find_arm(LIGHT)), build_cell(find_arm(HEAVY))
    cell, models = true_cell(light, arm, seed), with_wrong_priors(light, SIX_DOF, SIX_DOF_PRIOR, seed, own)
    scenario = FullPose(arm=LIGHT, least=9e-3, most=41e-3, noise=False)
    levels = _levels(asked, "six_dof", arm, simulate_full_pose(cell, scenario, seed))
    yield from score_cases(cell, levels, fitted(cell, models, levels))
    gravity, instruments = (seed - asked.first < n for n in (asked.gravity_trials, asked.instrument_trials))
    if gravity or instruments:
        cell, models = (
            true_cell(heavy, arm, seed),
            with_wrong_priors(heavy, GRAVITY, GRAVITY_PRIOR, seed, own),
        )
        linear, bent = _campaigns(cell, seed)
    if gravity:
        levels = _levels(asked, "gravity", arm, bent)
        yield from score_cases(cell, levels, fitted(cell, models, levels))
    if instruments:
        named = {model.name: model for model in models}
        for campaign in (linear, bent):
            yield from _instruments(cell, named, asked, arm, campaign)


def _campaigns(cell: Cell, seed: int) -> list[Campaign]:
    """Campaigns under gravity without noise, in the same poses: linear truth, then non-linear."""
    bent = Scenario(arm=HEAVY, noise=False)
    poses = draw_poses(cell, bent, seed)
    linear = bent.model_copy(update={"truth": "linear"})
    return [simulate_at(cell, scenario, seed, poses) for scenario in (linear, bent)]


def _levels(asked: NoiseSettings, part: str, arm: str, campaign: Campaign) -> list[TrialCase]:
    """Every level of noise."""
    clean, seed = campaign.identification, campaign.seed
    factors = {"part": part, "truth": campaign.scenario.truth, "true_arm": arm}
    cases = [
        TrialCase(
            reread(clean, sigma, trial_rng(seed, 1)), campaign.truth, {**factors, "sigma_um": UM * sigma}
        )
        for sigma in asked.sigmas
    ]
    if (part, seed) == ("gravity", asked.first):
        cases[0] = replace(cases[0], saved=reread(clean, FLAT_SIGMA, trial_rng(seed, 1)))
    return cases


def _instruments(
    cell: Cell, models: Mapping[str, Model], asked: NoiseSettings, arm: str, campaign: Campaign
) -> Iterator[CampaignFitRow]:
    """The same poses read by several instruments; by the default model, the two ways of weighting alone."""
    clean, seed = campaign.identification, campaign.seed
    same = {"part": "instrument", "truth": campaign.scenario.truth, "true_arm": arm}
    flat = reread(clean, FLAT_SIGMA, trial_rng(seed, 1))
    read = [
        TrialCase(runs, campaign.truth, {**same, "instrument": name, "distance_m": x})
        for name, x, runs in readings(clean, flat, asked.distances, seed)
    ]
    weights = [
        case
        for case in read
        if case.factors["instrument"] in (WEIGHTED, UNWEIGHTED) and case.factors["distance_m"] == NEAR
    ]
    for name, cases in ((INSTRUMENT, read), (DEFAULT, weights)):
        yield from score_cases(cell, cases, fitted(cell, [models[name]], cases))
