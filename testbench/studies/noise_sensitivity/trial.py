"""What noise costs: tracker noise from none to 200 um by method and structure, and better instruments.

Three parts. `six_dof`: the 108 runs of section 5.2, both positions and orientations, linear truth. `gravity`:
the KR 500 under its payload, 8 poses, non-linear truth, judged all over the workspace. `instrument`: the same
poses read by laser trackers near and far, weighted or not. All levels of a trial share their random numbers,
so that differences between levels and methods are theirs alone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, Model, Scenario, Truth, build_cell, named_models, simulate, stream
from testbench.bench.full_pose import FullPose
from testbench.bench.full_pose import simulate as simulate_full_pose
from testbench.bench.rows import UM, DatasetRow, dataset_row
from testbench.bench.wrong_prior import with_wrong_prior
from testbench.data.dataset import Dataset
from testbench.data.tracker import Tracker, read_orientations, read_positions
from testbench.errors import BenchError
from testbench.identify import Constraint, Estimate
from testbench.identify.evaluate import predict, score
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA, readings
from testbench.trials.spread import Number, Share

NAME = "noise_sensitivity"
LIGHT, HEAVY = "arm_6r", "kr500_l480"
SIX_DOF = ("MLS32", "MLS56", "MGCO56", "MGCO69", "MGCO147")  #: Models of section 5.2 without a prior.
GRAVITY = ("MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")  #: Models of section 6 without a prior.
SIX_DOF_PRIOR, GRAVITY_PRIOR, INSTRUMENT = ("MGCO56", "MGCO69"), ("MGCO56", "MGCO68"), ("MGCO56",)
"""Those that are fitted with a prior too; instruments are compared by the last one alone."""
ANGLE_PER_LENGTH = 10.0
"""Standard deviation of an orientation over that of a position [rad/m]: 250 urad beside 25 um."""
WEIGHT = 25e-6  #: Sigma by which noise-free readings are weighted [m]: any will do.
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
class FitRow:
    """A model fitted and judged by true deflections, in one trial or over all."""

    model: str  #: Its name; of an instrument the instrument's.
    structure: str
    constraint: Constraint
    prior: bool
    rms_um: Number
    p95_um: Number
    conservative: Share
    solved: Share


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
    light_models, models = named_models(light, SIX_DOF), named_models(cell, GRAVITY)
    found = []
    for seed in seeds:
        rows = list(_six_dof(light, with_wrong_prior(light, light_models, SIX_DOF_PRIOR, seed), asked, seed))
        if seed - asked.first < asked.gravity_trials:
            rows += _gravity(cell, with_wrong_prior(cell, models, GRAVITY_PRIOR, seed), asked, seed)
        if seed - asked.first < asked.instrument_trials:
            rows += _instruments(cell, with_wrong_prior(cell, models, INSTRUMENT, seed)[-1], asked, seed)
        found.append(rows)
    return found


def _six_dof(cell: Cell, models: Sequence[Model], asked: Settings, seed: int) -> Iterator[NoiseRow]:
    scenario = FullPose(arm=cell.arm.name, least=9e-3, most=41e-3, noise=False)
    campaign = simulate_full_pose(cell, scenario, seed)
    for sigma in asked.sigmas:
        data = reread(campaign.identification, sigma, stream(seed, 1))
        for model in models:
            yield NoiseRow(**vars(fit(cell, model, data, campaign.truth)), part="six_dof", x=sigma)


def _gravity(cell: Cell, models: Sequence[Model], asked: Settings, seed: int) -> Iterator[NoiseRow]:
    campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False), seed)
    measured = dataset_row(reread(campaign.identification, FLAT_SIGMA, stream(seed, 1)))
    for sigma in asked.sigmas:
        data = reread(campaign.identification, sigma, stream(seed, 1))
        for model in models:
            found = fit(cell, model, data, campaign.truth)
            yield NoiseRow(**vars(found), part="gravity", x=sigma, measured=measured)


def _instruments(cell: Cell, model: Model, asked: Settings, seed: int) -> Iterator[NoiseRow]:
    """The same poses read by several instruments, MGCO56 with prior; linear truth tells their noise alone."""
    for part in INSTRUMENT_PARTS:
        campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False, truth=TRUTHS[part]), seed)
        flat = reread(campaign.identification, FLAT_SIGMA, stream(seed, 1))
        for name, distance, data in readings(campaign.identification, flat, asked.distances, seed):
            found = replace(fit(cell, model, data, campaign.truth), model=name)
            yield NoiseRow(**vars(found), part=part, x=distance)


def fit(cell: Cell, model: Model, data: Dataset, truth: Dataset) -> FitRow:
    """Identify a model, and judge it by true deflections."""
    estimate: Estimate = model.estimator(cell.vjm, model.structure, data)
    found = score(predict(cell.vjm, estimate, truth), truth.deflection)
    return FitRow(
        model=model.name,
        structure=model.structure.name,
        constraint=estimate.constraint,
        prior=estimate.belief is not None,
        rms_um=UM * found.rms,
        p95_um=UM * found.p95,
        conservative=estimate.conservative,
        solved=estimate.status == "solved",
    )


def reread(clean: Dataset, sigma: float, rng: np.random.Generator) -> Dataset:
    """A noise-free dataset read with noise: for every sigma [m] the same numbers; orientations follow it."""
    tracker = Tracker(sigma, ANGLE_PER_LENGTH * sigma)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    data = replace(clean, before=before, after=after, sigma=sigma or WEIGHT)
    if clean.rotation_before is None or clean.rotation_after is None:
        return data
    turned = [
        read_orientations(tracker, Rotation.from_rotvec(r).as_matrix(), rng)
        for r in (clean.rotation_before, clean.rotation_after)
    ]
    sigma_rotation = ANGLE_PER_LENGTH * data.sigma
    return replace(data, rotation_before=turned[0], rotation_after=turned[1], sigma_rotation=sigma_rotation)
