"""Five ways to the least F_M of Eq. (19) on the same data: the paper's optimiser against a certificate.

"A proof of global convergence" is unviable for the paper's search over b. Over compliances the problem is
convex, and the dual of one conic program tells how far any other solution can be from the least F_M.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.errors import Array, BenchError
from testbench.files.write import csv_text
from testbench.identify.conic import certify
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.method import gco, paper_gco
from testbench.identify.regression import reduce
from testbench.report.badge import of_rivals
from testbench.report.colours import GCO, SERIES, Look
from testbench.report.figure import Figure, forest
from testbench.report.report import Report, say
from testbench.report.schema import Table, columns
from testbench.report.table import Row, Trials, merged, number
from testbench.runs.rows import trial_rng
from testbench.runs.spread import most
from testbench.studies import campaigns
from testbench.studies.campaign.trial import Fits
from testbench.studies.campaigns import CampaignRow, campaign_rows
from testbench.studies.paper.factorised import (
    CLOSE,
    MAX_ORDER,
    Factorised,
    Search,
    costs,
    explore,
    factorise,
    local_solves,
    parameters,
)
from testbench.studies.paper.six_dof_arm import TUBES
from testbench.studies.paper.verdicts import statement_row, verdict_table
from testbench.studies.run import READ, headline
from testbench.studies.study import Study
from testbench.workflows.campaign import Campaign, FullPose, simulate_full_pose
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.models import Model, named_models
from testbench.workflows.own_estimator import Models

ARM = "arm_6r"
SIGMA = math.sqrt(0.5) * 25e-6  #: The paper's is that of a deflection, a difference of two readings [m].
SCENARIO = FullPose(arm=ARM, sigma=SIGMA, sigma_rotation=10 * SIGMA, least=9e-3, most=41e-3)
SHORT_GENERATIONS = 20  #: Of the short variant of the paper's optimiser.
QUICK_GENERATIONS, QUICK_STARTS = 60, 5
WITHIN = 1.01  #: F_M over the least one at which a solver is called there: within 1 %.
PAPERS = ("a", "a'")  #: Letters of the paper's optimiser.
SHADES = {"a": SERIES[3], "a'": SERIES[2], "b": SERIES[1], "b'": SERIES[5], "c": SERIES[4], "d": GCO}
LOOKS = {key: Look(colour, place, prior=True) for place, (key, colour) in enumerate(SHADES.items())}
"""One colour and one mark a solver: the conic program green, the others not; all minimise the same F_M."""
FAST = "f_m relative_excess relative_excess_bound solve_seconds seconds_to_1_percent ratio_to_conic"
SHORT = f"solver {FAST} check_true.rms_mm"
SOLVERS = (
    f"solver {FAST} whole_ratio_to_conic evaluations local_solves local_solves_elsewhere conservative "
    "check_true.rms_mm status"
)
PANES = {
    "seconds_to_1_percent": "until F_M is within 1 %",
    "relative_excess_bound": "F_M over its proven bound",
}
REPEATS = 5  #: Calls of a conic program, of which the median time counts; one more comes first, not timed.
DIFFERENCE = math.sqrt(np.finfo(float).eps)
"""Step of the finite differences, where the entries of b are of order one; as MATLAB and scipy take it."""


@dataclass(frozen=True)
class SolverOptions:
    """Hold the flags of the study."""

    model: Annotated[str, typer.Option(metavar="NAME", help="A GCO model of the paper.")] = "MGCO69"
    m: Annotated[
        int, typer.Option(min=1, max=6, metavar="M", help="Order m of the vector space, Eq. (16).")
    ] = MAX_ORDER
    generations: Annotated[int, typer.Option(min=1, metavar="N", help="Limit for the genetic algorithm.")] = (
        1000
    )
    trial_points: Annotated[
        int, typer.Option(min=1, metavar="N", help="Trial points of the global search.")
    ] = 1000
    starts: Annotated[int, typer.Option(min=1, metavar="N", help="Local solves of the multistart.")] = 10


@dataclass(frozen=True)
class SolverSettings(SolverOptions):
    """Describe what is tried."""

    first: int = 1  #: The first seed: its runs are kept.


@dataclass(frozen=True)
class SolverRow(CampaignRow):
    """Hold what one solver found in one seed: the model, and its way down."""

    key: str = ""  #: Letter of the solver.
    relative_excess: float = 0.0  #: F_M over that of the conic program, relative.
    relative_excess_bound: float = 0.0  #: F_M over its certified lower bound, relative to the bound.
    seconds_to_1_percent: float | None = None  #: Until F_M was within 1 % of the conic program's.
    ratio_to_conic: float | None = None  #: The same over the conic program's whole time.
    whole_ratio_to_conic: float = 1.0  #: Whole time over the conic program's.
    evaluations: int | None = None  #: Of F_M; None where nobody counts them.
    local_solves: int | None = None  #: How many; None where there are none.
    local_solves_elsewhere: int | None = None  #: Those that ended more than CLOSE above the conic program.
    data_file: str | None = None  #: dataset.csv, in a row of the first seed.


@dataclass(frozen=True)
class SolverResult:
    """Hold what one solver found."""

    key: str  #: Its letter.
    estimate: Estimate  #: The model.
    way: list[tuple[float, float]]  #: Seconds and F_M of every improvement.
    seconds: float  #: Wall time of the whole call, reduction of the dataset included.
    evaluations: int | None = None  #: Of F_M; None where nobody counts them.
    solves: Sequence[float] = ()  #: F_M of its local solves.


def _forward_differences(problem: Factorised, b: Array) -> tuple[float, Array]:
    """Compute F_M(b) and its gradient by finite differences, all points at once.

    Args:
        problem: The problem.
        b: Free entries, (size,).

    Returns:
        F_M and its gradient, (size,).
    """
    values = costs(problem, np.hstack([b[:, None], b[:, None] + DIFFERENCE * np.eye(problem.size)]))
    return float(values[0]), (values[1:] - values[0]) / DIFFERENCE


def _gco_model(cell: Cell, name: str) -> Model:
    """Return a model of the paper that GCO identifies.

    Args:
        cell: The arm with its model and its truth.
        name: Name of the model.

    Returns:
        The model.

    Raises:
        BenchError: When there is none of that name, or least squares identifies it.
    """
    [model] = named_models(cell, [name])
    if model.estimator != gco:
        raise BenchError(f"model: expected one that GCO identifies, such as MGCO69, got {name}")
    return model


def _settings(options: SolverOptions, quick: bool, seeds: range) -> SolverSettings:
    """Make the settings of the flags."""
    _gco_model(build_cell(find_arm(ARM)), options.model)
    most = (QUICK_GENERATIONS, QUICK_STARTS) if quick else (options.generations, options.starts)
    generations, starts = map(min, zip((options.generations, options.starts), most, strict=True))
    return SolverSettings(**vars(options) | {"generations": generations, "starts": starts}, first=seeds[0])


def _cell_and_model(asked: SolverSettings) -> tuple[Cell, Model]:
    """Build the arm, and the model that every solver identifies."""
    cell = build_cell(find_arm(ARM))
    return cell, _gco_model(cell, asked.model)


def _trial(shared: tuple[Cell, Model], asked: SolverSettings, seed: int, _: Models) -> list[SolverRow]:
    """Make the rows of a seed, one per solver."""
    cell, model = shared
    campaign = simulate_full_pose(cell, SCENARIO, seed)
    conic = _conic(cell, model, campaign)
    solver_results = [*_factor_solvers(cell, model, asked, campaign), conic]
    proof = conic.estimate.certificate
    assert proof is not None
    proofs = [
        proof if solver_result is conic else certify(solver_result.estimate, dual=proof.dual)
        for solver_result in solver_results
    ]
    fits = Fits(
        {
            solver_result.key: [replace(solver_result.estimate, certificate=proven)]
            for solver_result, proven in zip(solver_results, proofs, strict=True)
        },
        {solver_result.key: solver_result.seconds for solver_result in solver_results},
    )
    data = csv_text(campaign.identification, cell.arm) if seed == asked.first else None
    rows = campaign_rows(cell, campaign, fits, TUBES, placed=False)
    return [
        replace(
            _row(replace(row, name=model.name), solver_result, conic, proven.f_m_excess_bound),
            data_file=data if solver_result is conic else None,
        )
        for row, solver_result, proven in zip(rows, solver_results, proofs, strict=True)
    ]


def _conic(cell: Cell, model: Model, campaign: Campaign) -> SolverResult:
    """The conic program with its certificate: median time of several calls."""
    calls = []
    for _ in range(1 + REPEATS):
        start = perf_counter()
        estimate = paper_gco(cell.vjm, model.structure, campaign.identification)
        seconds = perf_counter() - start
        calls.append(SolverResult("d", estimate, [(seconds, estimate.f_m)], seconds))
    return sorted(calls[1:], key=lambda call: call.seconds)[REPEATS // 2]


def _factor_solvers(
    cell: Cell, model: Model, asked: SolverOptions, campaign: Campaign
) -> Iterator[SolverResult]:
    """The solvers over b: the paper's, long and short, and local solves from random starts."""
    of_paper = partial(explore, trials=asked.trial_points)
    runs = (  # the number is that of its stream of random starts
        ("a", 10, partial(of_paper, generations=asked.generations)),
        ("a'", 10, partial(of_paper, generations=SHORT_GENERATIONS)),
        ("b", 11, partial(local_solves, starts=1)),
        ("b'", 11, partial(local_solves, starts=1, evaluate=_forward_differences)),  # from the same start
        ("c", 12, partial(local_solves, starts=asked.starts)),
    )
    for key, stream, solver in runs:
        way: list[tuple[float, float]] = []
        start = perf_counter()
        problem = factorise(reduce(cell.vjm, model.structure, campaign.identification), asked.m)
        search = Search(problem, partial(_note, way, start))
        solver(search, trial_rng(campaign.seed, stream))
        pi, method = parameters(problem, search.best), f"GCO over b, m = {asked.m}"
        estimate = make_estimate(problem.regression, pi, method=method, constraint="psd")
        estimate = replace(estimate, status="budget spent" if key in PAPERS else "local optimum")
        each = problem.size + 1 if key == "b'" else 1  # differences take F_M at as many points
        solves = [descent.f_m for descent in search.descents]
        yield SolverResult(key, estimate, way, perf_counter() - start, each * search.evaluations, solves)


def _note(way: list[tuple[float, float]], start: float, f_m: float) -> None:
    way.append((perf_counter() - start, f_m))


def _row(row: CampaignRow, own: SolverResult, conic: SolverResult, excess: float) -> SolverRow:
    f_m, best = own.estimate.f_m, conic.estimate.f_m
    there = next((seconds for seconds, value in own.way if value <= WITHIN * best), None)
    elsewhere = [value > best * (1 + CLOSE) for value in own.solves]
    return SolverRow(
        **vars(row),
        key=own.key,
        relative_excess=f_m / best - 1,
        relative_excess_bound=excess / (f_m - excess),
        seconds_to_1_percent=there,
        ratio_to_conic=None if there is None else there / conic.seconds,
        whole_ratio_to_conic=own.seconds / conic.seconds,
        evaluations=own.evaluations,
        local_solves=len(elsewhere) or None,
        local_solves_elsewhere=sum(elsewhere) if elsewhere else None,
    )


def _report(asked: SolverSettings, seeds: range, trials: Trials) -> Report:
    """Report medians and spreads of every solver, and what the proof says of the paper's search."""
    solvers, own = list(_solvers(asked, trials)), trials.where(key="d")
    rows = {row.key: row for row in solvers}
    ends = [rows[key] for key in ("a", "a'", "b", "c")]
    f = Row(
        seed=list(seeds),
        arm=ARM,
        model=asked.model,
        m=asked.m,
        noise=SCENARIO.noise,
        truth=SCENARIO.truth,
        dataset=campaigns.dataset(own, SCENARIO.poses),
        solvers=solvers,
        models=[Row(rows["d"], paper=None)],
        floor_out_of_reach=int((own["f_m"] - own["f_m_excess_bound"] > own["f_m_floor"]).sum()),
        elsewhere=sum(row.local_solves_elsewhere or 0 for row in ends),
        local_solves=sum(row.local_solves or 0 for row in ends),
    )
    f["claims"] = list(_statements(f, len(seeds)))
    there = trials.pick(np.isfinite(trials["seconds_to_1_percent"]))
    there = there.add(name=[rows[key].solver for key in there["key"].tolist()])
    rivals = [row.solver for row in solvers if row.key != "d"]
    badge = of_rivals(there, rows["d"].solver, rivals, "seconds_to_1_percent")
    badge = badge and replace(badge, what="time to 1 %")
    short = Table(columns(SHORT), solvers, headline="seconds_to_1_percent", looks=_looks(solvers))
    return Report(
        scenario=STUDY.name,
        question=say("{arm}, {model}: which solver finds the best model, and how fast?", f),
        title=say(
            "{arm}: {model} by Eq. (19) of the paper with m = {m}; {dataset.runs} runs in "
            "{dataset.poses} poses; {seeds:counted seed}",
            f,
            seeds=len(seeds),
        ),
        answer=headline(badge, short),
        numbers=f,
        tables={
            "short": short,
            "solvers": Table(columns(SOLVERS), solvers),
            "claims": verdict_table(f.claims),
        },
        body=["solvers", "claims", READ],
        badge=badge,
    )


def _solvers(asked: SolverSettings, trials: Trials) -> Iterator[Row]:
    """A row a solver; a time to 1 % is of those seeds in which it came there."""
    names: Mapping[str, str] = {
        "a": f"the paper's search, {asked.generations} generations",
        "a'": f"the paper's search, {SHORT_GENERATIONS} generations",
        "b": "one local solve by gradient",
        "b'": "one local solve by differences",
        "c": f"{asked.starts} local solves",
        "d": "the conic program",
    }
    for (key,), own in trials.drop(*campaigns.NOT_OF_A_MODEL).groups("key"):
        there = own.pick(np.isfinite(own["seconds_to_1_percent"]))
        [row] = merged(own)
        for name in ("seconds_to_1_percent", "ratio_to_conic"):
            row[name] = number(there[name]) if len(there) else None
        for name in ("local_solves", "local_solves_elsewhere"):
            row[name] = None if row[name] is None else int(own[name].sum())
        yield Row(row, solver=names[key], within_1_percent=len(there))


def _looks(solvers: Sequence[Row]) -> dict[str, Look]:
    """Give each solver the look of its letter."""
    return {row.solver: LOOKS[row.key] for row in solvers}


def _statements(f: Row, seeds: int) -> Iterator[Row]:
    """What the paper says of its search, and of the F_M at which it would stop."""
    bound = f.models[0].relative_excess_bound
    proven = most(bound) <= WITHIN - 1
    unviable = statement_row(
        'a proof of the global optimum is "unviable" (ours: relative bound of F_M)', False, None
    )
    yield Row(unviable, found=bound, verdict="contradicted" if proven else unviable.verdict)
    share = 1 - f.elsewhere / f.local_solves
    yield statement_row("with m = n, every local solve over b ends at the global optimum", share == 1, share)
    stops = 1 - f.floor_out_of_reach / seeds
    yield statement_row("the search can stop at the F_M of noise alone", stops == 1, stops)


def _figures(found: Report) -> dict[str, Figure]:
    """Draw the time to the least F_M, and how far above what is proven every solver ends."""
    f = Row(found.numbers)
    table = found.led(Table(columns(SHORT), f.solvers, looks=_looks(f.solvers)))
    title = f"{f.model}, {f.arm}: solvers of Eq. (19)"
    return {"solver_comparison.png": forest(table, PANES, title, f"{found.title}.")}


STUDY = Study(
    name="solver_comparison",
    about="Minimise F_M by several solvers on the data of section 5.2, and certify what each of them found.",
    options=SolverOptions,
    settings=_settings,
    seeds=(20, 2),
    arms=lambda _: [find_arm(ARM)],
    row=SolverRow,
    trial=_trial,
    shared=_cell_and_model,
    report=_report,
    printed=("short",),
    figures=_figures,
)
