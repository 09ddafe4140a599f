"""What the trials say: F_M and times of every solver, what is proven, where local solves end."""

from collections.abc import Iterator, Mapping

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.full_pose import simulate
from testbench.bench.rows import UM
from testbench.data.csvfile import write_csv
from testbench.identify.factorised import CLOSE, LARGEST_ORDER
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged, number
from testbench.studies.solver_comparison.figure import LOOKS, solver_comparison
from testbench.studies.solver_comparison.trial import ARM, ORDERS, Settings
from testbench.studies.study import Run
from testbench.trials.spread import middle
from testbench.views.figure import Figure
from testbench.views.gains import ratio
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table

SHARP = 1e-6  #: Relative excess of F_M within which local solves end that do not creep along a flat valley.
NEVER_ABOVE = 1e-9  #: Relative difference of F_M that rounding leaves.
FAST = "f_m relative_excess relative_excess_bound seconds seconds_to_1_percent ratio_to_conic"
SHORT = f"key {FAST} check_true.rms_mm"
SOLVERS = (
    f"solver {FAST} whole_ratio_to_conic evaluations local_solves local_solves_elsewhere conservative "
    "check_true.rms_mm check_true.p95_mm status"
)
MINIMA = (
    "m starts reference within_1e_6_percent within_1e_5_percent median_excess worst_excess unfinished "
    "cap_excess"
)
READING = Markdown(
    "Every row is a solver of one program, so that other models such as joints alone have no row here. "
    "*True*: errors of the check runs without the noise of their readings.\n\n"
    "Numbers are medians over seeds, the 5th to 95th percentile behind them. (a) runs through its whole "
    "budget: no threshold stops it. All solutions are certified by the same proof, the dual of the conic "
    "program: its lower bound of F_M holds for every conservative model whose blocks have at most the traces "
    "in report.json. That of (d) is above it by what its trace weight costs at most; what its solver leaves "
    "is the duality gap. Times are wall times of whole calls, the reduction of the dataset included; that of "
    "(d) is the median of several calls and includes the certificate, that of (a) and the others does not. A "
    "local solve is elsewhere when it ends more than 10^-5 above (d). (b') takes its differences at all "
    "points at once, which is kinder than one call after the other."
)
OF_MINIMA = Markdown(
    "Order m = 6: at a point where nothing goes down to second order every block is optimal for the convex "
    "problem too (Journee, Bach, Absil, Sepulchre 2010), so a local solve ends nowhere else; what is left "
    "above 10^-6 gains too little a step to go on. Below 6 the rank is capped, and local minima are real. "
    "The last column is what the cap costs: best found over the conic optimum.\n\n"
    "![gap against time](solver_comparison.png)"
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every solver; ways down of the first seed."""
    ran, own = trials.pick(trials["key"] != ""), trials.pick(np.isfinite(trials["data.microseconds_f_m"]))
    bound = own["data.model.f_m"] - own["data.model.f_m_excess_bound"]
    data, solvers = merged(own.keep("data."))[0].data, list(_solvers(asked, ran))
    f = Row(
        seed=list(seeds),
        arm=ARM,
        model=asked.model,
        m=asked.m,
        noise=asked.scenario.noise,
        truth=asked.scenario.truth,
        dataset=data.measured,
        solvers=solvers,
        models=[Row(data.model, paper=None)],
        floor_out_of_reach=int((bound > own["data.model.f_m_floor"]).sum()),
        microseconds_f_m=data.microseconds_f_m,
        convergence=Row(seed=seeds[0], points=_ways(ran.where(seed=seeds[0]))),
        runs=[_end(one) for _, one in ran.groups("seed", "key")],
        local_minima={f"m={m}": _minima(m, trials.where(**{"minima.m": m})) for m in ORDERS},
    )
    rows = {row.key: row for row in solvers}
    f |= _beside_paper(ran, rows, middle(data.microseconds_f_m))
    tables = {
        "short": Table(columns(SHORT), solvers, bold="d", headline="seconds_to_1_percent", looks=LOOKS),
        "solvers": Table(columns(SOLVERS), solvers),
        "minima": Table(columns(MINIMA), list(f.local_minima.values())),
    }
    return Report(
        scenario="solver_comparison",
        question=say("{arm}, {model}: which solver finds the best model, and how fast?", f),
        title=say(
            "{arm}: {dataset.runs} runs in {dataset.poses} poses identify {model} by Eq. (19), m = {m}; "
            "{seeds}",
            f,
            seeds=f"{len(seeds)} seeds" if len(seeds) > 1 else f"seed {seeds[0]}",
        ),
        answer=lines(_answer(f, rows)),
        worst=_worst(list(f.local_minima.values())),
        claims=list(_claims(f, rows)),
        numbers=f,
        tables=tables,
        body=["solvers", READING, "minima", OF_MINIMA],
    )


def _names(asked: Settings) -> dict[str, str]:
    """Words for every solver."""
    return {
        "a": f"genetic algorithm of up to {asked.generations} generations, then global search (the paper)",
        "a'": f"the same with {asked.short_generations} generations",
        "b": "one local solve over b, analytic gradient",
        "b'": "one local solve over b, finite differences",
        "c": f"{asked.starts} local solves over b",
        "d": "conic program with certificate",
        "e": "conic program in cvxpy, by SCS",
    }


def _solvers(asked: Settings, ran: Trials) -> Iterator[Row]:
    """A row a solver; a time to 1 % is of those seeds in which it came there."""
    names = _names(asked)
    for (key,), own in ran.groups("key"):
        [row] = merged(own.keep("solver.").drop("solver.way_seconds", "solver.way_gap"))
        there = own.pick(np.isfinite(own["solver.seconds_to_1_percent"]))
        for name in ("seconds_to_1_percent", "ratio_to_conic"):
            row.solver[name] = number(there[f"solver.{name}"]) if len(there) else None
        for name in ("local_solves", "local_solves_elsewhere"):
            total = own[f"solver.{name}"].sum()
            row.solver[name] = int(total) if np.isfinite(total) else None
        yield Row(row.solver, key=key, solver=f"({key}) {names[key]}", within_1_percent=len(there))


def _ways(first: Trials) -> dict[str, list[tuple[float, float]]]:
    """Seconds and gap over the certified lower bound at every improvement, by solver."""
    ways = zip(first["key"], first["solver.way_seconds"], first["solver.way_gap"], strict=True)
    return {key: list(zip(seconds, gap, strict=True)) for key, seconds, gap in ways}


def _end(one: Trials) -> Row:
    """Where a solver ended in one seed."""
    found = {name.removeprefix("solver."): cells[0] for name, cells in one.columns.items()}
    kept = ("seed", "key", "f_m", "seconds", "seconds_to_1_percent")
    return Row({name: found[name] for name in kept}, gap_to_bound=found["way_gap"][-1])


def _minima(m: int, own: Trials) -> Row:
    """Excess of local solves over the least F_M of their order: of m = 6 the conic one, else the best."""
    ends, conic = np.array(own["minima.f_m"].tolist()), own["minima.conic_f_m"]
    best = conic if m == LARGEST_ORDER else ends.min(axis=1)
    excess = np.sort((ends / best[:, None] - 1).ravel())
    cap = ends.min(axis=1) / conic - 1
    return Row(
        m=m,
        reference="conic optimum" if m == LARGEST_ORDER else "best found of this order",
        seeds=own["seed"].tolist(),
        starts=ends.size,
        within_1e_6_percent=100 * np.mean(excess <= SHARP),
        within_1e_5_percent=100 * np.mean(excess <= CLOSE),
        worst_excess=excess[-1],
        median_excess=np.median(excess),
        excess=excess.tolist(),
        best_over_conic=cap.tolist(),
        cap_excess=number(cap),
        unfinished=int(own["minima.unfinished"].sum()),
    )


def _beside_paper(ran: Trials, rows: Mapping[str, Row], microseconds: float) -> Row:
    """The conic program beside the paper's optimiser and all others."""
    f_m = {key: ran.where(key=key)["solver.f_m"] for key in rows}
    a, d = ran.where(key="a"), ran.where(key="d")
    over = {key: float((f_m["d"] / own - 1).max()) for key, own in f_m.items()}
    ratios = a["solver.ratio_to_conic"]
    seconds = middle(rows["a"].evaluations) * microseconds / UM
    counted = [row for key, row in rows.items() if key in ("a", "a'", "b", "c")]
    return Row(
        conic_never_above_paper=over["a"] <= NEVER_ABOVE,
        largest_relative_excess_of_d_over_a=over["a"],
        largest_relative_excess_of_d_over_any=max(over.values()),
        met_up_to_the_certified_bound=bool((f_m["d"] - f_m["a"] - d["solver.f_m_excess_bound"] <= 0).all()),
        least_ratio=float(np.nanmin(ratios)) if np.isfinite(ratios).any() else None,
        seconds_of_f_m_alone=seconds,
        f_m_alone_ratio=seconds / middle(rows["d"].seconds),
        elsewhere=sum(row.local_solves_elsewhere or 0 for row in counted),
        local_solves=sum(row.local_solves or 0 for row in counted),
    )


def times(row: Row) -> str:
    """Time to come within 1 %, as a multiple of the conic program's whole time."""
    return "never" if row.ratio_to_conic is None else f"{ratio(middle(row.ratio_to_conic))} times"


def _answer(f: Row, rows: Mapping[str, Row]) -> Iterator[str]:
    """Who ends lower, and how long it takes; what is proven."""
    a, d = rows["a"], rows["d"]
    yield say(
        "The conic program (d) {how} above the paper's optimiser (a) and takes {ms:.3g} ms; {paper}.",
        how="never ends" if f.conic_never_above_paper else "sometimes ends",
        ms=1000 * middle(d.seconds),
        paper="(a) never comes within 1 %"
        if a.ratio_to_conic is None
        else f"to within 1 % (a) takes {times(a)} as long",
    )
    yield say(
        "It solves its program to a duality gap of {duality_gap:~.0e} and proves F_M to {percent:.2g} %.",
        f.models[0],
        percent=100 * middle(d.relative_excess_bound),
    )


def _worst(minima: list[Row]) -> Markdown:
    """The local solve that ends highest."""
    row = max(minima, key=lambda own: own.worst_excess)
    return say(
        "Worst of local solves from random starts: of order m = {m} one ends {percent:.2g} % above the "
        "{reference}.",
        row,
        percent=100 * row.worst_excess,
    )


def _claims(f: Row, rows: Mapping[str, Row]) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    over, seeds = f.largest_relative_excess_of_d_over_any, counted(len(f.seed), "seed")
    if over <= NEVER_ABOVE:
        yield say("In {seeds} (d) ends below every other solver, or within rounding of it.", seeds=seeds)
    else:
        yield say(
            "In {seeds} (d) ends above another solver by up to {over:.0e} of F_M.", seeds=seeds, over=over
        )
    b = rows["b"]
    yield say(
        "Where (d) wins by little: to 1 % a short genetic algorithm (a') takes {short}, one local solve (b) "
        "{local} as long. To its end (b) takes {whole:.3g} times the time of (d), and does not know how near "
        "it is.",
        short=times(rows["a'"]),
        local=times(b),
        whole=middle(b.whole_ratio_to_conic),
    )
    yield say(
        "Local minima: {reached} of {local_solves} local solves of (a), (a'), (b) and (c) reach the F_M of "
        "(d) within {close:.0e}.",
        f,
        reached=f.local_solves - f.elsewhere,
        close=CLOSE,
    )
    yield say(
        "The paper would stop at the F_M of noise alone, {floor:.2f}. In {n} of {seeds} it lies below the "
        "certified bound: there no search can stop by itself.",
        floor=middle(f.models[0].f_m_floor),
        n=f.floor_out_of_reach,
        seeds=seeds,
    )
    if f.least_ratio is not None:
        yield say(
            "To come within 1 % (a) takes at least {least_ratio:.0f} times the time of (d). Its evaluations "
            "of F_M alone would take {f_m_alone_ratio:.2g} times that ({seconds_of_f_m_alone:.2g} s); the "
            "rest is scipy's bookkeeping.",
            f,
        )


def figures(found: Report) -> dict[str, Figure]:
    """Gap to the certified lower bound against time, and excess of local solves by order m."""
    f = Row(found.numbers)
    rows = {row.key: row for row in f.solvers}
    answer = (
        f"To within 1 % of the least F_M the paper's optimiser takes {times(rows['a'])} the time of the "
        f"conic program with its proof; one local solve {times(rows['b'])}, without proof"
    )
    return {"solver_comparison.png": solver_comparison(f, answer)}


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(ARM))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.identification, cell.arm, run.folder / "dataset.csv")
