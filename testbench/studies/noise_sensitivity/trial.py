"""What noise costs: tracker noise from none to 200 um by method and structure, and better instruments.

Every trial has a true arm of the family, the next one in turn; the model and the prior stay the folder's.
Three parts. `six_dof`: the 108 runs of section 5.2, both positions and orientations, linear truth. `gravity`:
the KR 500 under its payload, 8 poses, non-linear truth, judged all over the workspace. `instrument`: the same
poses read by laser trackers near and far, weighted or not, all identified by one model; weighted or not near
by also by the model that `identify` takes. All levels of a trial share their random numbers, so that
differences between levels and methods are theirs alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import (
    Campaign,
    Cell,
    Scenario,
    Truth,
    build_cell,
    draw_poses,
    simulate_at,
    stream,
)
from testbench.bench.campaign_flags import TrueArmFlag
from testbench.bench.default import DEFAULT
from testbench.bench.full_pose import FullPose
from testbench.bench.full_pose import simulate as simulate_full_pose
from testbench.bench.judged import identify_each
from testbench.bench.models import Model
from testbench.bench.rows import UM, dataset_row
from testbench.bench.truths import FAMILY, member, true_cell
from testbench.errors import BenchError
from testbench.studies.noise_sensitivity.fits import (
    TrialRow,
    judged,
    plain_models,
    reread,
    with_wrong_priors,
)
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA, NEAR, UNWEIGHTED, WEIGHTED, readings

NAME = "noise_sensitivity"
LIGHT, HEAVY = "arm_6r", "kr500_l480"
SIX_DOF = (JOINTS, "MLS32", "MLS56", "MGCO56", "MGCO69", "MGCO147")
GRAVITY = (JOINTS, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""Without a prior: the incumbent, and the models of sections 5.2 and 6."""
SIX_DOF_PRIOR, GRAVITY_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO69"), (JOINTS, "MLS56", "MGCO56", "MGCO68")
"""Those that are fitted with a prior too."""
INSTRUMENT = "MGCO56 + prior"  #: Instruments are compared by this model alone.
MOST_UM = 10_000.0  #: Largest noise that an instrument can have [um].

Part = Literal["six_dof", "gravity", "instrument"]


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    sigma_um: Annotated[
        list[float] | None, typer.Option(help="Noise of a reading along an axis, beside 0; again for more.")
    ] = None
    true_arm: TrueArmFlag = FAMILY


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    first: int  #: The first seed of all: the parts with fewer trials have the first ones.
    sigmas: tuple[float, ...] = (0.0, 10e-6, 25e-6, 50e-6, 100e-6, 200e-6)  #: Of a reading along an axis [m].
    gravity_trials: int = 200  #: So many of the trials have the gravity part too.
    instrument_trials: int = 100  #: So many have the part of the instruments.
    distances: tuple[float, ...] = (2.0, 4.0, 8.0, 15.0)  #: Of the tracker from the work area [m].
    true_arm: str = FAMILY  #: One of TRUTHS, or the family in turn.


@dataclass(frozen=True, kw_only=True)
class NoiseRow(TrialRow):
    """One fit of one trial."""

    part: Part
    truth: Truth
    sigma_um: float | None = None  #: Noise of a reading along an axis; None of an instrument.
    instrument: str | None = None  #: None of noise alike along all axes.
    distance_m: float | None = None  #: Of the instrument; 0 of the one that reads alike wherever it stands.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for: levels ascending, no noise at all among them.

    Raises:
        BenchError: When a level is out of range or there twice, or none is above 0.
    """
    found = Settings(seeds[0], true_arm=options.true_arm)
    if quick:
        found = replace(found, gravity_trials=2, instrument_trials=1, distances=(4.0,))
    levels = options.sigma_um
    if not levels:
        return found
    for value in levels:
        if not 0 <= value <= MOST_UM or levels.count(value) > 1:
            raise BenchError(f"--sigma-um: expected different values of 0 to {MOST_UM:g}, got {value:g}")
    if max(levels) == 0:
        raise BenchError("--sigma-um: expected at least one level above 0")
    return replace(found, sigmas=tuple(value / 1e6 for value in sorted({0.0, *levels})))


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[NoiseRow]]:
    """Rows of some seeds, one a fit."""
    light, heavy = build_cell(find_arm(LIGHT)), build_cell(find_arm(HEAVY))
    light_plain, heavy_plain = plain_models(light, SIX_DOF), plain_models(heavy, GRAVITY)
    found = []
    for seed in seeds:
        true_arm = member(asked.true_arm, seed)
        models = with_wrong_priors(light, light_plain, SIX_DOF_PRIOR, seed)
        rows = list(_six_dof(true_cell(light, true_arm, seed), models, asked, seed))
        gravity = seed - asked.first < asked.gravity_trials
        instruments = seed - asked.first < asked.instrument_trials
        if gravity or instruments:
            models = with_wrong_priors(heavy, heavy_plain, GRAVITY_PRIOR, seed)
            cell = true_cell(heavy, true_arm, seed)
            clean = _campaigns(cell, seed)
        if gravity:
            rows += _gravity(cell, models, asked, clean["nonlinear"])
        if instruments:
            rows += _instruments(cell, {m.name: m for m in models}, asked, clean)
        found.append(rows)
    return found


def _campaigns(cell: Cell, seed: int) -> dict[Truth, Campaign]:
    """Campaigns under gravity without noise, in the same poses."""
    scenario = Scenario(arm=cell.arm.name, noise=False)
    poses = draw_poses(cell, scenario, seed)
    bent = simulate_at(cell, scenario, seed, poses)
    linear = simulate_at(cell, scenario.model_copy(update={"truth": "linear"}), seed, poses)
    return {"linear": linear, "nonlinear": bent}


def _six_dof(cell: Cell, models: Sequence[Model], asked: Settings, seed: int) -> Iterator[NoiseRow]:
    scenario = FullPose(arm=cell.arm.name, least=9e-3, most=41e-3, noise=False)
    return _levels(cell, models, asked, simulate_full_pose(cell, scenario, seed), "six_dof")


def _gravity(cell: Cell, models: Sequence[Model], asked: Settings, campaign: Campaign) -> Iterator[NoiseRow]:
    measured = dataset_row(reread(campaign.identification, FLAT_SIGMA, stream(campaign.seed, 1)))
    return (replace(row, measured=measured) for row in _levels(cell, models, asked, campaign, "gravity"))


def _levels(
    cell: Cell, models: Sequence[Model], asked: Settings, campaign: Campaign, part: Part
) -> Iterator[NoiseRow]:
    """Every level of noise with the fits of all models."""
    data = [reread(campaign.identification, sigma, stream(campaign.seed, 1)) for sigma in asked.sigmas]
    fits = [judged(cell, model, identify_each(cell, model, data), campaign.truth) for model in models]
    for sigma, found in zip(asked.sigmas, zip(*fits, strict=True), strict=True):
        for row in found:
            yield NoiseRow(
                **vars(row),
                true_arm=member(asked.true_arm, campaign.seed),
                part=part,
                truth=campaign.scenario.truth,
                sigma_um=UM * sigma,
            )


def _instruments(
    cell: Cell, models: Mapping[str, Model], asked: Settings, clean: Mapping[Truth, Campaign]
) -> Iterator[NoiseRow]:
    """The same poses read by several instruments; by the default model, the two ways of weighting alone."""
    for truth, campaign in clean.items():
        data, seed = campaign.identification, campaign.seed
        read = list(readings(data, reread(data, FLAT_SIGMA, stream(seed, 1)), asked.distances, seed))
        weights = [own for own in read if own[0] in (WEIGHTED, UNWEIGHTED) and own[1] == NEAR]
        for by, some in ((INSTRUMENT, read), (DEFAULT, weights)):
            names, distances, sets = zip(*some, strict=True)
            fits = judged(cell, models[by], identify_each(cell, models[by], sets), campaign.truth)
            for name, distance, row in zip(names, distances, fits, strict=True):
                yield NoiseRow(
                    **vars(row),
                    true_arm=member(asked.true_arm, seed),
                    part="instrument",
                    truth=truth,
                    instrument=name,
                    distance_m=distance,
                )
