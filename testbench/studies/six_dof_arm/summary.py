"""Tables I and II over all seeds and both truths, the order m, and the paper's statements judged."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from testbench.bench.baselines import EQUAL_FIT, JOINTS
from testbench.bench.campaign import Truth
from testbench.bench.error_places import ErrorPlaces, error_places
from testbench.identify.factorised import LARGEST_ORDER
from testbench.studies.paper import RULE, SECTION_5_2
from testbench.studies.six_dof_arm.report import (
    Enough,
    Gains,
    ModelReport,
    OrderReport,
    Paired,
    SixDofReport,
    TieBreak,
    TruthReport,
)
from testbench.studies.six_dof_arm.trial import (
    CLOSE,
    MODELS,
    NAME,
    TRUTHS,
    Judged,
    Order,
    Settings,
    SixDofRow,
)
from testbench.studies.six_dof_arm.verdict import claims
from testbench.studies.study import Rows
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import grouped, merge, middle, wins
from testbench.views.schema import best_of

SAME = 1.02  #: An order m serves as well as 6 where F_M and the check error exceed those of m = 6 by less.
EQUAL = 1e-7  #: Share of F_M by which GCO may exceed least squares and still fit as well.


Everything = Sequence[tuple[int, Sequence[SixDofRow]]]


def summary(asked: Settings, seeds: range, trials: Rows[SixDofRow]) -> SixDofReport:
    """Medians and spreads of every model and order; with one seed its numbers."""
    every = [(seed, list(rows)) for seed, rows in trials]
    linear, nonlinear = (_truth(every, truth) for truth in TRUTHS)
    least_squares, gco = compared(linear.models)
    order, paired = _order(every), _paired(every)
    least = [enough(name, rows) for name, rows in (("MGCO69", order.MGCO69), ("MGCO56", order.MGCO56))]
    models = {m.name: m for m in linear.models}
    ties = [tie_break(every, truth) for truth in TRUTHS]
    return SixDofReport(
        scenario=NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=asked.scenario.arm,
        noise=asked.scenario.noise,
        noise_per=asked.per,
        truth="linear",
        dataset=linear.dataset,
        models=beside(linear.models, every, least_squares),
        nonlinear=nonlinear,
        order=order,
        paired=paired,
        ties=ties,
        enough=least,
        which_m=which_m(least),
        best=best(linear.models),
        gains=gains(every, gco, least_squares),
        claims=claims(models, nonlinear.models, paired, ties[0]),
        rule=RULE,
        map=error_map(every, (least_squares, gco)),
    )


def best(models: Sequence[ModelReport]) -> tuple[str, ...]:
    """The models of least error; not the completed one, whose fit and predictions are those of MLS56."""
    return best_of({m.name: m.check_true.p95_mm for m in models if m.name != EQUAL_FIT}, CLOSE).names


def compared(models: Sequence[ModelReport]) -> list[str]:
    """The best of least squares and of GCO, the completed one and joints alone left out."""
    names = {
        constraint: best([m for m in models if m.constraint == constraint and m.structure != JOINTS])
        for constraint in ("none", "psd")
    }
    return [own[0] for own in names.values() if own]


def error_map(every: Everything, names: Sequence[str]) -> ErrorPlaces:
    """Errors of the first seed run by run, ordered by those models that are compared."""
    rows = [row for _, own in every for row in own if row.places and row.place_mm]
    [at, *_] = [row.places for row in rows if row.places]
    return error_places(at, {row.model.name: row.place_mm for row in rows if row.place_mm}, names)


def _errors(every: Everything, truth: Truth, name: str) -> list[float]:
    """95 % errors of a model in the check runs without noise, seed by seed [mm]."""
    return [middle(models[name].check_true.p95_mm) for models in _by_seed(every, truth)]


def beside(models: Sequence[ModelReport], every: Everything, least_squares: str) -> list[ModelReport]:
    """The models, each beside the best of least squares."""
    theirs = _errors(every, "linear", least_squares)
    ours = {m.name: _errors(every, "linear", m.name) for m in models if m.name != least_squares}
    return [
        replace(m, times_less=gained(m.name, least_squares, ours[m.name], theirs).times)
        if m.name in ours
        else m
        for m in models
    ]


def gains(every: Everything, gco: str, least_squares: str) -> Gains:
    """The best of GCO beside the best of least squares and joints alone, with both truths."""

    def gain(truth: Truth, theirs: str) -> Gain:
        return gained(gco, theirs, _errors(every, truth, gco), _errors(every, truth, theirs))

    return Gains(
        *(gain("linear", name) for name in (least_squares, JOINTS)),
        *(gain("nonlinear", name) for name in (least_squares, JOINTS)),
    )


def _truth(every: Everything, truth: Truth) -> TruthReport:
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


def _by_seed(every: Everything, truth: Truth) -> list[dict[str, Judged]]:
    """The models of every seed by name, without those of an order m."""
    return [
        {row.model.name: row.model for row in rows if row.truth == truth and row.order is None}
        for _, rows in every
    ]


def _paired(every: Everything) -> Paired:
    plain, errors = _by_seed(every, "linear"), partial(_errors, every, "linear")
    ours, mls32, joints = (errors(name) for name in ("MGCO56", "MLS32", JOINTS))
    bent = _errors(every, "nonlinear", "MGCO56")
    others = [errors(name) for name in MODELS if name != "MGCO56"]
    ratio = [a / b for a, b in zip(ours, mls32, strict=True)]
    return Paired(
        seeds=len(plain),
        mgco56_best=wins(ours, [min(seed) for seed in zip(*others, strict=True)]),
        mgco56_better_than_mls32=wins(ours, mls32),
        mgco56_near_mls32=sum(abs(r - 1) <= CLOSE for r in ratio),
        mls32_better_than_mls56=wins(mls32, errors("MLS56")),
        mgco56_better_than_joints=wins(ours, joints),
        linear_is_enough=sum(a <= (1 + CLOSE) * b for a, b in zip(bent, ours, strict=True)),
        mgco56_over_mls32_p95_check_true=merge(ratio),
        joints_over_mgco56_p95_check_true=merge([b / a for a, b in zip(ours, joints, strict=True)]),
    )


def tie_break(every: Everything, truth: Truth) -> TieBreak:
    """Where MLS56 is not conservative for want of another choice among equal fits alone."""
    models = _by_seed(every, truth)
    first = models[0]["MLS56"]
    return TieBreak(
        truth=truth,
        seeds=len(models),
        free=first.parameters - round(middle(first.rank)),
        conservative=sum(m[EQUAL_FIT].conservative is True for m in models),
        fits_as_well=sum(middle(m["MGCO56"].f_m) <= (1 + EQUAL) * middle(m["MLS56"].f_m) for m in models),
    )


def enough(name: str, rows: Sequence[Order]) -> Enough:
    """The least order m that costs less than `SAME` in F_M and check error."""
    f_m, p95 = middle(rows[-1].f_m), middle(rows[-1].check_true.p95_mm)
    m = next(r.m for r in rows if middle(r.f_m) <= SAME * f_m and middle(r.check_true.p95_mm) <= SAME * p95)
    return Enough(name, m, [row for row in rows if row.m in (m - 1, m, rows[-1].m)])


def which_m(found: Sequence[Enough]) -> str:
    """The answer to "which m" with its numbers."""
    parts = [
        f"{own.model} from m = {own.m} on ("
        + "; ".join(
            f"m = {r.m}: F_M {middle(r.f_m):.4g}, 95 % {middle(r.check_true.p95_mm):.3f} mm" for r in own.rows
        )
        + ")"
        for own in found
    ]
    return (
        "Which m? m = 6, the size of a compliance: from there on no local minimum is worse than the global "
        f"one. F_M and check error are already as good as with m = 6 for {', for '.join(parts)}."
    )
