"""What noise costs: tracker noise from none to 200 um by method and structure, and better instruments.

Three parts. `six_dof`: the 108 runs of section 5.2, both positions and orientations, linear truth. `gravity`:
the KR 500 under its payload, 8 poses, non-linear truth, judged all over the workspace. `instrument`: the same
poses read by laser trackers near and far, weighted or not. All levels of a trial share their random numbers,
so that differences between levels and methods are theirs alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, equal_fit
from testbench.bench.campaign import (
    Campaign,
    Cell,
    Model,
    Scenario,
    Truth,
    build_cell,
    draw_poses,
    identify_each,
    named_models,
    simulate_at,
    stream,
)
from testbench.bench.full_pose import FullPose
from testbench.bench.full_pose import simulate as simulate_full_pose
from testbench.bench.rows import DatasetRow, dataset_row
from testbench.bench.wrong_prior import with_wrong_prior
from testbench.errors import BenchError
from testbench.studies.noise_sensitivity.fits import FitRow, judged, reread
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA, readings

NAME = "noise_sensitivity"
LIGHT, HEAVY = "arm_6r", "kr500_l480"
SIX_DOF = (JOINTS, "MLS32", "MLS56", "MGCO56", "MGCO69", "MGCO147")
GRAVITY = (JOINTS, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""Without a prior: the incumbent, and the models of sections 5.2 and 6."""
SIX_DOF_PRIOR, GRAVITY_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO69"), (JOINTS, "MLS56", "MGCO56", "MGCO68")
INSTRUMENT = ("MGCO56",)
"""Those that are fitted with a prior too; instruments are compared by the last one alone."""
MOST_UM = 10_000.0  #: Largest noise that an instrument can have [um].

Part = Literal["six_dof", "gravity", "instrument_linear", "instrument_nonlinear"]
TRUTHS: dict[Part, Truth] = {
    "six_dof": "linear",
    "gravity": "nonlinear",
    "instrument_linear": "linear",
    "instrument_nonlinear": "nonlinear",
}
INSTRUMENT_PARTS: tuple[Part, ...] = ("instrument_linear", "instrument_nonlinear")


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    sigma_um: Annotated[
        list[float] | None, typer.Option(help="Noise of a reading along an axis, beside 0; again for more.")
    ] = None


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    first: int  #: The first seed of all: the parts with fewer trials have the first ones.
    sigmas: tuple[float, ...] = (0.0, 10e-6, 25e-6, 50e-6, 100e-6, 200e-6)  #: Of a reading along an axis [m].
    gravity_trials: int = 200  #: So many of the trials have the gravity part too.
    instrument_trials: int = 100  #: So many have the part of the instruments.
    distances: tuple[float, ...] = (2.0, 4.0, 8.0, 15.0)  #: Of the tracker from the work area [m].


@dataclass(frozen=True)
class NoiseRow(FitRow):
    """One fit of one trial."""

    part: Part
    x: float  #: Noise of a reading along an axis, or distance of the instrument [m].
    measured: DatasetRow | None = None  #: The dataset of the gravity part at 50 um.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for: levels ascending, no noise at all among them.

    Raises:
        BenchError: When a level is out of range or there twice, or none is above 0.
    """
    found = Settings(seeds[0])
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
    light, cell = build_cell(find_arm(LIGHT)), build_cell(find_arm(HEAVY))
    light_models, models = _plain(light, SIX_DOF), _plain(cell, GRAVITY)
    found = []
    for seed in seeds:
        rows = list(_six_dof(light, with_wrong_prior(light, light_models, SIX_DOF_PRIOR, seed), asked, seed))
        gravity = seed - asked.first < asked.gravity_trials
        instruments = seed - asked.first < asked.instrument_trials
        if gravity or instruments:
            clean = _campaigns(cell, seed)
        if gravity:
            rows += _gravity(
                cell, with_wrong_prior(cell, models, GRAVITY_PRIOR, seed), asked, clean["gravity"]
            )
        if instruments:
            rows += _instruments(cell, with_wrong_prior(cell, models, INSTRUMENT, seed)[-1], asked, clean)
        found.append(rows)
    return found


def _plain(cell: Cell, names: Sequence[str]) -> list[Model]:
    """Models without a prior; beside MLS56 stands what is conservative and fits as well."""
    models = named_models(cell, names)
    models.insert(names.index("MLS56") + 1, equal_fit(cell))
    return models


def _campaigns(cell: Cell, seed: int) -> dict[Part, Campaign]:
    """Campaigns under gravity without noise, in the same poses."""
    scenario = Scenario(arm=cell.arm.name, noise=False)
    poses = draw_poses(cell, scenario, seed)
    bent = simulate_at(cell, scenario, seed, poses)
    linear = simulate_at(cell, scenario.model_copy(update={"truth": "linear"}), seed, poses)
    return {"gravity": bent, "instrument_nonlinear": bent, "instrument_linear": linear}


def _six_dof(cell: Cell, models: Sequence[Model], asked: Settings, seed: int) -> Iterator[NoiseRow]:
    scenario = FullPose(arm=cell.arm.name, least=9e-3, most=41e-3, noise=False)
    campaign = simulate_full_pose(cell, scenario, seed)
    for sigma, found in _levels(cell, models, asked, campaign):
        yield NoiseRow(**vars(found), part="six_dof", x=sigma)


def _gravity(cell: Cell, models: Sequence[Model], asked: Settings, campaign: Campaign) -> Iterator[NoiseRow]:
    measured = dataset_row(reread(campaign.identification, FLAT_SIGMA, stream(campaign.seed, 1)))
    for sigma, found in _levels(cell, models, asked, campaign):
        yield NoiseRow(**vars(found), part="gravity", x=sigma, measured=measured)


def _levels(
    cell: Cell, models: Sequence[Model], asked: Settings, campaign: Campaign
) -> Iterator[tuple[float, FitRow]]:
    """Every level of noise with the fits of all models."""
    data = [reread(campaign.identification, sigma, stream(campaign.seed, 1)) for sigma in asked.sigmas]
    fits = [judged(cell, model, identify_each(cell, model, data), campaign.truth) for model in models]
    for sigma, found in zip(asked.sigmas, zip(*fits, strict=True), strict=True):
        yield from ((sigma, row) for row in found)


def _instruments(
    cell: Cell, model: Model, asked: Settings, clean: Mapping[Part, Campaign]
) -> Iterator[NoiseRow]:
    """The same poses read by several instruments, MGCO56 with prior; linear truth tells their noise alone."""
    for part in INSTRUMENT_PARTS:
        data, seed = clean[part].identification, clean[part].seed
        flat = reread(data, FLAT_SIGMA, stream(seed, 1))
        names, distances, read = zip(*readings(data, flat, asked.distances, seed), strict=True)
        fits = judged(cell, model, identify_each(cell, model, read), clean[part].truth)
        for name, distance, found in zip(names, distances, fits, strict=True):
            yield NoiseRow(**vars(replace(found, model=name)), part=part, x=distance)
