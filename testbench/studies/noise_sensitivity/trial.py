"""What noise costs: tracker noise from none to 200 um by method and structure, and better instruments.

Three parts. `six_dof`: the 108 runs of section 5.2, both positions and orientations, linear truth. `gravity`:
the KR 500 under its payload, 8 poses, non-linear truth, judged all over the workspace. `instrument`: the same
poses read by laser trackers near and far, weighted or not. All levels of a trial share their random numbers,
so that differences between levels and methods are theirs alone.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.bench.campaign import Cell, Model, Scenario, build_cell, named_models, simulate, stream
from testbench.bench.full_pose import FullPose
from testbench.bench.full_pose import simulate as simulate_full_pose
from testbench.data.dataset import Dataset
from testbench.data.outliers import spoil
from testbench.data.tracker import (
    Drift,
    LaserTracker,
    Tracker,
    drifted,
    precision,
    read_orientations,
    read_positions,
)
from testbench.identify import Estimate, with_prior
from testbench.identify.evaluate import predict, score
from testbench.identify.prior import Strength, cad_prior, distorted
from testbench.views.report import UM

NAME = "noise_sensitivity"
SIX_DOF = ("MLS32", "MLS56", "MGCO56", "MGCO69", "MGCO147")
"""Models of section 5.2 without a prior."""
GRAVITY = ("MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""Models of section 6 without a prior."""
PRIOR = " + prior"
WITH_PRIOR = {"six_dof": ("MGCO56", "MGCO69"), "gravity": ("MGCO56", "MGCO68")}
SCALE, SHAPE, UNCERTAINTY = 2.0, 0.3, 0.3
"""How wrong a prior is, by a common factor and axis by axis, and how firmly it is believed."""
ANGLE_PER_LENGTH = 10.0
"""Standard deviation of an orientation over that of a position [rad/m]: 250 urad beside 25 um."""
WEIGHT = 25e-6
"""Sigma by which noise-free readings are weighted [m]: any will do."""


@dataclass(frozen=True)
class Study:
    """What is tried.

    Attributes:
        sigmas: Standard deviations of one reading along one axis [m].
        gravity_trials: So many of the trials have the gravity part too.
        instrument_trials: So many have the part of the instruments.
        distances: Of the laser tracker from the middle of the work area [m].
    """

    sigmas: tuple[float, ...] = (0.0, 10e-6, 25e-6, 50e-6, 100e-6, 200e-6)
    gravity_trials: int = 200
    instrument_trials: int = 100
    distances: tuple[float, ...] = (2.0, 4.0, 8.0, 15.0)


@dataclass(frozen=True)
class Row:
    """One fit judged by true deflections; x is the swept quantity in SI."""

    part: str
    model: str
    x: float
    rms_um: float
    p95_um: float
    conservative: int
    solved: int


def trials(six_dof: Path, heavy: Path, study: Study, first: int, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some trials, a list a seed.

    Args:
        six_dof: Folder of the arm of section 5.2.
        heavy: Folder of the arm under gravity.
        study: What is tried.
        first: The first seed of all: the parts with fewer trials have the first ones.
        seeds: Roots of randomness.
    """
    light, cell = build_cell(six_dof), build_cell(heavy)
    light_fits, fits = ways(light, SIX_DOF, WITH_PRIOR["six_dof"]), ways(cell, GRAVITY, WITH_PRIOR["gravity"])
    found = []
    for seed in seeds:
        rows = list(_six_dof(light, light_fits, study, seed))
        if seed - first < study.gravity_trials:
            rows += _gravity(cell, fits, study, seed)
        if seed - first < study.instrument_trials:
            rows += _instruments(cell, study, seed)
        found.append(rows)
    return found


Way = Callable[[Cell, Dataset, int], Estimate]
"""Identify an arm from a dataset; the seed is that of the prior's errors."""


def ways(cell: Cell, plain: Sequence[str], filled: Sequence[str]) -> dict[str, Way]:
    """Methods by name, their structures built once.

    Args:
        cell: The arm.
        plain: Keys of bench.MODELS.
        filled: Keys of bench.MODELS to be fitted with a prior.
    """
    found: dict[str, Way] = {}
    for name in plain:
        found[name] = _plain(named_models(cell, [name])[0])
    for name in filled:
        found[name + PRIOR] = _with_prior(named_models(cell, [name])[0])
    return found


def _plain(model: Model) -> Way:
    return lambda cell, data, _: model.estimator(cell.vjm, model.structure, data)


def _with_prior(model: Model) -> Way:
    def fit(cell: Cell, data: Dataset, seed: int) -> Estimate:
        prior = distorted(cad_prior(cell.arm), scale=SCALE, shape=SHAPE, rng=stream(seed, 5))
        method = with_prior(model.estimator, prior, Strength(UNCERTAINTY))
        return method(cell.vjm, model.structure, data)

    return fit


def _six_dof(cell: Cell, fits: dict[str, Way], study: Study, seed: int) -> Iterator[Row]:
    scenario = FullPose(arm=cell.arm.name, least=9e-3, most=41e-3, noise=False)
    campaign = simulate_full_pose(cell, scenario, seed)
    for sigma in study.sigmas:
        data = reread(campaign.identification, sigma, stream(seed, 1))
        for name, fit in fits.items():
            yield _row("six_dof", name, sigma, cell, fit(cell, data, seed), campaign.truth)


def _gravity(cell: Cell, fits: dict[str, Way], study: Study, seed: int) -> Iterator[Row]:
    campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False), seed)
    for sigma in study.sigmas:
        data = reread(campaign.identification, sigma, stream(seed, 1))
        for name, fit in fits.items():
            yield _row("gravity", name, sigma, cell, fit(cell, data, seed), campaign.workspace)


def reread(clean: Dataset, sigma: float, rng: np.random.Generator) -> Dataset:
    """A noise-free dataset read with noise; the same normal numbers for every sigma.

    Args:
        clean: Readings without noise.
        sigma: Standard deviation of a position reading along an axis [m]; orientations in proportion.
        rng: Source of the noise.
    """
    tracker = Tracker(sigma, ANGLE_PER_LENGTH * sigma)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    data = replace(clean, before=before, after=after, sigma=sigma or WEIGHT)
    if clean.rotation_before is None or clean.rotation_after is None:
        return data
    turned = [
        read_orientations(tracker, Rotation.from_rotvec(r).as_matrix(), rng)
        for r in (clean.rotation_before, clean.rotation_after)
    ]
    return replace(
        data,
        rotation_before=turned[0],
        rotation_after=turned[1],
        sigma_rotation=ANGLE_PER_LENGTH * data.sigma,
    )


def _row(part: str, name: str, x: float, cell: Cell, estimate: Estimate, truth: Dataset) -> Row:
    """One fit judged by true deflections; x is the swept quantity in SI."""
    found = score(predict(cell.vjm, estimate, truth), truth.deflection)
    return Row(
        part=part,
        model=name,
        x=x,
        rms_um=UM * found.rms,
        p95_um=UM * found.p95,
        conservative=int(estimate.conservative),
        solved=int(estimate.status == "solved"),
    )


CENTRE = (2.2, 0.0, 1.6)
"""Middle of the work area, section 6 [m]."""
LOST, MISREAD, BY = 0.1, 0.05, 1e-3
"""Share of targets that are lost, share that are misread, and by how much [m]."""
DRIFT = Drift(shift=20e-6, turn=5e-6)
"""Drift of the frame between the two readings of a run: 20 um and 5 urad (20 um at 4 m) [assumed]."""
INSTRUMENT_MODEL = "MGCO56"


def _instruments(cell: Cell, study: Study, seed: int) -> Iterator[Row]:
    """The same poses read by several instruments, MGCO56 with prior; linear truth tells their noise alone."""
    fit = _with_prior(named_models(cell, [INSTRUMENT_MODEL])[0])
    for truth in ("linear", "nonlinear"):
        scenario = Scenario(arm=cell.arm.name, noise=False, truth=truth)
        campaign = simulate(cell, scenario, seed)
        for name, x, data in readings(campaign.identification, study, seed):
            row = _row(f"instrument_{truth}", name, x, cell, fit(cell, data, seed), campaign.workspace)
            yield row


def readings(clean: Dataset, study: Study, seed: int) -> Iterator[tuple[str, float, Dataset]]:
    """A noise-free dataset as several instruments read it: name, distance [m], readings."""
    yield "flat 50 um", 0.0, reread(clean, 50e-6, stream(seed, 1))
    for distance in study.distances:
        tracker = LaserTracker((CENTRE[0], CENTRE[1] - distance, CENTRE[2]))
        yield "weighted", distance, by_laser(clean, tracker, seed)
        yield "flat weights", distance, flat(by_laser(clean, tracker, seed))
        worst = replace(tracker, quality="mpe")
        yield "weighted, maximum errors", distance, by_laser(clean, worst, seed)
        averaged = replace(tracker, repeats=3)
        yield "weighted, 3 readings averaged", distance, by_laser(clean, averaged, seed)
        yield "weighted, frame drifts", distance, by_laser(clean, tracker, seed, DRIFT)
        yield "weighted, 10 % of targets lost", distance, _lose(by_laser(clean, tracker, seed), seed)
        misread, _ = spoil(by_laser(clean, tracker, seed), MISREAD, BY, stream(seed, 6))
        yield "weighted, 5 % misread by 1 mm", distance, misread


def by_laser(clean: Dataset, tracker: LaserTracker, seed: int, drift: Drift | None = None) -> Dataset:
    """A noise-free dataset read by a laser tracker, weighted by what it knows of itself.

    Args:
        clean: Readings without noise.
        tracker: The instrument.
        seed: Root of noise and drift.
        drift: Of its frame before the loaded reading; the weights do not know of it.
    """
    rng = stream(seed, 1)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    if drift is not None:
        after = drifted(after, drift, tracker.station, stream(seed, 2))
    return replace(clean, before=before, after=after, precision=precision(tracker, before, after))


def flat(data: Dataset) -> Dataset:
    """The same readings weighted alike along every axis, by the sigma that they have in the mean."""
    assert data.precision is not None
    variance = (
        np.trace(np.linalg.inv(data.precision), axis1=2, axis2=3).mean() / 6
    )  # three axes, two readings
    return replace(data, sigma=float(np.sqrt(variance)), precision=None)


def _lose(data: Dataset, seed: int) -> Dataset:
    """The same without some of its targets."""
    assert data.precision is not None
    gone = stream(seed, 3).random((data.runs, len(data.markers))) < LOST
    return replace(data, precision=np.where(gone[..., None, None], 0.0, data.precision))
