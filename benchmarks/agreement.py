"""Fits with a prior of random and nasty datasets against independent solvers: who comes lower."""

from dataclasses import dataclass

import numpy as np
from measure import MODELS, Row, at_most, note
from programs import NASTY, random_prior, random_regression

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.estimate import deflections, make_estimate
from testbench.identify.method import gco, with_prior
from testbench.identify.prior import PriorUncertainty, WeightedPrior, cad_prior, rows_with_prior
from testbench.identify.regression import Regression, reduce
from testbench.identify.solve import METHOD_NAMES, fit_on_cone_by_library, solve_with_prior
from testbench.model.structure import all153, mgco68, template56
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.cell import Cell, build_cell

RANDOM, NASTY_ONES = 10_000, 1_000
SEED = 20_000
WORSE = 1e-8  #: Cost over the referee's, relative to that of no model, beyond which an answer is wrong.
OFF = 1e-4  #: Standard deviations that least squares with a prior may be off.
APART = 1e-2  #: Standard deviations that an answer with a prior may be off.
ARM, CAMPAIGNS, STRENGTHS = "kr500_l480", 10, (0.3, 1.0, 3.0)
SHARP = 1e-13  #: Gap that is asked of Clarabel where predictions are compared, data of order one [1].
MOVED = 1e-6  #: Distance that a prediction may be off Clarabel's [mm].


@dataclass(frozen=True)
class Compared:
    """One dataset."""

    own: bool  #: Whether our own method answered; the referee did otherwise.
    over: float  #: Cost over the referee's, relative to that of no model [1].
    gap: float  #: Distance from the better of both answers, in standard deviations [1].


def agreement_with_the_referee() -> list[Row]:
    """Rows for random and nasty datasets."""
    kinds = {"random": ["kind"] * RANDOM, "nasty": [NASTY[k % len(NASTY)] for k in range(NASTY_ONES)]}
    rows = []
    for name, each in kinds.items():
        rng = np.random.default_rng(SEED)
        found, least = [], []
        for kind in each:
            regression = random_regression(kind, rng)
            weighted_prior = random_prior(regression.structure, 10 ** rng.uniform(-6, 3), rng)
            found.append(compared(regression, weighted_prior))
            least.append(least_squares_off(regression, weighted_prior))
        rows += rows_of(f"{len(each)} {name} datasets with a prior", found)
        title = f"(h) {len(each)} {name} datasets with a prior: least squares off"
        rows.append(
            at_most(title, max(least), "", OFF, "standard deviations, against an orthogonal factorisation")
        )
    return [*rows, *predictions_off()]


def predictions_off() -> list[Row]:
    """Rows for fits of the gravity campaign with a prior: predictions over the workspace by both solvers."""
    cell, found = build_cell(MODELS / ARM), list[Moved]()
    asked = Scenario(arm=ARM, workspace_poses=50)
    for seed in range(1, CAMPAIGNS + 1):
        campaign = simulate(cell, asked, seed)
        for structure in (s(cell.arm) for s in (template56, mgco68, all153)):
            regression = reduce(cell.vjm, structure, campaign.identification)
            for uncertainty in STRENGTHS:
                method = with_prior(gco, cad_prior(cell.arm), PriorUncertainty(uncertainty))
                weighted_prior = method(cell.vjm, structure, campaign.identification).weighted_prior
                assert weighted_prior is not None
                found.append(moved(cell, regression, weighted_prior, campaign.truth))
    whole = [one.mm for one in found if one.solved]
    left = [one for one in found if not one.solved]
    behind = f"median {np.median(whole):.1g} mm; Clarabel solves {len(whole)} of {len(found)} to {SHARP:g}"
    apart, over = (max([getattr(one, key) for one in left] or [0.0]) for key in ("mm", "over"))
    title = f"(h) {len(found)} fits of {CAMPAIGNS} gravity campaigns with a prior: predictions off Clarabel's"
    return [
        at_most(title, max(whole), "mm", MOVED, behind),
        note("    where it ends before: apart", apart, "mm", f"our cost is above its by up to {over:.1g}"),
    ]


@dataclass(frozen=True)
class Moved:
    """One fit of a campaign."""

    solved: bool  #: Whether Clarabel reached the gap that was asked for.
    mm: float  #: Largest distance between the predictions of both answers [mm].
    over: float  #: Our cost over Clarabel's, relative to that of no model [1].


def moved(cell: Cell, regression: Regression, weighted_prior: WeightedPrior, truth: Dataset) -> Moved:
    """Solve a fit by both; Clarabel minimises the squares, which are sharper than their norm."""
    scaling = weighted_prior.scaling
    M, r = rows_with_prior(regression, scaling, weighted_prior.uncertainty)
    sharp = squares_by_clarabel(M, r, scaling.block_orders)
    x = [solve_with_prior("psd", regression, weighted_prior).x, sharp.unknowns[M.shape[1] :]]
    costs = [float(np.linalg.norm(M @ one - r)) for one in x]
    estimates = (
        make_estimate(regression, scaling.L @ one, method=METHOD_NAMES["psd"], constraint="none") for one in x
    )
    apart = np.subtract(*(deflections(cell.vjm, own, truth) for own in estimates))
    farthest = 1e3 * float(np.linalg.norm(apart, axis=-1).max())
    return Moved(sharp.solver_status == "Solved", farthest, (costs[0] - costs[1]) / float(np.linalg.norm(r)))


def squares_by_clarabel(M: Array, r: Array, sizes: tuple[int, ...]) -> cone.Solution:
    """Minimise |M x - r|^2 / 2 over |r|^2, blocks of x positive semi-definite.

    The unknowns are the residuals, then x.
    """
    n = M.shape[1]
    R = np.asarray(np.linalg.qr(np.c_[M, r] / np.linalg.norm(r), mode="r"))[:n]
    program = cone.ConeProgram(
        cost=np.zeros(2 * n),
        constraints=(
            cone.ConeConstraint("zero", np.c_[np.eye(n), -R[:, :n]], -R[:, n]),
            *cone.psd_constraints(sizes, np.eye(n, 2 * n, n)),
        ),
        quadratic_diagonal=np.r_[np.ones(n), np.zeros(n)],
    )
    return cone.solve(program, tolerance=SHARP)


def rows_of(name: str, found: list[Compared]) -> list[Row]:
    """Worst cost, farthest answer, and how often the referee had to answer."""
    own = [one for one in found if one.own]
    over, gap = [one.over for one in own] or [0.0], max([one.gap for one in own] or [0.0])
    referee = 100 * (1 - len(own) / len(found))
    below = f"below it by up to {-min(over):.1e}"
    return [
        at_most(f"(h) {name}: excess of the cost over the referee's", max(over), "", WORSE, below),
        at_most(f"(h) {name}: standard deviations off", gap, "", APART, f"of {len(own)} datasets"),
        note(f"    {name}: answered by the referee", referee, "%", ""),
    ]


def compared(regression: Regression, weighted_prior: WeightedPrior) -> Compared:
    """GCO with a prior; what is left is told by the step to the best of both, in standard deviations."""
    own = solve_with_prior("psd", regression, weighted_prior)
    M, r = rows_with_prior(regression, weighted_prior.scaling, weighted_prior.uncertainty)
    x = [own.x, fit_on_cone_by_library(M, r, weighted_prior.scaling.block_orders).x]
    costs = [float(np.linalg.norm(M @ one - r)) for one in x]
    unit, best = float(np.linalg.norm(r)), x[int(np.argmin(costs))]
    return Compared(own.by_our_solver, (costs[0] - costs[1]) / unit, float(np.linalg.norm(M @ (x[0] - best))))


def least_squares_off(regression: Regression, weighted_prior: WeightedPrior) -> float:
    """Standard deviations between least squares with a prior and those of an orthogonal factorisation."""
    M, r = rows_with_prior(regression, weighted_prior.scaling, weighted_prior.uncertainty)
    apart = solve_with_prior("none", regression, weighted_prior).x - fit_on_cone_by_library(M, r, ()).x
    return float(np.linalg.norm(M @ apart))
