"""Where the cone pays by itself, GCO beside least squares of the same structure.

Cells are noise by poses, for every structure, truth and kind of reading. A trial is a seed: poses, noise, and
true arms of two kinds of the family, which take turns. Its cells share poses, which are nested, and random
numbers, so that differences between cells and methods are theirs alone.

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
from testbench.data.dataset import Dataset, select_runs
from testbench.errors import Array, BenchError, Mask
from testbench.identify.estimate import Estimate, deflections_of_models
from testbench.identify.regression import RANK_TOLERANCE, Regression, reduce, regression_from_terms
from testbench.identify.solve import conservative_least_squares, equal_fits, solve
from testbench.model.structure import all153, joints_only, mgco47, mgco68, template56
from testbench.model.vjm import Vjm
from testbench.plant.true_arms import true_arms
from testbench.report.colours import look
from testbench.report.figure import Figure, ranges
from testbench.report.report import Report
from testbench.report.schema import Table, columns
from testbench.report.table import SHARED, TRIAL, Row, Trials, matched, number
from testbench.runs.rows import trial_rng
from testbench.runs.spread import SAME_ERROR, Number, ends, middle
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where, by_case
from testbench.studies.campaign.trial import CampaignFitRow, Fits, TrialCase, fitted, reread, score_cases
from testbench.workflows.campaign import (
    FullPose,
    Scenario,
    draw_poses,
    simulate_at,
    simulate_full_pose,
    true_cell,
)
from testbench.workflows.cell import Cell, build_cell
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


def methods(regressions: Sequence[Regression], joints: Sequence[Estimate]) -> dict[str, Sequence[Estimate]]:
    """Fit GCO, least squares, and least squares with other free directions.

    Args:
        regressions: Reduced datasets of one structure.
        joints: Fits of joints alone to the same datasets, which are one of the methods.

    Returns:
        An estimate of every dataset, by method.
    """
    gco = [solve(regression, "psd") for regression in regressions]
    ls = [solve(_weighed_as(estimate), "none") for estimate in gco]
    pairs = list(zip(ls, gco, strict=True))
    return {
        GCO: gco,
        SQUARES: ls,
        JOINTS: joints,
        EQUAL: [_equal(*pair) for pair in pairs],
        LENT: [_lent(*pair) for pair in pairs],
    }


def _weighed_as(gco: Estimate) -> Regression:
    """Weigh the runs of GCO such that it is the conservative least squares fit of them.

    F_M is a sum of norms n_k, with the gradient of sum |r_k|^2 / (2 n_k) at its optimum: over a convex cone
    one C minimises both. Least squares weighs terms by their equations N_k, so rows go by 1 / sqrt(N_k n_k).
    """
    terms = gco.regression.terms
    norms = np.array([np.sqrt(np.sum((t.R @ gco.pi - t.z) ** 2) + t.unexplained) for t in terms])
    size = np.maximum(norms, LEAST_NORM * norms.max()) * [t.n_equations for t in terms]
    shares = np.sqrt(size.mean() / size)
    weighed = (
        replace(t, R=c * t.R, z=c * t.z, unexplained=c**2 * t.unexplained)
        for c, t in zip(shares, terms, strict=True)
    )
    return (
        regression_from_terms(gco.regression.structure, tuple(weighed)) if len(terms) > 1 else gco.regression
    )


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
        more += term.n_equations / 3 * float(ours @ ours - theirs @ theirs)
    return more / ls.regression.rank


def _equal(ls: Estimate, gco: Estimate) -> Estimate:
    return ls if added(ls, gco) > TAKEN else conservative_least_squares(ls.regression)


def _lent(ls: Estimate, gco: Estimate) -> Estimate:
    """The fit of least squares, the free directions of GCO: what differs from GCO is seen by the data."""
    if ls.regression.rank == ls.structure.n_parameters:
        return ls
    free = equal_fits(ls.regression, ls.pi)
    twice = np.where(ls.structure.fills_two_entries, 2.0, 1.0)  # entries that stand at two places of C
    w: Array = free.null_space.T @ (twice * (gco.pi / free.parameter_units - free.minimum_norm_solution))
    pi = ls.pi + free.parameter_units * (free.null_space @ w)
    return replace(ls, pi=pi, C_theta=ls.structure.C_theta_of(pi))


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

    binds: bool  #: Whether the cone changes the fit: nothing conservative fits as well as least squares.
    expected: float  #: Error that noise is expected to leave least squares, over the deflection GCO predicts.


def _settings(options: GridOptions, quick: bool, seeds: range) -> GridSettings:
    """Make the settings of the flags."""
    truths = tuple(options.truth or FAMILY)
    for name in truths:
        if name not in true_arms or truths.count(name) > 1:
            raise BenchError(f"--truth: expected some of {', '.join(true_arms)}, each once, got {name!r}")
    found = GridSettings(seeds[0], truths)
    if not quick:
        return found
    gravity = replace(found.gravity, poses=(4, 8, 20), sigmas=(50e-6, 150e-6))
    full_pose = replace(found.full_pose, poses=(2, 8), sigmas=(100e-6, 400e-6))
    return replace(found, judged=40, gravity=gravity, full_pose=full_pose)


def _arms(asked: GridSettings) -> dict[Kind, Cell]:
    """Build the arm of every grid."""
    return {kind: build_cell(find_arm(grid.arm)) for kind, grid in asked.grids.items()}


def _trial(
    cells: Mapping[Kind, Cell], asked: GridSettings, seed: int, own: Models
) -> Iterator[GridMethodRow]:
    """Make the rows of a seed, one per method, structure, truth and cell of the grids."""
    for kind, cell in cells.items():
        yield from _rows(cell, kind, asked, seed, own(cell, None))


@dataclass(frozen=True)
class Clean:
    """Hold an arm's true deflections."""

    runs: Dataset  #: In the poses to identify from.
    judge: Dataset  #: In poses never measured.
    seed: int  #: Of poses, truth and noise.

    def first(self, poses: int) -> Mask:
        """Tell which runs are in the first poses, (runs,)."""
        return np.asarray(np.isin(self.runs.pose_id, np.unique(self.runs.pose_id)[:poses]))

    def read(self, grid: CellGrid) -> list[Dataset]:
        """Read every cell's runs with noise: at every level, and in every cell, the same random numbers."""
        noisy = {sigma: reread(self.runs, sigma, trial_rng(self.seed, 1)) for sigma in grid.sigmas}
        return [select_runs(noisy[sigma], self.first(poses)) for poses, sigma in grid.cells]


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
    """Rows of one kind of reading; estimators of one's own fit every structure."""
    grid, truths = asked.grids[kind], asked.arms(seed)
    structures = [make(cell.arm) for make in STRUCTURES]
    for truth, clean in zip(truths, MEASURE[kind](cell, grid, asked.judged, truths, seed), strict=True):
        data = clean.read(grid)
        left = FEATURED if (kind, truth, seed) == ("gravity", truths[0], asked.first) else None
        alone = [reduce(cell.vjm, joints_only(cell.arm), runs) for runs in data]
        joints = [solve(regression, "none") for regression in alone]
        for structure in structures:
            same = {"part": kind, "true_arm": truth, "structure": structure.name}
            cases = [
                TrialCase(
                    runs,
                    clean.judge,
                    {**same, "poses": at[0], "sigma_um": UM * at[1]},
                    runs if at == left else None,
                )
                for runs, at in zip(data, grid.cells, strict=True)
            ]
            regressions = [reduce(cell.vjm, structure, runs) for runs in data]
            own = [replace(estimator, structure=structure) for estimator in estimators]
            fits = Fits({**methods(regressions, joints), **fitted(cell, own, cases)})
            yield from _compared(cell, cases, fits, expected(cell.vjm, clean, grid, regressions))


def _compared(cell: Cell, cases: Sequence[TrialCase], fits: Fits, noise: Array) -> Iterator[GridMethodRow]:
    """Rows of one structure; noise is what it is expected to leave least squares [um]."""
    moved = deflections_of_models(cell.vjm, fits[GCO], cases[0].test)
    share = noise / (UM * np.sqrt(np.square(moved).sum(axis=3).mean(axis=(1, 2))))

    def more(name: str, k: int) -> dict[str, object]:
        known = {"expected": float(share[k]), "binds": not fits[EQUAL][k].conservative}
        return known | ({"constraint": "free"} if name == EQUAL else {})

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
    touched = regression.column_norms > 0
    A = np.vstack([np.sqrt(t.n_equations / 3) * t.R[:, touched] for t in regression.terms])
    scale = np.linalg.norm(A, axis=0)
    _, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    kept = s > RANK_TOLERANCE * s[0]
    return float(np.linalg.norm(rows[:, touched] / scale @ Vt[kept].T / s[kept]))


# --- The report ---------------------------------------------------------------------------------------------

KINDS = {"gravity": "a weight, three markers", "full_pose": "six wrenches, full pose"}
"""Kinds of reading in words."""
LEVELS = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Errors to expect of least squares by noise, over the deflection, between which fits are sorted."""
NAMES = ("0 to 1 %", "1 to 3 %", "3 to 10 %", "10 to 30 %", "30 to 100 %", "over 100 %")
FREE = "the cone does not bind"
MATTERS = 0.95  #: Ratio of errors, median, above which a gain is too small to count.
CELL = ("part", "structure", "poses", "sigma_um")
LOOKS = {SQUARES: look("MLS56", "none"), LENT: look("MLS56", "free"), JOINTS: look("Joints", "none")}
"""Of those that GCO is drawn beside."""
PAYS = "way cells cone_pays beats_too"
BY_LEVEL = TrialTable("", down="level", across="theirs", value="ratio", columns="fits_share", by="part")


def _tables(_: GridSettings) -> Mapping[str, TrialTable]:
    """Map every kind of reading; tabulate both by the error to expect; count cells in which the cone pays."""
    maps = {
        part: TrialTable(
            f"{words}: GCO over least squares, by noise",
            down="cell",
            across="sigma_um",
            value="ratio",
            where={"part": part, "name": SQUARES},
        )
        for part, words in KINDS.items()
    }
    levels = replace(
        BY_LEVEL,
        title="GCO's error divided by the other's, by the expected relative error of least squares",
        where={"pair": True},
        rows=lambda trials: BY_LEVEL.cells(trials.pick(np.argsort(trials["order"], kind="stable"))),
    )
    count = TrialTable("Cells in which the cone pays by itself", columns=PAYS, rows=paying)
    return maps | {"levels": levels, "pays": count}


def _derived(_: GridSettings, own: Trials) -> Trials:
    """Add GCO's error over theirs in the same fit, and the error to expect."""
    kind = np.array([list(KINDS).index(part) for part in own["part"]])
    level = np.where(own["binds"], np.digitize(own["expected"], LEVELS), len(NAMES))
    code, gco = 10 * kind + level, own["name"] == GCO
    share = {k: np.sum(gco & (code == k)) / np.sum(gco & (kind == k // 10)) for k in np.unique(code)}
    names = (*NAMES, FREE)
    own = own.add(
        ratio=matched(own, own.where(name=GCO), ERROR, (*CELL, "true_arm", TRIAL)) / own[ERROR],
        theirs=own["name"],
        pair=~gco,
        order=code,
        fits_share=np.array([share[k] for k in code]),
        level=[f"{KINDS[part]}: {names[k]}" for part, k in zip(own["part"], level, strict=True)],
        cell=[f"{s}, {n} poses" for s, n in zip(own["structure"], own["poses"].astype(int), strict=True)],
    )
    return by_case(own, "true_arm")


def paying(own: Trials) -> Iterator[Row]:
    """Count cells in which the cone pays by itself, with the same free directions, and beats joints too."""
    for (part,), kind in own.groups("part"):
        cone, beats = [], []
        for _, cell in kind.groups(*CELL):
            lent, joints = (cell.where(name=theirs) for theirs in (LENT, JOINTS))
            cone.append(pays(number(lent["ratio"], lent[SHARED])))
            beats.append(cone[-1] and np.mean(joints["ratio"] < 1 - SAME_ERROR) > 0.5)
        yield Row(way=KINDS[part], cells=len(cone), cone_pays=sum(cone), beats_too=int(sum(beats)))


def pays(ratio: Number) -> bool:
    """Tell whether a ratio of errors is below 1 in 95 % of the fits, and `MATTERS` at most in the median."""
    return ends(ratio)[1] < 1 and middle(ratio) <= MATTERS


def _cells(_: GridSettings, trials: Trials) -> Mapping[str, Where]:
    """Choose the cell of section 6 by structure, that in which GCO errs least first."""
    poses, sigma = FEATURED
    at = {"part": "gravity", "poses": poses, "sigma_um": UM * sigma}
    here = trials.where(name=GCO, **at)
    errors = {name: np.median(own[ERROR]) for (name,), own in here.groups("structure")}
    return {name: {**at, "structure": name} for name in sorted(errors, key=lambda name: errors[name])}


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw GCO over others by the error that noise is expected to leave, a pane a kind of reading."""
    rows = [row for row in Row(found.numbers).cells["levels"] if row.theirs != EQUAL]
    others = [name for name in dict.fromkeys(row.theirs for row in rows) if name not in LOOKS]
    looks = LOOKS | {name: look(f"own {k}", "own") for k, name in enumerate(others, 1)}
    level, theirs, ratio = columns("level theirs ratio")
    shown = (level, theirs, replace(ratio, heading="GCO's error over the other's"))
    looks = {shown[1].text(name): own for name, own in looks.items()}
    places = [name for name in (*NAMES, FREE) if any(row.level.endswith(f": {name}") for row in rows)]
    panes = {
        words: Table(
            shown,
            [Row(row, level=row.level.partition(": ")[2]) for row in rows if row.part == part],
            looks=looks,
        )
        for part, words in KINDS.items()
    }
    reading = (
        "GCO's RMS error over the other's: medians and their spread. Left of the dotted line GCO is better."
    )
    return {"regimes.png": ranges(panes, found.question, reading, 1.0, places)}


PRESET = Preset(
    name="regimes",
    page="docs/studies/regimes.md",
    question="Where does the cone help by itself?",
    how="GCO and least squares of the same structure fit the same readings, without a prior. They are judged "
    "over the workspace. Every trial has true arms of two kinds.",
    options=GridOptions,
    settings=_settings,
    seeds=(100, 2),
    row=GridMethodRow,
    trial=_trial,
    shared=_arms,
    tables=_tables,
    printed="gravity",
    cells=_cells,
    ours=GCO,
    rivals=(SQUARES,),  # the cone by itself: the same structure
    pairs=((GCO, LENT), (GCO, EQUAL), (GCO, JOINTS)),
    derived=_derived,
    figures=_figures,
    arms=lambda settings: [find_arm(grid.arm) for grid in settings.grids.values()],
)
STUDY = PRESET.study()
