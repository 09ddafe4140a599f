"""Tables I and II over all seeds and both truths, the order m, and the paper's statements judged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from testbench.bench.campaign import Truth
from testbench.identify.factorised import LARGEST_ORDER
from testbench.studies.paper import CLAIMS, SECTION_5_2, Claim, judged
from testbench.studies.six_dof_arm.trial import NAME, Judged, Measured, Order, Settings, SixDofRow
from testbench.studies.study import Trials
from testbench.trials.spread import Number, Spread, grouped, merge, middle, wins
from testbench.views.schema import Column, Table, best_of, show, show_truth

SAME = 1.02  #: An order m serves as well as 6 where F_M and the check error exceed those of m = 6 by less.
FACTOR = 1.5  #: Two errors agree within this factor.
CLOSE = 0.05  #: Share by which the error of a model may exceed the least and still count as best.
TWINS = 1e-6  #: Relative difference of errors below which two models predict alike.


@dataclass(frozen=True)
class ModelReport(Judged):
    """A model over all seeds, and the paper's known numbers for it."""

    paper: Mapping[str, float] | None = None


@dataclass(frozen=True)
class TruthReport:
    """What was measured of one kind of truth, and what was found."""

    dataset: Measured
    models: list[ModelReport]


@dataclass(frozen=True)
class OrderReport:
    """Every order m of two models, and the seeds that they were studied in."""

    seeds: list[int]
    MGCO69: list[Order]
    MGCO56: list[Order]


@dataclass(frozen=True)
class Paired:
    """On the same data: MGCO56 against MLS32."""

    seeds: int
    mgco56_better_than_mls32: int
    mgco56_over_mls32_p95_check: Number
    mgco56_over_mls32_p95_readings: Number


@dataclass(frozen=True)
class Enough:
    """The least order m that serves as well as the largest one."""

    model: str  #: Name of the model.
    m: int  #: The order.
    rows: list[Order]  #: The order before it, itself and the largest one.


@dataclass(frozen=True)
class SixDofReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    noise: bool
    noise_per: str
    truth: Truth
    dataset: Measured
    models: list[ModelReport]
    nonlinear: TruthReport
    order: OrderReport
    paired: Paired
    enough: list[Enough]
    which_m: str
    best: tuple[str, ...]
    claims: list[Claim]


Everything = Sequence[tuple[int, Sequence[SixDofRow]]]


def summary(asked: Settings, seeds: range, trials: Trials[SixDofRow]) -> SixDofReport:
    """Medians and spreads of every model and order; with one seed its numbers."""
    every = [(seed, list(rows)) for seed, rows in trials]
    linear, nonlinear = (_truth(every, truth) for truth in ("linear", "nonlinear"))
    order, paired = _order(every), _paired(every)
    least = [enough(name, rows) for name, rows in (("MGCO69", order.MGCO69), ("MGCO56", order.MGCO56))]
    models = {m.name: m for m in linear.models}
    best = best_of({name: m.check.p95_mm for name, m in models.items()}, CLOSE).names
    return SixDofReport(
        scenario=NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=asked.scenario.arm,
        noise=asked.scenario.noise,
        noise_per=asked.per,
        truth="linear",
        dataset=linear.dataset,
        models=linear.models,
        nonlinear=nonlinear,
        order=order,
        paired=paired,
        enough=least,
        which_m=which_m(least),
        best=best,
        claims=claims(models, nonlinear.models, paired, best),
    )


def _truth(every: Everything, truth: str) -> TruthReport:
    own = [row for _, rows in every for row in rows if row.truth == truth and row.order is None]
    by_name = grouped(own, lambda row: row.model.name)
    models = [
        ModelReport(**vars(merge([row.model for row in rows])), paper=SECTION_5_2.get(name))
        for name, rows in by_name.items()
    ]
    return TruthReport(merge([row.measured for row in next(iter(by_name.values()))]), models)


def _order(every: Everything) -> OrderReport:
    own = [(seed, row) for seed, rows in every for row in rows if row.order is not None]
    found = grouped(own, lambda pair: (pair[1].model.name, pair[1].order.m if pair[1].order else 0))

    def rows(name: str) -> list[Order]:
        orders = [[row.order for _, row in found[name, m] if row.order] for m in range(1, LARGEST_ORDER + 1)]
        return [merge(own) for own in orders]

    return OrderReport(list(dict.fromkeys(seed for seed, _ in own)), rows("MGCO69"), rows("MGCO56"))


def _paired(every: Everything) -> Paired:
    plain = [
        {row.model.name: row.model for row in rows if row.truth == "linear" and row.order is None}
        for _, rows in every
    ]
    check = [middle(m["MGCO56"].check.p95_mm) / middle(m["MLS32"].check.p95_mm) for m in plain]
    readings = [middle(m["MGCO56"].readings.p95_mm) / middle(m["MLS32"].readings.p95_mm) for m in plain]
    return Paired(len(plain), wins(check, [1.0] * len(check)), merge(check), merge(readings))


def enough(name: str, rows: Sequence[Order]) -> Enough:
    """The least order m that costs less than `SAME` in F_M and check error."""
    f_m, p95 = middle(rows[-1].f_m), middle(rows[-1].check.p95_mm)
    m = next(r.m for r in rows if middle(r.f_m) <= SAME * f_m and middle(r.check.p95_mm) <= SAME * p95)
    return Enough(name, m, [row for row in rows if row.m in (m - 1, m, rows[-1].m)])


def which_m(found: Sequence[Enough]) -> str:
    """The answer to "which m" with its numbers."""
    parts = [
        f"{own.model} from m = {own.m} on ("
        + "; ".join(
            f"m = {r.m}: F_M {middle(r.f_m):.4g}, 95 % {middle(r.check.p95_mm):.3f} mm" for r in own.rows
        )
        + ")"
        for own in found
    ]
    return (
        "Which m? m = 6, the size of a compliance: from there on no local minimum is worse than the global "
        f"one. F_M and check error are already as good as with m = 6 for {', for '.join(parts)}."
    )


Models = Mapping[str, ModelReport]


def claims(
    models: Models, nonlinear: Sequence[ModelReport], paired: Paired, best: tuple[str, ...]
) -> list[Claim]:
    """The paper's statements of section 5.2, and what our numbers say of each."""
    bent = next(m for m in nonlinear if m.name == "MGCO56")
    return [
        _conservative(models),
        *(
            _cell(name, column, models[name])
            for name in ("MGCO56", "MLS32", "MLS56", "MGCO69", "MGCO147")
            for column in CELLS
            if column.known(models[name])
        ),
        judged(
            "MGCO56 is the best model",
            best == ("MGCO56",),
            f"least 95 % error against the truth, within {100 * CLOSE:g} %: {', '.join(best)}",
        ),
        _same(paired),
        _redundant(models),
        _linear(bent, models["MGCO56"]),
    ]


def _conservative(models: Models) -> Claim:
    holds = all(m.conservative is (m.constraint == "psd") for m in models.values())
    why = ", ".join(f"{name}: {show_truth(m.conservative)}" for name, m in models.items())
    return judged("only the GCO models are conservative (Table I)", holds, why)


def _cell(name: str, column: Column, model: ModelReport) -> Claim:
    ours, known = column.value(model), (model.paper or {})[column.paper]
    factor = middle(ours) / known
    agrees = 1 / FACTOR <= factor <= FACTOR
    why = f"ours {show(ours, '.3g')}, {factor:.2f} times the paper's"
    if isinstance(ours, Spread) and ours.p05 <= known <= ours.p95:
        why += ", which lies inside our spread over seeds"
    elif agrees:
        why += ", outside our spread over seeds" if isinstance(ours, Spread) else ""
    else:
        why += (
            ": the dimensions of the paper's arm stand in a reference that we do not have, and what "
            f"{name} leaves out or adds weighs differently on ours"
        )
    words = "mm, 95 %" if column.unit == "mm" else "% at most"
    return judged(f"{name}: {known:g} {words}", agrees, why)


def _same(paired: Paired) -> Claim:
    ratio = paired.mgco56_over_mls32_p95_check
    return judged(
        "MGCO56 and MLS32 are nearly the same",
        1 / FACTOR <= middle(ratio) <= FACTOR,
        f"on the same data MGCO56's 95 % error against the truth is {show(ratio)} times that of MLS32; "
        f"it is the better one in {paired.mgco56_better_than_mls32} of {paired.seeds} seeds",
    )


def _redundant(models: Models) -> Claim:
    more, less = models["MLS56"].check.p95_mm, models["MLS32"].check.p95_mm
    alike = abs(middle(more) / middle(less) - 1) < TWINS
    columns = models["MLS56"].parameters - middle(models["MLS56"].rank)
    paper = {name: f"{SECTION_5_2[name]['readings_p95_mm']:.3f}" for name in ("MLS56", "MLS32")}
    why = (
        f"solved by SVD the two predict alike to rounding: {columns:g} redundant columns change nothing. The "
        f"paper's {paper['MLS56']} against {paper['MLS32']} mm is no more than noise makes of one model: "
        f"{show(models['MLS32'].readings.p95_mm)} mm"
        if alike
        else f"ours {show(more)} against {show(less)} mm"
    )
    return judged("MLS56 does worse than MLS32", middle(more) > middle(less) and not alike, why)


def _linear(bent: ModelReport, straight: ModelReport) -> Claim:
    ours, theirs = bent.check.p95_mm, straight.check.p95_mm
    return judged(
        "a linear model is enough (the paper's truth is linear)",
        middle(ours) <= FACTOR * middle(theirs),
        f"with the non-linear truth MGCO56's 95 % error is {show(ours)} mm, with linear truth "
        f"{show(theirs)} mm, both against the truth",
        otherwise="not confirmed on this arm",
    )


CELLS = (
    Column("readings.p95_mm", "95 % readings", "mm", paper="readings_p95_mm", short="95 %\nread.\nmm"),
    Column(
        "readings.max_relative_percent",
        "max readings",
        "%",
        ".2f",
        paper="readings_max_relative_percent",
        short="max\nread.\n%",
    ),
)
"""The cells of Table II that the paper's text gives."""
COLUMNS = (
    Column("name", "model"),
    Column("parameters", "unknowns", form="d", short="un-\nknowns"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes", short="conser-\nvative"),
    Column("f_m", "F_M", form=".3f"),
    Column("f_m_floor", "floor", form=".3f", exact=True),
    CELLS[0],
    Column("readings.rms_mm", "RMS readings", "mm"),
    Column("readings.p95_relative_percent", "95 % readings", "%", ".2f"),
    CELLS[1],
    Column("check.p95_mm", "95 % truth", "mm", short="95 %\ntruth\nmm"),
    Column("check.rms_mm", "RMS truth", "mm"),
    Column("check.max_relative_percent", "max truth", "%", ".2f"),
)
"""Tables I and II; errors against the readings of the check runs, and against the truth."""
SHORT = (
    "name",
    "parameters",
    "conservative",
    "readings.p95_mm",
    "readings.max_relative_percent",
    "check.p95_mm",
)
ORDERS = (
    Column("m", "m", form="d"),
    Column("f_m", "F_M", form=".4g"),
    Column("f_m_over_optimum", "F_M over optimum", form=".5f"),
    Column("rank", "largest rank", form=".0f"),
    Column("min_scaled_eigenvalue", "smallest scaled eigenvalue", form=".1e"),
    Column("check.p95_mm", "95 % check", "mm"),
)


def tables(report: SixDofReport) -> dict[str, Table]:
    """Both truths, the order m, the paper's statements."""
    mark = report.best[0] if len(report.best) == 1 else ""
    short = tuple(c for c in COLUMNS if c.key in ("name", *SHORT))
    bent = [vars(m) | {"paper": None} for m in report.nonlinear.models]
    errors = (COLUMNS[0], *(c for c in COLUMNS if c.unit == "mm"))
    return {
        "linear": Table(COLUMNS, report.models, bold=mark),
        "nonlinear": Table(COLUMNS, bent),
        "short": Table(short, report.models, "linear truth, as in the paper", mark),
        "short_nonlinear": Table(short, bent, "MuJoCo's non-linear truth"),
        "errors": Table(errors, report.models, bold=mark),
        "MGCO69": Table(ORDERS, report.order.MGCO69),
        "MGCO56": Table(ORDERS, report.order.MGCO56),
        "claims": Table(CLAIMS, report.claims),
    }
