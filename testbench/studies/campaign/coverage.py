"""Coverage of intervals: how often they hold the truth, over datasets whose noise is drawn anew.

One reduced dataset gives poses, loads and sigmas; only the noise is drawn, in the coordinates of its
triangular factor. Dataset k is the same whatever the root of the other parts is.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify.conic import solve_gco
from testbench.identify.estimate import Estimate
from testbench.identify.interior import is_semidefinite
from testbench.identify.method import gco, with_prior
from testbench.identify.posterior import Intervals, intervals, posterior_of_estimate
from testbench.identify.prior import (
    PriorScaling,
    PriorUncertainty,
    WeightedPrior,
    aggregate_left_out_joints,
    cad_prior,
    scale_by_prior,
)
from testbench.identify.regression import Regression, reduce
from testbench.identify.solve import METHOD_NAMES, minimum_norm, solve
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.model.vjm import evaluate_chain, observation_matrix
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.runs.rows import trial_rng
from testbench.studies.intervals import bootstrap, resampler
from testbench.workflows.campaign import FullPose, Scenario, Truth, simulate, simulate_full_pose, true_cell
from testbench.workflows.cell import Cell
from testbench.workflows.models import prior_of
from testbench.workflows.rows import UM

CONFIDENCE = 0.95
DRAWS_LS, DRAWS_GCO = 199, 39  #: Refits of a bootstrap: the interval's order statistics are exact for both.
LEVELS = (0.5, 0.8, 0.9, CONFIDENCE, 0.99)  #: Nominal coverages at which intervals are counted [1].
REJECTIONS = 1000
CHECKS = 10  #: Poses to predict in: x, y and z of one point in each.
DRAWN_STRENGTH, ASSUMED_STRENGTH = PriorUncertainty(0.1), PriorUncertainty(0.3)
"""The prior that truths are drawn from, and one that is believed whatever the readings say."""
TRIED: dict[tuple[Truth, str], str] = {
    ("linear", "scaled"): "linear truth, wrong prior",
    ("nonlinear", "scaled"): "MuJoCo truth, wrong prior",
    ("nonlinear", "link"): "MuJoCo truth, a link ten times off",
    ("nonlinear", "joints"): "MuJoCo truth, joints ten times off",
}
"""Truth and prior, one of wrong_prior.PRIORS, of arms of the family; in words."""

Kind = Literal["linearised", "bootstrap", "posterior", "learnt", "believed"]
"""What intervals are; of the last two the arm is of the family, its prior learnt or believed."""


@dataclass(frozen=True)
class CoverageCase:
    """Describe what datasets are drawn for."""

    name: str  #: Arm and model, for reports.
    regression: Regression  #: Poses, loads and sigmas.
    scaling: PriorScaling  #: The structure in the metric of the CAD prior.
    truth: Array  #: Parameters, (n,).
    functionals: Array  #: Deflections asked for, (k, n).


@dataclass(frozen=True)
class Covered:
    """Hold intervals of one kind from one dataset."""

    name: str  #: Case and method.
    kind: Kind  #: What the intervals are.
    inside: tuple[bool, ...]  #: Whether each holds the true deflection, to a picometre.
    width_um: tuple[float, ...]  #: Of each, infinite where nothing bounds it.
    #: Share of the intervals that hold the truth at each of `LEVELS`; empty of kinds with one level.
    at_levels: tuple[float, ...] = ()


def full_pose_case(cell: Cell) -> CoverageCase:
    """Make the case of section 5.2: full poses read, 56 unknowns, every deflection seen."""
    campaign = simulate_full_pose(cell, FullPose(arm=cell.arm.name, check_runs=CHECKS), 1)
    structure = template56(cell.arm)
    rows = _deflections(cell, structure, campaign.check, np.zeros((1, 3)))
    return _case(cell, cell.arm.name, structure, campaign.identification, rows)


def gravity_cases(cell: Cell) -> list[CoverageCase]:
    """Make the cases of section 6: markers read under a hung weight; most deflections are not seen."""
    scenario = Scenario(arm=cell.arm.name, truth="linear", workspace_poses=CHECKS)
    campaign = simulate(cell, scenario, 1)
    data = campaign.identification
    where = campaign.truth
    marker = cell.vjm.markers[:1]
    structures = {"MGCO56": template56(cell.arm), "MGCO68": mgco68(cell.arm)}
    return [
        _case(cell, f"{cell.arm.name} {n}", s, data, _deflections(cell, s, where, marker))
        for n, s in structures.items()
    ]


def _case(cell: Cell, name: str, s: Structure, data: Dataset, functionals: Array) -> CoverageCase:
    truth = s.parameters_of(aggregate_left_out_joints(cell.arm.C_theta, cell.vjm, s))
    scaling = scale_by_prior(cad_prior(cell.arm), cell.vjm, s)
    return CoverageCase(name, reduce(cell.vjm, s, data), scaling, truth, functionals)


def _deflections(cell: Cell, structure: Structure, where: Dataset, targets: Array) -> Array:
    """Deflections of points of the tool as linear functionals of pi, (3 runs targets, n)."""
    args = (evaluate_chain(cell.vjm, where.q), structure, where.wrench, where.point)
    return observation_matrix(*args, targets).reshape(-1, structure.n_parameters)


def refitted(case: CoverageCase, k: int, bootstrapped: bool) -> list[Covered]:
    """Compute posterior and bootstrap intervals of least squares and GCO without a prior, from dataset k.

    Args:
        case: What datasets are drawn for.
        k: Number of the dataset.
        bootstrapped: Whether bootstrap intervals are computed.

    Returns:
        The intervals.
    """
    rng = trial_rng(k)
    truth = case.functionals @ case.truth
    rows = case.functionals
    regression = resampler(case.regression)(case.truth, rng)
    fits = ((minimum_norm(regression), "least squares", DRAWS_LS), (solve_gco(regression), "GCO", DRAWS_GCO))
    found = []
    for estimate, method, draws in fits:
        name, at = f"{case.name}, {method}", partial(posterior_of_estimate(estimate).intervals, rows)
        found.append(_covered_at(f"{name}, linearised", "linearised", truth, at))
        if bootstrapped:
            seen = bootstrap(estimate, rows, CONFIDENCE, draws=draws, rng=rng)
            found.append(_covered(f"{name}, bootstrap", "bootstrap", truth, seen))
    return found


def posterior(case: CoverageCase, k: int) -> list[Covered]:
    """Compute posterior intervals where the truth of dataset k is a draw of the prior.

    It is x = s e + u N(0, 1) in the metric, drawn again until it is conservative; s = 1 where the prior
    leaves the scale to the data, else s is drawn too.

    Args:
        case: What datasets are drawn for.
        k: Number of the dataset.

    Returns:
        The intervals.
    """
    rng, uncertainty = trial_rng(k), DRAWN_STRENGTH
    pi = case.scaling.L @ draw_conservative(case.scaling, uncertainty, rng)
    regression, truth = resampler(case.regression)(pi, rng), case.functionals @ pi
    found = []
    for constraint, method in METHOD_NAMES.items():
        fit = solve(regression, constraint, WeightedPrior(case.scaling, uncertainty))
        at = partial(posterior_of_estimate(fit).intervals, case.functionals)
        found.append(_covered_at(f"{case.name}, {method}", "posterior", truth, at))
    return found


def draw_conservative(
    scaling: PriorScaling, uncertainty: PriorUncertainty, rng: np.random.Generator
) -> Array:
    """Draw a conservative x, (n,), of a prior: normal draws until one is positive semi-definite.

    Args:
        scaling: Units of the prior.
        uncertainty: Uncertainty of the prior.
        rng: Source of randomness.

    Returns:
        x, (n,) [1].

    Raises:
        BenchError: When there is none: the uncertainty is too large for the blocks.
    """
    for _ in range(REJECTIONS):
        scale = 1.0
        if np.isfinite(uncertainty.scale):
            scale += uncertainty.scale * rng.standard_normal()
        x = scale * scaling.expected_x + uncertainty.relative * rng.standard_normal(len(scaling.expected_x))
        if is_semidefinite(x, scaling.block_orders, 0.0):
            return x
    raise BenchError(
        f"prior: expected a conservative model among {REJECTIONS} draws of uncertainty "
        f"{uncertainty.relative:g}, found none"
    )


def of_family(cell: Cell, seed: int) -> Iterator[Covered]:
    """Compute intervals of `identify` on another arm of the family, with another wrong prior.

    All links and joints, the prior learnt from the readings as `identify` does by default, and beside it
    believed to `ASSUMED_STRENGTH` whatever the readings say.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.

    Yields:
        The intervals of every truth and prior.
    """
    arm = true_cell(cell, true_arm_of_seed(FAMILY_NAME, seed), seed)
    for (truth, name), words in TRIED.items():
        campaign = simulate(arm, Scenario(arm=cell.arm.name, truth=truth, workspace_poses=CHECKS), seed)
        data = campaign.truth
        kinds: dict[Kind, PriorUncertainty | None] = {"learnt": None, "believed": ASSUMED_STRENGTH}
        for kind, uncertainty in kinds.items():
            method = with_prior(gco, prior_of(cell, name, seed), uncertainty)
            estimate = method(cell.vjm, all153(cell.arm), campaign.identification)
            at = partial(_of_first_marker, cell, estimate, data)
            yield _covered_at(f"{words}: {kind}", kind, data.deflection[:, 0].ravel(), at)


def _of_first_marker(cell: Cell, estimate: Estimate, data: Dataset, confidence: float) -> Intervals:
    """Compute intervals of the deflections of one marker, (3 runs,) each end."""
    found = intervals(cell.vjm, estimate, data, confidence)
    return replace(found, lower=found.lower[:, 0].ravel(), upper=found.upper[:, 0].ravel())


def _covered_at(name: str, kind: Kind, truth: Array, at: Callable[[float], Intervals]) -> Covered:
    """Count intervals of 95 %, and of all other levels, that hold the truth."""
    seen = {level: _covered(name, kind, truth, at(level)) for level in LEVELS}
    return replace(
        seen[CONFIDENCE], at_levels=tuple(float(np.mean(covered.inside)) for covered in seen.values())
    )


def _covered(name: str, kind: Kind, truth: Array, seen: Intervals) -> Covered:
    inside = (seen.lower - 1e-12 <= truth) & (truth <= seen.upper + 1e-12)
    return Covered(name, kind, tuple(inside.tolist()), tuple((UM * (seen.upper - seen.lower)).tolist()))
