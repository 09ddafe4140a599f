"""All cells of one arm: noise by poses, for every structure, truth, kind of reading and prior.

A trial is a seed: poses, noise, and true arms of two kinds of the family, which take turns. Its cells share
poses, which are nested, and random numbers, so that differences between cells and methods are theirs alone.

GCO and least squares of one structure differ in three things, and each is set apart here. The weights of
positions and rotations: least squares takes those at which GCO ends (with one term there are none). The
directions that no reading sees: `equal` fills them so that least squares is conservative, if it can be, and
`lent` takes them from GCO. And the cone's own work on what is seen: what then is left.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset, select
from testbench.errors import Array, BenchError, Mask
from testbench.identify.estimate import Estimate, all_deflections
from testbench.identify.metric import (
    Prior,
    PriorUncertainty,
    WeightedPrior,
    cad_prior,
    rescale_to_data,
    scale_by_prior,
)
from testbench.identify.regression import RANK_TOLERANCE, Regression, reduce, regression_of
from testbench.identify.solve import complete_conservatively, free_directions, solve
from testbench.model.structure import all153, joints_only, mgco47, mgco68, template56
from testbench.model.vjm import Vjm
from testbench.plant.tracker import trial_rng
from testbench.plant.true_arms import true_arms
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    Fits,
    TrialCase,
    each_seed,
    fitted,
    reread,
    score_cases,
)
from testbench.workflows.cell import (
    Cell,
    FullPose,
    Scenario,
    build_cell,
    draw_poses,
    simulate_at,
    simulate_full_pose,
    true_cell,
)
from testbench.workflows.models import Model
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import UM

Kind = Literal["gravity", "full_pose"]
"""A weight and three markers (section 6), or wrenches along all axes and the tool's full pose (5.2)."""


@dataclass(frozen=True)
class CellGrid:
    """Describe the cells of one kind of reading."""

    arm: str  #: Name of the arm.
    poses: tuple[int, ...]  #: Ascending: fewer poses are the first ones of the most.
    sigmas: tuple[float, ...]  #: Of a reading along an axis [m].

    @property
    def cells(self) -> list[tuple[int, float]]:
        """List poses and noise of every cell."""
        return [(poses, sigma) for poses in self.poses for sigma in self.sigmas]


STRUCTURES = (template56, mgco47, mgco68, all153)
AT_ONCE = 2  #: Kinds of true arm in one trial.
FAMILY = ("tubes", "off_20", "off_40", "cast")
GRAVITY = CellGrid("kr500_l480", (4, 8, 12, 20, 40), (5e-6, 15e-6, 50e-6, 150e-6, 500e-6))
FULL_POSE = CellGrid("arm_6r", (2, 4, 8, 18), (25e-6, 100e-6, 400e-6))
FEATURED = (8, 50e-6)  #: Poses and noise of section 6: the cell whose models the report lists.
NONE = "none"
PRIORS = {"30 %": PriorUncertainty(0.3), "300 %": PriorUncertainty(3.0)}
"""How firmly the CAD prior is believed, by name; it is right where the truth is tubes."""
GCO, SQUARES, JOINTS = "GCO", "least squares", "joints alone"
EQUAL, LENT = "PSD of equal fit", "same free directions"
"""Least squares that is conservative if it can be at equal fit, and with GCO's free directions."""
ONE = np.sqrt(0.5)  #: Sigma of a reading at which F_M is the RMS distance itself [m].
TAKEN = 0.05
"""Chi squared a seen direction that GCO adds, beyond which no conservative model of equal fit is sought.

GCO fits best of all conservative models but for its trace weight. That was seen to cost up to 0.015 where
there is a model of equal fit.
"""

LEAST_NORM = 1e-2  #: Share of the largest norm of a term that weighs as one less: a term may fit exactly.


@dataclass(frozen=True)
class Compared:
    """Hold least squares and GCO of one structure, with the same prior or both without."""

    ls: Sequence[Estimate]
    gco: Sequence[Estimate]
    equal: Sequence[Estimate] | None = None  #: Least squares, conservative if it can be; None with a prior.
    lent: Sequence[Estimate] | None = None  #: Least squares with GCO's free directions; None with a prior.

    @property
    def binds(self) -> list[bool]:
        """Tell whether the cone changes the fit: no conservative model fits as well as least squares."""
        return [not estimate.conservative for estimate in self.equal or self.ls]


def without_prior(regressions: Sequence[Regression]) -> Compared:
    """Fit least squares, GCO, and least squares with other free directions."""
    gco = [solve(regression, "psd") for regression in regressions]
    ls = [solve(weighed_as(estimate), "none") for estimate in gco]
    pairs = list(zip(ls, gco, strict=True))
    return Compared(
        ls, gco, [_equal(*estimates) for estimates in pairs], [_lent(*estimates) for estimates in pairs]
    )


def with_prior(
    vjm: Vjm, regressions: Sequence[Regression], prior: Prior, uncertainty: PriorUncertainty
) -> Compared:
    """Fit least squares and GCO with the same prior, which leaves no direction free.

    Args:
        vjm: Kinematics of the arm.
        regressions: Reduced datasets.
        prior: The prior.
        uncertainty: Uncertainty of the prior.

    Returns:
        Both fits of every dataset.
    """
    scaling = scale_by_prior(prior, vjm, regressions[0].structure)
    pairs = [(r, WeightedPrior(rescale_to_data(scaling, r), uncertainty)) for r in regressions]
    return Compared(
        *(
            [solve(r, constraint, weighted_prior) for r, weighted_prior in pairs]
            for constraint in ("none", "psd")
        )
    )


def weighed_as(gco: Estimate) -> Regression:
    """Weigh the runs of GCO such that it is the conservative least squares fit of them.

    F_M is a sum of norms n_k, with the gradient of sum |r_k|^2 / (2 n_k) at its optimum: over a convex cone
    one C minimises both. Least squares weighs terms by their equations N_k, so rows go by 1 / sqrt(N_k n_k).
    """
    terms = gco.regression.terms
    norms = np.array([np.sqrt(np.sum((t.R @ gco.pi - t.z) ** 2) + t.unexplained) for t in terms])
    size = np.maximum(norms, LEAST_NORM * norms.max()) * [t.equations for t in terms]
    shares = np.sqrt(size.mean() / size)
    weighed = (
        replace(t, R=c * t.R, z=c * t.z, unexplained=c**2 * t.unexplained)
        for c, t in zip(shares, terms, strict=True)
    )
    return regression_of(gco.regression.structure, tuple(weighed)) if len(terms) > 1 else gco.regression


def added(ls: Estimate, gco: Estimate) -> float:
    """Compute chi squared of GCO less that of least squares, as least squares weighs, over the rank [1].

    Args:
        ls: Fit of least squares.
        gco: Fit of GCO.

    Returns:
        The difference [1].
    """
    more = 0.0
    for term in ls.regression.terms:
        theirs, ours = (term.R @ estimate.pi - term.z for estimate in (ls, gco))
        more += term.equations / 3 * float(ours @ ours - theirs @ theirs)
    return more / ls.regression.rank


def _equal(ls: Estimate, gco: Estimate) -> Estimate:
    return ls if added(ls, gco) > TAKEN else complete_conservatively(ls.regression)


def _lent(ls: Estimate, gco: Estimate) -> Estimate:
    """The fit of least squares, the free directions of GCO: what differs from GCO is seen by the data."""
    if ls.regression.rank == ls.structure.n:
        return ls
    free = free_directions(ls.regression, ls.pi)
    twice = np.where(ls.structure.fills_two_entries, 2.0, 1.0)  # entries that stand at two places of C
    w: Array = free.N.T @ (twice * (gco.pi / free.unit - free.x))
    pi = ls.pi + free.unit * (free.N @ w)
    return replace(ls, pi=pi, C_theta=ls.structure.matrix(pi))


@dataclass(frozen=True)
class GridOptions:
    """Hold the flags of the study."""

    truth: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Kind of true arm; repeatable (default: four).")
    ] = None


@dataclass(frozen=True)
class GridSettings:
    """Describe what is tried."""

    first: int  #: The first seed.
    truths: tuple[str, ...] = FAMILY
    judged: int = 200  #: Poses in which the models are judged.
    gravity: CellGrid = GRAVITY
    full_pose: CellGrid = FULL_POSE

    def arms(self, seed: int) -> list[str]:
        """List the kinds of true arm in a trial: neighbours in the family, so that all take turns."""
        count = len(self.truths)
        return [self.truths[(AT_ONCE * seed + k) % count] for k in range(min(AT_ONCE, count))]

    @property
    def grids(self) -> dict[Kind, CellGrid]:
        """Return the grids by kind of reading."""
        return {"gravity": self.gravity, "full_pose": self.full_pose}


@dataclass(frozen=True, kw_only=True)
class GridMethodRow(CampaignFitRow):
    """Hold one method in one cell: `name` is the method, `structure` that of the compared models."""

    uncertainty: str  #: Of the CAD prior, the same for both, or none.
    binds: bool  #: Whether the cone changes the fit: nothing conservative fits as well as least squares.
    expected: float  #: Error that noise is expected to leave least squares, over the deflection GCO predicts.
    free: int  #: Directions that the data do not see.


def settings(options: GridOptions, quick: bool, seeds: range) -> GridSettings:
    """Make the settings of the flags.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.

    Raises:
        BenchError: When there is no such truth, or one is there twice.
    """
    truths = tuple(options.truth or FAMILY)
    for name in truths:
        if name not in true_arms or truths.count(name) > 1:
            raise BenchError(f"--truth: expected different ones of {', '.join(true_arms)}, got {name!r}")
    found = GridSettings(seeds[0], truths)
    if not quick:
        return found
    gravity = replace(found.gravity, poses=(4, 8, 20), sigmas=(50e-6, 150e-6))
    full_pose = replace(found.full_pose, poses=(2, 8), sigmas=(100e-6, 400e-6))
    return replace(found, judged=40, gravity=gravity, full_pose=full_pose)


@each_seed
def trials(asked: GridSettings, seed: int, own: Models) -> Iterator[GridMethodRow]:
    """Make the rows of a seed, one per method, structure, truth, prior and cell of the grids.

    Args:
        asked: Settings of the study.
        seed: Seed of the trial.
        own: Estimators of the user.

    Yields:
        The rows.
    """
    for kind, grid in asked.grids.items():
        cell = build_cell(find_arm(grid.arm))
        yield from _rows(cell, kind, asked, seed, own(cell, None))


@dataclass(frozen=True)
class Clean:
    """Hold an arm's true deflections."""

    runs: Dataset  #: In the poses to identify from.
    judge: Dataset  #: In poses never measured.
    seed: int  #: Of poses, truth and noise.

    def first(self, poses: int) -> Mask:
        """Tell which runs are in the first poses, (runs,)."""
        return np.asarray(np.isin(self.runs.pose, np.unique(self.runs.pose)[:poses]))

    def read(self, grid: CellGrid) -> list[Dataset]:
        """Read every cell's runs with noise: at every level, and in every cell, the same random numbers."""
        noisy = {sigma: reread(self.runs, sigma, trial_rng(self.seed, 1)) for sigma in grid.sigmas}
        return [select(noisy[sigma], self.first(poses)) for poses, sigma in grid.cells]


def _gravity(cell: Cell, grid: CellGrid, judged: int, truths: Sequence[str], seed: int) -> list[Clean]:
    """Under a weight: MuJoCo settles every true arm in the same poses."""
    most = max(grid.poses)
    scenario = Scenario(
        arm=cell.arm.name,
        noise=False,
        identification_poses=most,
        identification_runs=most,
        workspace_poses=judged,
    )
    poses = draw_poses(cell, scenario, seed)
    campaigns = (simulate_at(true_cell(cell, name, seed), scenario, seed, poses) for name in truths)
    return [Clean(c.identification, c.truth, seed) for c in campaigns]


def _full_pose(cell: Cell, grid: CellGrid, judged: int, truths: Sequence[str], seed: int) -> list[Clean]:
    """Under wrenches along all axes, to first order and with deflections in range, as in section 5.2."""
    scenario = FullPose(
        arm=cell.arm.name, noise=False, poses=max(grid.poses), least=9e-3, most=41e-3, check_runs=judged
    )
    campaigns = (simulate_full_pose(true_cell(cell, name, seed), scenario, seed) for name in truths)
    return [Clean(c.identification, c.truth, seed) for c in campaigns]


MEASURE: Mapping[Kind, Callable[[Cell, CellGrid, int, Sequence[str], int], list[Clean]]] = {
    "gravity": _gravity,
    "full_pose": _full_pose,
}
"""Of an arm, its grid, the poses to judge by, names of truths and a seed: what is true, a truth each."""


def _rows(
    cell: Cell, kind: Kind, asked: GridSettings, seed: int, estimators: Sequence[Model]
) -> Iterator[GridMethodRow]:
    """Rows of one kind of reading; estimators of one's own fit every structure without a prior."""
    grid, prior, truths = asked.grids[kind], cad_prior(cell.arm), asked.arms(seed)
    structures = [make(cell.arm) for make in STRUCTURES]
    for truth, clean in zip(truths, MEASURE[kind](cell, grid, asked.judged, truths, seed), strict=True):
        data = clean.read(grid)
        left = FEATURED if (kind, truth, seed) == ("gravity", truths[0], asked.first) else None
        alone = [reduce(cell.vjm, joints_only(cell.arm), runs) for runs in data]
        joints = [solve(regression, "none") for regression in alone]
        for structure in structures:
            regressions = [reduce(cell.vjm, structure, runs) for runs in data]
            found = {NONE: without_prior(regressions)}
            found |= {
                name: with_prior(cell.vjm, regressions, prior, believed) for name, believed in PRIORS.items()
            }
            noise = expected(cell.vjm, clean, grid, regressions)
            for name, compared in found.items():
                tried = estimators if name == NONE else ()
                same = {"part": kind, "true_arm": truth, "structure": structure.name, "uncertainty": name}
                cases = [
                    TrialCase(
                        runs,
                        clean.judge,
                        {**same, "poses": at[0], "sigma_um": UM * at[1]},
                        runs if at == left else None,
                    )
                    for runs, at in zip(data, grid.cells, strict=True)
                ]
                fits = Fits({GCO: compared.gco, SQUARES: compared.ls, JOINTS: joints})
                fits |= fitted(cell, [replace(m, structure=structure) for m in tried], cases)
                yield from _compared(cell, cases, compared, fits, noise)


def _compared(
    cell: Cell, cases: Sequence[TrialCase], own: Compared, fits: Fits, noise: Array
) -> Iterator[GridMethodRow]:
    """Rows of one structure with one prior; noise is what it is expected to leave least squares [um]."""
    fits |= {EQUAL: own.equal, LENT: own.lent} if own.equal and own.lent else {}
    moved, binds = all_deflections(cell.vjm, own.gco, cases[0].test), own.binds
    share = noise / (UM * np.sqrt(np.square(moved).sum(axis=3).mean(axis=(1, 2))))

    def more(name: str, k: int) -> dict[str, object]:
        known = {"expected": float(share[k]), "free": own.ls[k].structure.n - own.ls[k].regression.rank}
        return known | {"binds": binds[k]} | ({"constraint": "free"} if name == EQUAL else {})

    yield from score_cases(cell, cases, fits, GridMethodRow, more)


def expected(vjm: Vjm, clean: Clean, grid: CellGrid, regressions: Sequence[Regression]) -> Array:
    """Predict the RMS error in poses never measured that noise leaves least squares.

    From rows and sigma alone; where the data leave directions free it is that of the directions seen.

    Args:
        vjm: Kinematics of the arm.
        clean: True deflections.
        grid: The cells.
        regressions: Reduced dataset of every cell.

    Returns:
        Error, (cells,) [um].
    """
    rows = reduce(vjm, regressions[0].structure, replace(clean.judge, sigma=ONE)).terms[0].R
    first = {poses: k for k, (poses, _) in reversed(list(enumerate(grid.cells)))}
    once = {poses: _amplified(regressions[k], rows) / grid.cells[k][1] for poses, k in first.items()}
    return np.array([UM * once[poses] * sigma for poses, sigma in grid.cells])


def _amplified(regression: Regression, rows: Array) -> float:
    """Root of the summed variances that least squares leaves rows, (k, n) [m per unit of pi], in metres."""
    touched = regression.columns > 0
    A = np.vstack([np.sqrt(t.equations / 3) * t.R[:, touched] for t in regression.terms])
    scale = np.linalg.norm(A, axis=0)
    _, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    kept = s > RANK_TOLERANCE * s[0]
    return float(np.linalg.norm(rows[:, touched] / scale @ Vt[kept].T / s[kept]))
