"""Section 5.1: one link, six loads; least squares, GCO, and GCO of every order m over many draws of noise.

The truth is Eq. (21). Eq. (22) and (23) are one draw of what is counted here over a thousand.
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.elastic import SYMMETRY_TOLERANCE
from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.files.write import csv_text
from testbench.identify.estimate import CONSERVATIVE_TOLERANCE, Estimate
from testbench.identify.method import least_squares, paper_gco
from testbench.model.structure import Structure, mls36
from testbench.report.badge import of_rivals
from testbench.report.figure import Figure, forest
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.schema import Table, columns
from testbench.report.table import Row, Trials, aligned, merged
from testbench.runs.rows import nested, trial_rng
from testbench.runs.spread import wins
from testbench.studies import campaigns
from testbench.studies.paper.factorised import every_order, order_range
from testbench.studies.paper.verdicts import EQ_22, EQ_23, comparison, statement_row, verdict_table
from testbench.studies.run import READ, headline, warnings
from testbench.studies.study import Study
from testbench.workflows.advice import fit_row
from testbench.workflows.campaign import FullPose, at_tool, random_wrenches
from testbench.workflows.campaign import measure_markers as read
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.models import Model, fit_model
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import UM, DatasetRow, FitRow, dataset_row

NAME = "single_link"
LEAST_SQUARES, SYMMETRIC, GCO = "MLS36", "MLS21", "MGCO21"
PRINTED = {LEAST_SQUARES: EQ_22, GCO: EQ_23}  #: What the paper prints, of one draw.
STARTS = 8  #: Local solves of every order m: below 6 there are local minima that are not global.
ORDERED, QUICK_ORDERED = 200, 3  #: Draws that are solved for every order m too.
AT_OPTIMUM = 1e-6
"""Share of F_M by which a local solve may exceed the certified optimum and still have reached it."""
MIN_EXCESS = 1e-8  #: Excess of F_M below is rounding of two solvers [1].

SECTION_5_1 = FullPose(
    arm=NAME,
    poses=1,
    force=10.0,
    moment=10.0,
    sigma=25e-6 / math.sqrt(2),  # of one reading: the paper's noise is that of a deflection
    sigma_rotation=250e-6 / math.sqrt(2),
    check_runs=120,
)
POSITION, ROTATION, ENTRY = "position_rms_um", "rotation_rms_urad", "force_position_rms_um_per_N"
SHARES = ("conservative", "symmetric", "negative_eigenvalue", "negative_eigenvalue_matrix", "reaches_optimum")
"""Truth values that a report gives as shares of the draws."""
OF_A_DRAW = ("seed", "measured.", "condition", "error", "printed.", "data_file")
SHAPE = (
    "name conservative symmetric negative_eigenvalue_matrix negative_eigenvalue matrix_eigenvalue_micro "
    "symmetric_eigenvalue_micro f_m f_m_floor"
)
ERRORS = (
    f"name {POSITION} position_relative_percent {ROTATION} rotation_relative_percent {ENTRY} "
    "moment_position_rms_um_per_Nm force_rotation_rms_urad_per_N moment_rotation_rms_urad_per_Nm"
)
ORDER = f"m f_m excess_percent reaches_optimum {POSITION} {ROTATION}"
Loads = Literal["axes", "random"]


@dataclass(frozen=True)
class SingleLinkOptions:
    """Hold the flags of the study."""

    loads: Annotated[Loads, typer.Option(help="One axis at a time, or six random wrenches.")] = "axes"


@dataclass(frozen=True, kw_only=True)
class SingleLinkSettings(SingleLinkOptions):
    """Describe what is tried."""

    first: int = 1000  #: The first draw: it keeps its readings.
    ordered: int = 0  #: Draws, from the first, that are solved for every order m too.
    starts: int = STARTS  #: Local solves of every order.
    campaign: FullPose = SECTION_5_1  #: Loads, noise and number of check loads.


@dataclass(frozen=True)
class Matrix:
    """Compare a compliance with the true one.

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
class LinkRow(FitRow, Matrix):
    """Hold what one method made of one draw."""

    measured: DatasetRow  #: The readings.
    condition: float  #: Condition number of the loads, in units of force and moment [1].
    error: tuple[float, ...]  #: C minus the true one, row by row, (36,) [m/N, rad/N, rad/(N m)].
    #: Order of the vector space of Eq. (16) where a local solve searched it; 0 for a convex solve.
    m: int = 0
    f_m_over_optimum: float = 1.0  #: F_M, the best of some local solves, over the certified optimum.
    excess_percent: float = 0.0  #: The same above it, at least `MIN_EXCESS`.
    reaches_optimum: bool = True  #: Whether the two are the same.
    printed: Matrix | None = None  #: The paper's matrix under the check loads, in the first draw.
    data_file: str | None = None  #: dataset.csv, in the first draw.


@dataclass(frozen=True)
class Draw:
    """Hold noisy readings under the six loads, and noise-free ones under the check loads."""

    identification: Dataset
    truth: Dataset


def _settings(options: SingleLinkOptions, quick: bool, seeds: range) -> SingleLinkSettings:
    """Make the settings of the flags."""
    return SingleLinkSettings(options.loads, first=seeds[0], ordered=QUICK_ORDERED if quick else ORDERED)


def models(cell: Cell) -> list[Model]:
    """List least squares with 36 entries, with 21, and GCO: what symmetry gives, what the constraint."""
    full = partial(Structure.of, cell.arm, links=[link.name for link in cell.arm.links])
    return [
        Model(LEAST_SQUARES, mls36(cell.arm), least_squares),
        Model(SYMMETRIC, full(name=SYMMETRIC), least_squares),
        Model(GCO, full(name=GCO), paper_gco),
    ]


def _link(_: SingleLinkSettings) -> Cell:
    """Build the link."""
    return build_cell(find_arm(NAME))


def measure(cell: Cell, asked: SingleLinkSettings, seed: int) -> Draw:
    """Load the true link, read it, and draw loads to check with.

    Args:
        cell: The arm with its model and its truth.
        asked: Settings of the study.
        seed: Seed of the trial.

    Returns:
        The readings.
    """
    campaign = asked.campaign
    if asked.loads == "axes":
        wrench = np.diag([campaign.force] * 3 + [campaign.moment] * 3)
    else:
        wrench = wrenches_within(6, campaign.force, campaign.moment, trial_rng(seed, 2))
    check = wrenches_within(campaign.check_runs, campaign.force, campaign.moment, trial_rng(seed, 0))
    return Draw(
        identification=_read(cell, campaign, wrench, trial_rng(seed, 1)),
        truth=_read(cell, campaign, check, None),
    )


def _read(cell: Cell, campaign: FullPose, wrench: Array, rng: np.random.Generator | None) -> Dataset:
    only = at_tool(np.empty((len(wrench), 0)), np.ones(len(wrench), dtype=int), wrench)
    return read(cell, campaign, only, rng)


def wrenches_within(count: int, force: float, moment: float, rng: np.random.Generator) -> Array:
    """Draw wrenches spread evenly over the balls |F| <= force and |M| <= moment.

    Args:
        count: Number of wrenches.
        force: Largest force [N].
        moment: Largest moment [N m].
        rng: Source of randomness.

    Returns:
        Wrenches, (count, 6) [N, N m].
    """
    size = np.repeat(np.cbrt(rng.uniform(size=(count, 2))), 3, axis=1)
    return size * random_wrenches(count, force, moment, rng)


def _trial(cell: Cell, asked: SingleLinkSettings, seed: int, _: Models) -> Iterator[LinkRow]:
    """Fit every model, and in the first draws every order m, to a draw."""
    draw = measure(cell, asked, seed)
    for model in models(cell):
        start = time.perf_counter()
        estimate = fit_model(cell, model, draw.identification)
        fit = fit_row(model.name, estimate, time.perf_counter() - start)
        row = _row(cell, asked, draw, fit, estimate)
        if seed == asked.first and model.name in PRINTED:
            known = _examine(cell, np.array(PRINTED[model.name]), draw.truth)
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
                excess_percent=100 * max(MIN_EXCESS, ratio - 1),
                reaches_optimum=ratio <= 1 + AT_OPTIMUM,
            )


def _row(cell: Cell, asked: SingleLinkSettings, draw: Draw, fit: FitRow, estimate: Estimate) -> LinkRow:
    campaign, C = asked.campaign, estimate.C_theta
    load = draw.identification.wrench / ([campaign.force] * 3 + [campaign.moment] * 3)
    return LinkRow(
        **vars(_examine(cell, C, draw.truth)),
        **vars(fit) | {"advice": ()},  # it differs from draw to draw
        measured=dataset_row(draw.identification),
        condition=float(np.linalg.cond(load)),
        error=tuple((C - cell.arm.C_theta).ravel().tolist()),
    )


def _examine(cell: Cell, C: Array, truth: Dataset) -> Matrix:
    """Compute eigenvalues of C and its errors, also under noise-free loads.

    Args:
        cell: The arm with its model and its truth.
        C: Compliance, (6, 6) [m/N, rad/(N m)].
        truth: True deflections.

    Returns:
        The comparison.
    """
    matrix, symmetric = eigenvalues(C)
    zero = -CONSERVATIVE_TOLERANCE * np.abs(matrix).max()
    error = C - cell.arm.C_theta
    return Matrix(
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
    """Compute errors of the deflections that a compliance predicts under noise-free loads.

    Args:
        C: Compliance, (6, 6) [m/N, rad/(N m)].
        truth: True deflections.

    Returns:
        Errors by name.
    """
    position, rotation = truth.deflection[:, 0], truth.rotation
    off = truth.wrench @ C.T - np.hstack([position, rotation])
    return {
        "position_rms_um": UM * math.sqrt(3) * rms(off[:, :3]),
        "position_relative_percent": 100 * rms(off[:, :3]) / rms(position),
        "rotation_rms_urad": UM * math.sqrt(3) * rms(off[:, 3:]),
        "rotation_relative_percent": 100 * rms(off[:, 3:]) / rms(rotation),
    }


def eigenvalues(C: Array) -> tuple[Array, Array]:
    """Compute real parts of the eigenvalues of a matrix, as the paper does, and of its symmetric part."""
    return np.sort(np.linalg.eigvals(C).real), np.asarray(np.linalg.eigvalsh((C + C.T) / 2))


def rms(values: Array) -> float:
    """Compute the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _report(asked: SingleLinkSettings, seeds: range, trials: Trials) -> Report:
    """Report medians and spreads of every method and order, the paper's statements, and who is nearer."""
    f = _numbers(asked, seeds, trials)
    errors = Table(columns(ERRORS), f.models, "How far off", headline=POSITION)
    badge = of_rivals(trials.where(m=0), GCO, [LEAST_SQUARES, SYMMETRIC], POSITION)
    return Report(
        scenario=NAME,
        question=Markdown(
            "Single link, section 5.1: is a conservative compliance nearer the truth than least squares?"
        ),
        title=say(
            "Eq. (21): {dataset.runs} loads, noise of a deflection {dataset.sigma_of_a_deflection_um:g} um "
            "and {dataset.sigma_of_a_deflection_urad:g} urad; {draws:counted draw}",
            f,
        ),
        answer=headline(badge, errors),
        claims=warnings(trials.where(m=0)),
        numbers=f,
        tables={
            "shape": Table(
                columns(SHAPE), f.models, "What kind of matrix", headline="symmetric_eigenvalue_micro"
            ),
            "errors": errors,
            "claims": verdict_table(f.claims),
            "order": Table(columns(ORDER, paper=False), f.order, "The order m, Eq. (20)"),
        },
        body=["shape", "errors", "claims", "order", READ],
        badge=badge,
    )


def _numbers(asked: SingleLinkSettings, seeds: range, trials: Trials) -> Row:
    """All numbers of report.json."""
    plain = trials.where(m=0)
    searched = trials.pick(trials["m"] > 0)
    campaign = asked.campaign
    um, urad = UM * campaign.sigma, UM * campaign.sigma_rotation
    data, [loads] = campaigns.dataset(plain), merged(plain.where(name=GCO).keep("condition"))
    low, high = order_range(models(_link(asked))[-1].structure, data.runs)
    rows = [_merged(own, **_entries(own)) for _, own in plain.groups("name")]
    order = [_merged(own) for _, own in searched.groups("m")]
    return Row(
        seed=seeds[0],
        draws=len(seeds),
        arm=campaign.arm,
        truth=campaign.truth,
        noise=campaign.noise,
        noise_per="deflection",
        loads=asked.loads,
        condition_of_the_loads=loads.condition,
        dataset=Row(
            data,
            check_runs=campaign.check_runs,
            sigma_urad=urad,
            sigma_of_a_deflection_um=math.sqrt(2) * um,
            sigma_of_a_deflection_urad=math.sqrt(2) * urad,
        ),
        order_range=(low, high),
        models=rows,
        order_draws=len(searched.values("seed")),
        order=order,
        claims=[
            *_statements(plain, {m.name: m for m in rows}),
            statement_row(
                f"any order m that Eq. (20) allows, {low:g} to {high:g}, reaches the least F_M",
                all(row.reaches_optimum == 1 for row in order if row.m >= low),
                min(row.reaches_optimum for row in order if row.m >= low),
            ),
        ],
    )


def _statements(plain: Trials, by: Mapping[str, Row]) -> Iterator[Row]:
    """The paper's statements of section 5.1, and of each the same beside a symmetric matrix."""
    for name, share, claim in (
        (GCO, 1, "GCO always gives a conservative matrix (Eq. 23)"),
        (LEAST_SQUARES, 0, "least squares never does (Eq. 22)"),
        (SYMMETRIC, 0, "least squares with a symmetric matrix never does (not in the paper)"),
    ):
        holds = by[name].conservative if share else 1 - by[name].conservative
        yield statement_row(claim, holds == 1, holds)
    for other, words in ((LEAST_SQUARES, ""), (SYMMETRIC, " with a symmetric matrix (not in the paper)")):
        ours, theirs = aligned(plain, (GCO, other), POSITION).T
        claim = f"GCO predicts positions better than least squares{words}"
        yield comparison(claim, wins(ours, theirs), wins(theirs, ours), len(ours))


def _merged(own: Trials, **more: object) -> Row:
    [row] = merged(own.drop(*OF_A_DRAW))
    return Row(row, **{key: float(row[key]) for key in SHARES}, **more)


def _entries(own: Trials) -> dict[str, object]:
    """Errors of the entries of C over all draws, and what the paper's printed matrix has."""
    error = np.array(own["error"].tolist()).reshape(-1, 6, 6)
    name, first = str(own["name"][0]), own.inside("printed")
    known = nested({key: cells[0] for key, cells in first.columns.items()}) if name in PRINTED else None
    if known:
        known |= {"conservative": known.symmetric}
        # F_M of least squares is 0; the sign of an eigenvalue of Eq. (23) lies below its printed digits
        signs = {"negative_eigenvalue": None, "negative_eigenvalue_matrix": None}
        known |= {"f_m": 0.0} if name == LEAST_SQUARES else signs
    rms_, bias = np.sqrt((error**2).mean(axis=0)), error.mean(axis=0)
    return {"entry_rms": rms_.tolist(), "entry_bias": bias.tolist(), "paper": known}


def _figures(found: Report) -> dict[str, Figure]:
    """Draw the errors of every method in position, rotation and the entries of C."""
    panes = {POSITION: "position", ROTATION: "rotation", ENTRY: "entries of C, force to position"}
    reading = (
        "Grey diamonds: the paper's printed matrices. Dotted line: least squares with a symmetric matrix."
    )
    title = "Section 5.1, a single link: errors of the compliance"
    return {"single_link.png": forest(found.tables["errors"], panes, title, reading, SYMMETRIC)}


STUDY = Study(
    name=NAME,
    about="Identify the single link of section 5.1 by least squares and by GCO, over many draws of noise.",
    options=SingleLinkOptions,
    settings=_settings,
    seeds=(1000, 100),
    arms=lambda _: [find_arm(NAME)],
    row=LinkRow,
    trial=_trial,
    shared=_link,
    report=_report,
    printed=("errors", "shape"),
    figures=_figures,
    size=10,
)
