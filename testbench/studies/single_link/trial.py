"""Section 5.1 tried: one link, six loads, one draw of noise; least squares, GCO, and GCO of every order m.

The truth is Eq. (21). Eq. (22) and (23) are one draw of what is counted here over a thousand.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.arm.stiffness import SYMMETRY_TOLERANCE
from testbench.campaign.campaign import Cell, build_cell, stream
from testbench.campaign.campaign import measure as read
from testbench.campaign.evaluation import of_model
from testbench.campaign.models import Model
from testbench.campaign.pose_campaign import FullPose, at_tool, random_wrenches
from testbench.campaign.rows import UM, DatasetRow, FitRow, dataset_row, fit_row
from testbench.data.dataset import Dataset
from testbench.data.write import csv_text
from testbench.errors import Array
from testbench.identify import Estimate, least_squares, paper_gco
from testbench.identify.estimate import CONSERVATIVE_TOLERANCE
from testbench.model.structure import Structure, free36
from testbench.studies.paper import EQ_22, EQ_23, every_order

NAME = "single_link"
LEAST_SQUARES, SYMMETRIC, GCO = "MLS36", "MLS21", "MGCO21"
PRINTED = {LEAST_SQUARES: EQ_22, GCO: EQ_23}  #: What the paper prints, of one draw.
STARTS = 8  #: Local solves of every order m: below 6 there are local minima that are not global.
ORDERED, QUICK_ORDERED = 200, 3  #: Draws that are solved for every order m too.
AT_OPTIMUM = 1e-6
"""Share of F_M by which a local solve may exceed the certified optimum and still have reached it."""
LEAST = 1e-8  #: Excess of F_M below is rounding of two solvers [1].

SECTION_5_1 = FullPose(
    arm=NAME,
    poses=1,
    force=10.0,
    moment=10.0,
    sigma=25e-6 / math.sqrt(2),  # of one reading: the paper's noise is that of a deflection
    sigma_rotation=250e-6 / math.sqrt(2),
    check_runs=120,
)
NO_RANK = 1e-4
"""Eigenvalue, in units of what noise causes, below which it counts as zero: solvers leave 1e-8."""
Loads = Literal["axes", "random"]


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    loads: Annotated[Loads, typer.Option(help="One axis at a time, or six random wrenches.")] = "axes"


@dataclass(frozen=True, kw_only=True)
class Settings(Options):
    """What is tried."""

    first: int = 1000  #: The first draw: it keeps its readings.
    ordered: int = 0  #: Draws, from the first, that are solved for every order m too.
    starts: int = STARTS  #: Local solves of every order.
    campaign: FullPose = SECTION_5_1  #: Loads, noise and number of check loads.


@dataclass(frozen=True)
class Judged:
    """A compliance judged.

    Its smallest eigenvalue is that of the symmetric part, or, as the paper counts, the real part of the
    matrix's own, in 1e-6 of mixed SI units.
    """

    symmetric: bool
    symmetric_eigenvalue_micro: float
    matrix_eigenvalue_micro: float
    negative_eigenvalue: bool
    negative_eigenvalue_matrix: bool
    #: RMS errors over the nine entries of a block of C, by what it turns into what.
    force_position_rms_um_per_N: float
    moment_position_rms_um_per_Nm: float
    force_rotation_rms_urad_per_N: float
    moment_rotation_rms_urad_per_Nm: float
    #: RMS distances under the check loads, and as a share of the RMS deflection.
    position_rms_um: float
    position_relative_percent: float
    rotation_rms_urad: float
    rotation_relative_percent: float


@dataclass(frozen=True)
class LinkRow(FitRow, Judged):
    """What one method made of one draw."""

    measured: DatasetRow  #: The readings.
    condition: float  #: Condition number of the loads, in units of force and moment [1].
    rank_of_C: int  #: Eigenvalues beyond rounding.
    error: tuple[float, ...]  #: C minus the true one, row by row, (36,) [m/N, rad/N, rad/(N m)].
    #: Order of the vector space of Eq. (16) where a local solve searched it; 0 for a convex solve.
    m: int = 0
    f_m_over_optimum: float = 1.0  #: F_M, the best of some local solves, over the certified optimum.
    excess_percent: float = 0.0  #: The same above it, at least `LEAST`.
    reaches_optimum: bool = True  #: Whether the two are the same.
    printed: Judged | None = None  #: The paper's matrix under the check loads, in the first draw.
    data_file: str | None = None  #: dataset.csv, in the first draw.


@dataclass(frozen=True)
class Draw:
    """Noisy readings under the six loads, and noise-free ones under the check loads."""

    identification: Dataset
    truth: Dataset


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    return Settings(options.loads, first=seeds[0], ordered=QUICK_ORDERED if quick else ORDERED)


def models(cell: Cell) -> list[Model]:
    """Least squares with 36 entries, the same with 21, and GCO: what symmetry gives, what the constraint."""
    full = partial(Structure.of, cell.arm, links=[link.name for link in cell.arm.links])
    return [
        Model(LEAST_SQUARES, free36(cell.arm), least_squares),
        Model(SYMMETRIC, full(name=SYMMETRIC), least_squares),
        Model(GCO, full(name=GCO), paper_gco),
    ]


def measure(cell: Cell, asked: Settings, seed: int) -> Draw:
    """Load the true link, read it, and draw loads to check with."""
    campaign = asked.campaign
    if asked.loads == "axes":
        wrench = np.diag([campaign.force] * 3 + [campaign.moment] * 3)
    else:
        wrench = wrenches_within(6, campaign.force, campaign.moment, stream(seed, 2))
    check = wrenches_within(campaign.check_runs, campaign.force, campaign.moment, stream(seed, 0))
    return Draw(
        identification=_read(cell, campaign, wrench, stream(seed, 1)),
        truth=_read(cell, campaign, check, None),
    )


def _read(cell: Cell, campaign: FullPose, wrench: Array, rng: np.random.Generator | None) -> Dataset:
    only = at_tool(np.empty((len(wrench), 0)), np.ones(len(wrench), dtype=int), wrench)
    return read(cell, campaign, only, rng)


def wrenches_within(count: int, force: float, moment: float, rng: np.random.Generator) -> Array:
    """Wrenches spread evenly over the balls |F| <= force and |M| <= moment, (count, 6) [N, N m]."""
    size = np.repeat(np.cbrt(rng.uniform(size=(count, 2))), 3, axis=1)
    return size * random_wrenches(count, force, moment, rng)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[LinkRow]]:
    """What every model, and in the first draws every order m, made of some draws."""
    cell = build_cell(find_arm(NAME))
    return [list(_trial(cell, asked, seed)) for seed in seeds]


def _trial(cell: Cell, asked: Settings, seed: int) -> Iterator[LinkRow]:
    draw = measure(cell, asked, seed)
    for model in models(cell):
        start = time.perf_counter()
        estimate = of_model(cell, model, draw.identification)
        fit = fit_row(model.name, estimate, time.perf_counter() - start)
        row = _row(cell, asked, draw, fit, estimate)
        if seed == asked.first and model.name in PRINTED:
            known = judge(cell, np.array(PRINTED[model.name]), draw.truth)
            row = replace(row, printed=known, data_file=csv_text(draw.identification, ()))
        yield row
    if seed < asked.first + asked.ordered:
        orders = every_order(cell, model.structure, draw.identification, asked.starts, seed)
        for m, own in enumerate(orders, start=1):
            ratio = own.f_m / estimate.f_m  # of the last one, GCO
            yield replace(
                _row(cell, asked, draw, fit_row(GCO, own, 0.0), own),
                m=m,
                f_m_over_optimum=ratio,
                excess_percent=100 * max(LEAST, ratio - 1),
                reaches_optimum=ratio <= 1 + AT_OPTIMUM,
            )


def _row(cell: Cell, asked: Settings, draw: Draw, fit: FitRow, estimate: Estimate) -> LinkRow:
    campaign, C = asked.campaign, estimate.C_theta
    load = draw.identification.wrench / ([campaign.force] * 3 + [campaign.moment] * 3)
    return LinkRow(
        **vars(judge(cell, C, draw.truth)),
        **vars(fit) | {"advice": ()},  # it differs from draw to draw
        measured=dataset_row(draw.identification),
        condition=float(np.linalg.cond(load)),
        rank_of_C=rank_beyond_noise(campaign, C),
        error=tuple((C - cell.arm.C_theta).ravel().tolist()),
    )


def judge(cell: Cell, C: Array, truth: Dataset) -> Judged:
    """Eigenvalues of C, (6, 6) [m/N, rad/N, rad/(N m)], and errors, also under noise-free loads."""
    matrix, symmetric = eigenvalues(C)
    zero = -CONSERVATIVE_TOLERANCE * np.abs(matrix).max()
    error = C - cell.arm.C_theta
    return Judged(
        symmetric=bool(np.abs(C - C.T).max() <= SYMMETRY_TOLERANCE * np.abs(C).max()),
        symmetric_eigenvalue_micro=UM * float(symmetric[0]),
        matrix_eigenvalue_micro=UM * float(matrix[0]),
        negative_eigenvalue=bool(symmetric[0] < zero),
        negative_eigenvalue_matrix=bool(matrix[0] < zero),
        force_position_rms_um_per_N=UM * rms(error[:3, :3]),
        moment_position_rms_um_per_Nm=UM * rms(error[:3, 3:]),
        force_rotation_rms_urad_per_N=UM * rms(error[3:, :3]),
        moment_rotation_rms_urad_per_Nm=UM * rms(error[3:, 3:]),
        **prediction_errors(C, truth),
    )


def prediction_errors(C: Array, truth: Dataset) -> dict[str, float]:
    """Errors of the deflections that a compliance predicts under the loads of some noise-free readings."""
    position, rotation = truth.deflection[:, 0], truth.rotation
    off = truth.wrench @ C.T - np.hstack([position, rotation])
    return {
        "position_rms_um": UM * math.sqrt(3) * rms(off[:, :3]),
        "position_relative_percent": 100 * rms(off[:, :3]) / rms(position),
        "rotation_rms_urad": UM * math.sqrt(3) * rms(off[:, 3:]),
        "rotation_relative_percent": 100 * rms(off[:, 3:]) / rms(rotation),
    }


def eigenvalues(C: Array) -> tuple[Array, Array]:
    """Real parts of the eigenvalues of a matrix, as the paper counts, and those of its symmetric part."""
    return np.sort(np.linalg.eigvals(C).real), np.asarray(np.linalg.eigvalsh((C + C.T) / 2))


def noise_scale(campaign: FullPose) -> Array:
    """Noise of an entry read directly, sqrt(2) sigma over the load, (6, 6) [m/N, 1/N, rad/(N m)]."""
    sigma = np.repeat([campaign.sigma, campaign.sigma_rotation], 3)
    load = np.repeat([campaign.force, campaign.moment], 3)
    return np.asarray(np.sqrt(2) * sigma[:, None] / load)


def rank_beyond_noise(campaign: FullPose, C: Array) -> int:
    """Eigenvalues of the symmetric part that are no rounding of zero, in units of what noise causes."""
    unit = np.sqrt(np.diag(noise_scale(campaign)))
    values = np.linalg.eigvalsh((C + C.T) / 2 / np.outer(unit, unit))
    return int((np.abs(values) > NO_RANK).sum())


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
