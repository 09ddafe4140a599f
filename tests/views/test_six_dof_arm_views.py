"""What people see of section 5.2 equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, check_words, curves, unit_in
from made_up import around, fill, filled, single

from testbench.bench.baselines import EQUAL_FIT
from testbench.bench.error_places import ErrorPlaces, WorstPlace
from testbench.studies.six_dof_arm.report import (
    Gains,
    ModelReport,
    OrderReport,
    Paired,
    SixDofReport,
    TieBreak,
    TruthReport,
)
from testbench.studies.six_dof_arm.study import STUDY
from testbench.studies.six_dof_arm.summary import best, enough, tie_break, which_m
from testbench.studies.six_dof_arm.trial import Judged, Order, SixDofRow
from testbench.studies.six_dof_arm.verdict import claims
from testbench.trials.gain import gained
from testbench.trials.spread import ends, middle

PAPERS = {"MLS56": "none", "MLS32": "none", "MGCO147": "psd", "MGCO69": "psd", "MGCO56": "psd"}
NAMES = {**PAPERS, "Joints": "none", EQUAL_FIT: "free"}
GAINS = ("least_squares", "joints", "nonlinear", "nonlinear_joints")
CELLS = ("check_p95_mm", "check_max_relative_percent")
MEANS = {
    "model": "name",
    "unknowns": "parameters",
    "seen": "rank",
    "conservative": "conservative",
    "F_M": "f_m",
    "floor": "f_m_floor",
    "95 % check, mm": "check.p95_mm",
    "95 % true, mm": "check_true.p95_mm",
    "RMS check, mm": "check.rms_mm",
    "RMS true, mm": "check_true.rms_mm",
    "95 % check, %": "check.p95_relative_percent",
    "max check, %": "check.max_relative_percent",
    "max true, %": "check_true.max_relative_percent",
}
LESS = {"times less than LS": "times_less"}
SHORT = ("model", "conservative", "95 % check, mm", "95 % true, mm", "max check, %")
KNOWN = {"95 % check, mm": "paper.check_p95_mm", "max check, %": "paper.check_max_relative_percent"}
ORDERS = {
    "m": "m",
    "F_M": "f_m",
    "F_M over optimum": "f_m_over_optimum",
    "largest rank": "rank",
    "smallest scaled eigenvalue": "min_scaled_eigenvalue",
    "95 % true, mm": "check_true.p95_mm",
}
TIES = {
    "truth": "truth",
    "seeds": "seeds",
    "directions free": "free",
    "conservative solution of MLS56's fit": "conservative",
    "F_M of MGCO56 no higher": "fits_as_well",
}


def models(rng, paper):
    cells = {key: float(rng.uniform(11, 99)) for key in CELLS}
    rows = [
        {"name": n, "structure": n, "constraint": c, "prior": False, "conservative": c == "psd"}
        | {"paper": cells if paper and n in PAPERS else None}
        for n, c in NAMES.items()
    ]
    return filled(ModelReport, rng, rows)


def orders(rng):
    return [fill(Order, rng, m=m) for m in range(1, 7)]


def judged(report):
    """The same with the verdicts that follow from its numbers."""
    by_name = {m.name: m for m in report.models}
    least = [enough(name, getattr(report.order, name)) for name in ("MGCO69", "MGCO56")]
    said = claims(by_name, report.nonlinear.models, report.paired, report.ties[0])
    return replace(report, best=best(report.models), claims=said, enough=least, which_m=which_m(least))


@pytest.fixture
def report(rng):
    made = fill(
        SixDofReport,
        rng,
        seed=[4, 5, 6],
        models=models(rng, True),
        nonlinear=fill(TruthReport, rng, models=models(rng, False)),
        order=fill(OrderReport, rng, MGCO69=orders(rng), MGCO56=orders(rng)),
        paired=fill(Paired, rng, seeds=20, mgco56_best=20),
        ties=[fill(TieBreak, rng, truth=truth) for truth in ("linear", "nonlinear")],
        claims=[],
        enough=[],
        gains=fill(Gains, rng, **{name: gained("MGCO56", "MLS32", [2.0], [3.0]) for name in GAINS}),
        map=fill(
            ErrorPlaces,
            rng,
            worst={"MGCO56": WorstPlace(1, (1.2, -0.35, 2.0), "joint_1 10.0 deg", 0.75)},
            error_mm={"MLS32": (4.0, 5.0)},
        ),
    )
    return judged(made)


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else judged(single(report))
    tables = STUDY.tables(report)
    short = {title: MEANS[title] for title in SHORT}
    check_table(tables["linear"], report.models, MEANS | LESS, KNOWN)
    check_table(tables["nonlinear"], report.nonlinear.models, MEANS)
    check_table(tables["short"], report.models, short | LESS, KNOWN)
    check_table(tables["short_nonlinear"], report.nonlinear.models, short)
    check_table(tables["ties"], report.ties, TIES)
    check_table(tables["MGCO69"], report.order.MGCO69, ORDERS)
    check_table(tables["MGCO56"], report.order.MGCO56, ORDERS)
    check_report(STUDY, report)
    check_words(STUDY.words(report))


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_answer_is_the_gain_over_least_squares_and_joints_with_both_numbers(report, factor):
    """Three seeds, in each of which the ratio is the same."""
    ours, joints = [2.0, 3.0, 4.0], [20.0, 30.0, 50.0]
    own = gained("MGCO56", "MLS32", ours, [factor * x for x in ours])
    made = replace(
        report,
        gains=replace(report.gains, least_squares=own, joints=gained("MGCO56", "Joints", ours, joints)),
    )
    said = {0.5: "2.0 times as much", 1.0: "alike", 2.0: "2.0 times less"}[factor]
    assert STUDY.words(made).block("answer") == (
        f"True error of 95 % in the check runs: MGCO56 3.000 mm, least squares {3 * factor:.3f} mm; {said}. "
        "Joints alone 30.000 mm, 10 times as much (10 to 12 in 3 trials)."
    )


def test_models_within_five_per_cent_of_the_least_are_alike(report):
    errors = {"MLS32": 2.0, "MGCO69": 2.09, "MLS56": 2.2}
    ours = [
        replace(m, check_true=replace(m.check_true, p95_mm=around(errors[m.name]))) if m.name in errors else m
        for m in report.models
    ]
    text = STUDY.words(judged(replace(report, models=ours))).block("more")
    assert "MLS32 and MGCO69 err alike, less than the rest." in text


def test_a_cell_of_the_paper_is_confirmed_inside_our_spread_and_only_there(report):
    for factor, verdict in ((1.8, "confirmed"), (2.0, "not confirmed"), (0.5, "not confirmed")):
        ours = [replace(m, check=scaled_to(m, factor)) if m.paper else m for m in report.models]
        found = [c for c in judged(replace(report, models=ours)).claims if c.claim.endswith("mm, 95 %")]
        assert len(found) == 5
        assert {c.verdict for c in found} == {verdict}
        assert all(f"{factor:.2f} times the paper's" in c.why for c in found)


def scaled_to(model, factor):
    """Errors of so many times the paper's, 0.53 to 1.71 of that over the seeds."""
    return replace(model.check, p95_mm=around(factor * model.paper["check_p95_mm"]))


@pytest.mark.parametrize(
    ("claim", "count"),
    [
        ("MGCO56 is the best model", "mgco56_best"),
        ("MGCO56 and MLS32 are nearly the same", "mgco56_near_mls32"),
        ("MLS56 does worse than MLS32", "mls32_better_than_mls56"),
        ("a linear model is enough (the paper's truth is linear)", "linear_is_enough"),
    ],
)
def test_a_comparison_is_confirmed_from_19_of_20_seeds_on(report, claim, count):
    for held, verdict in ((19, "confirmed"), (18, "not confirmed")):
        made = judged(replace(report, paired=replace(report.paired, **{count: held})))
        [own] = [c for c in made.claims if c.claim == claim]
        assert own.verdict == verdict
        assert f" in {held} of 20 seeds; " in own.why


def test_a_tie_break_counts_equal_fits_and_conservative_ones_apart(rng):
    def seed(fit, equal_is_conservative):
        made = [("MLS56", 2.0, False), (EQUAL_FIT, 2.0, equal_is_conservative), ("MGCO56", fit, True)]
        fixed = [{"name": n, "f_m": f, "conservative": c, "parameters": 56, "rank": 32} for n, f, c in made]
        models = [fill(Judged, rng, **own) for own in fixed]
        return [fill(SixDofRow, rng, truth="linear", model=own, order=None) for own in models]

    seeds = [seed(2.0, True), seed(2.0 * (1 + 9e-8), True), seed(2.0 * (1 + 2e-7), True), seed(2.1, False)]
    found = tie_break(list(enumerate(seeds)), "linear")
    assert (found.free, found.seeds, found.conservative, found.fits_as_well) == (24, 4, 3, 2)


def test_words_count_the_seeds_of_the_tie_break_and_of_the_incumbent(report):
    text = STUDY.words(report).block("more")
    for tie in report.ties:
        said = f"With {tie.truth} truth another solution with the very fit of MLS56 is conservative in "
        said += f"{tie.conservative} of {tie.seeds} seeds, and F_M of MGCO56 is no higher than that of MLS56"
        assert f"{said} in {tie.fits_as_well}" in text
    assert f"better than joints alone in {report.paired.mgco56_better_than_joints} of 20 seeds" in text


def test_exchanged_methods_are_not_conservative_as_the_paper_says(report):
    assert report.claims[0].verdict == "confirmed"
    ours = [replace(m, conservative=m.constraint == "none") for m in report.models]
    assert judged(replace(report, models=ours)).claims[0].verdict == "not confirmed"


def test_the_order_that_is_enough_stands_with_its_numbers(report):
    for own in report.enough:
        assert f"{own.model} from m = {own.m} on" in report.which_m
        for row in own.rows:
            words = f"m = {row.m}: F_M {middle(row.f_m):.4g}, 95 % {middle(row.check_true.p95_mm):.3f} mm"
            assert words in report.which_m
    assert report.which_m in STUDY.words(report).whole()


def test_the_figure_draws_the_reports_numbers(report):
    left, centre, right = STUDY.figures["six_dof_arm.png"](report).axes
    for axes, rows in ((left, report.models), (centre, report.nonlinear.models)):
        assert unit_in(axes.get_xlabel()) == "mm"
        names = [label.get_text().rpartition("  ")[0] for label in axes.get_yticklabels()]
        assert names == (list(NAMES) if axes is left else [""] * len(NAMES))
        [bars] = [x for x in axes.get_lines() if x.get_marker() == "|"]
        assert list(bars.get_xdata()) == [middle(row.check.p95_mm) for row in rows]
        drawn = [line.get_xdata(orig=True) for line in axes.get_lines()]
        for row in rows:
            value = row.check_true.p95_mm
            assert any(np.size(x) == 2 and tuple(x) == ends(value) for x in drawn)
            assert any(np.size(x) == 1 and np.ravel(x)[0] == middle(value) for x in drawn)
        [papers] = [x for x in axes.get_lines() if x.get_marker() == "D" and x.get_markersize() == 5]
        assert len(papers.get_xdata()) == (len(PAPERS) if rows is report.models else 0)
    assert unit_in(right.get_ylabel()) == "mm"
    for name in ("MGCO69", "MGCO56"):
        rows = getattr(report.order, name)
        x, y = curves(right)[name]
        assert x.tolist() == [row.m for row in rows]
        assert y.tolist() == [middle(row.check_true.p95_mm) for row in rows]
    texts = {text.get_text() for text in right.texts}
    assert {f"{middle(r.f_m):.3g}" for r in (*report.order.MGCO69, *report.order.MGCO56)} <= texts
