"""What people see of section 5.2 equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, curves, unit_in
from made_up import around, fill, filled, single

from testbench.studies.six_dof_arm.study import STUDY
from testbench.studies.six_dof_arm.summary import (
    ModelReport,
    OrderReport,
    Paired,
    SixDofReport,
    TruthReport,
    claims,
    enough,
    which_m,
)
from testbench.studies.six_dof_arm.trial import Order
from testbench.trials.spread import ends, middle
from testbench.views.schema import best_of

NAMES = {"MLS56": "none", "MLS32": "none", "MGCO147": "psd", "MGCO69": "psd", "MGCO56": "psd"}
CELLS = ("readings_p95_mm", "readings_max_relative_percent")
MEANS = {
    "model": "name",
    "unknowns": "parameters",
    "seen": "rank",
    "conservative": "conservative",
    "F_M": "f_m",
    "floor": "f_m_floor",
    "95 % readings, mm": "readings.p95_mm",
    "RMS readings, mm": "readings.rms_mm",
    "95 % readings, %": "readings.p95_relative_percent",
    "max readings, %": "readings.max_relative_percent",
    "95 % truth, mm": "check.p95_mm",
    "RMS truth, mm": "check.rms_mm",
    "max truth, %": "check.max_relative_percent",
}
SHORT = ("model", "unknowns", "conservative", "95 % readings, mm", "max readings, %", "95 % truth, mm")
KNOWN = {
    "95 % readings, mm": "paper.readings_p95_mm",
    "max readings, %": "paper.readings_max_relative_percent",
}
ORDERS = {
    "m": "m",
    "F_M": "f_m",
    "F_M over optimum": "f_m_over_optimum",
    "largest rank": "rank",
    "smallest scaled eigenvalue": "min_scaled_eigenvalue",
    "95 % check, mm": "check.p95_mm",
}


def models(rng, paper):
    rows = [
        {"name": n, "structure": n, "constraint": c, "prior": False, "conservative": c == "psd"}
        for n, c in NAMES.items()
    ]
    cells = {key: float(rng.uniform(11, 99)) for key in CELLS}
    return filled(ModelReport, rng, rows, paper=cells if paper else None)


def orders(rng):
    return [fill(Order, rng, m=m) for m in range(1, 7)]


def judged(report):
    """The same with the verdicts that follow from its numbers."""
    best = best_of({m.name: m.check.p95_mm for m in report.models}, 0.05).names
    by_name = {m.name: m for m in report.models}
    least = [enough(name, getattr(report.order, name)) for name in ("MGCO69", "MGCO56")]
    said = claims(by_name, report.nonlinear.models, report.paired, best)
    return replace(report, best=best, claims=said, enough=least, which_m=which_m(least))


@pytest.fixture
def report(rng):
    made = fill(
        SixDofReport,
        rng,
        seed=[4, 5, 6],
        models=models(rng, True),
        nonlinear=fill(TruthReport, rng, models=models(rng, False)),
        order=fill(OrderReport, rng, MGCO69=orders(rng), MGCO56=orders(rng)),
        paired=fill(Paired, rng),
        claims=[],
        enough=[],
    )
    return judged(made)


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else judged(single(report))
    tables = STUDY.tables(report)
    short = {title: MEANS[title] for title in SHORT}
    check_table(tables["linear"], report.models, MEANS, KNOWN)
    check_table(tables["nonlinear"], report.nonlinear.models, MEANS)
    check_table(tables["short"], report.models, short, KNOWN)
    check_table(tables["short_nonlinear"], report.nonlinear.models, short)
    check_table(tables["MGCO69"], report.order.MGCO69, ORDERS)
    check_table(tables["MGCO56"], report.order.MGCO56, ORDERS)
    check_report(STUDY, report)


@pytest.mark.parametrize("winner", NAMES)
def test_the_answer_names_the_best_and_its_numbers_whichever_it_is(report, winner):
    least = replace(report.models[0].check, p95_mm=around(2.0))
    ours = [replace(m, check=least) if m.name == winner else m for m in report.models]
    made = judged(replace(report, models=ours))
    text = STUDY.words(made).block("answer")
    [first] = [m for m in made.models if m.name == winner]
    assert text.startswith(f"{winner} predicts best: 95 % of its errors stay below 2.000 (1.060 to 3.420) mm")
    assert f"below {middle(first.readings.p95_mm):.3f} (" in text
    [claim] = [c for c in made.claims if c.claim == "MGCO56 is the best model"]
    assert claim.verdict == ("confirmed" if winner == "MGCO56" else "not confirmed")
    assert claim.why.endswith(f": {winner}")


def test_models_within_five_per_cent_of_the_least_are_alike(report):
    errors = {"MLS32": 2.0, "MGCO69": 2.09, "MLS56": 2.2}
    ours = [
        replace(m, check=replace(m.check, p95_mm=around(errors[m.name]))) if m.name in errors else m
        for m in report.models
    ]
    text = STUDY.words(judged(replace(report, models=ours))).block("answer")
    assert text.startswith("MLS32 and MGCO69 predict alike, better than the rest: 95 % of their errors")


def test_a_cell_of_the_paper_is_confirmed_within_its_factor_and_only_there(report):
    for factor, verdict in ((1.4, "confirmed"), (1.6, "not confirmed"), (0.6, "not confirmed")):
        ours = [replace(m, readings=scaled_to(m, factor)) for m in report.models]
        found = [c for c in judged(replace(report, models=ours)).claims if c.claim.endswith("mm, 95 %")]
        assert len(found) == 5
        assert {c.verdict for c in found} == {verdict}
        assert all(f"{factor:.2f} times the paper's" in c.why for c in found)


def scaled_to(model, factor):
    return replace(model.readings, p95_mm=factor * model.paper["readings_p95_mm"])


def test_exchanged_methods_are_not_conservative_as_the_paper_says(report):
    assert report.claims[0].verdict == "confirmed"
    ours = [replace(m, conservative=m.constraint == "none") for m in report.models]
    assert judged(replace(report, models=ours)).claims[0].verdict == "not confirmed"


def test_the_order_that_is_enough_stands_with_its_numbers(report):
    for own in report.enough:
        assert f"{own.model} from m = {own.m} on" in report.which_m
        for row in own.rows:
            words = f"m = {row.m}: F_M {middle(row.f_m):.4g}, 95 % {middle(row.check.p95_mm):.3f} mm"
            assert words in report.which_m
    assert report.which_m in STUDY.words(report).whole()


def test_the_figure_draws_the_reports_numbers(report):
    left, centre, right = STUDY.figures["six_dof_arm.png"](report).axes
    for axes, rows in ((left, report.models), (centre, report.nonlinear.models)):
        assert unit_in(axes.get_xlabel()) == "mm"
        names = [label.get_text().split()[0] for label in axes.get_yticklabels()]
        assert names == list(NAMES)
        drawn = [line.get_xdata(orig=True) for line in axes.get_lines()]
        for row in rows:
            value = row.readings.p95_mm
            assert any(np.size(x) == 2 and tuple(x) == ends(value) for x in drawn)
            assert any(np.size(x) == 1 and np.ravel(x)[0] == middle(value) for x in drawn)
        papers = [
            line for line in axes.get_lines() if line.get_marker() == "D" and line.get_markersize() == 5
        ]
        assert len(papers) == (len(rows) if rows is report.models else 0)
    assert unit_in(right.get_ylabel()) == "mm"
    for name in ("MGCO69", "MGCO56"):
        rows = getattr(report.order, name)
        x, y = curves(right)[f"{name}, F_M at each point"]
        assert x.tolist() == [row.m for row in rows]
        assert y.tolist() == [middle(row.check.p95_mm) for row in rows]
    texts = {text.get_text() for text in right.texts}
    assert {f"{middle(r.f_m):.3g}" for r in (*report.order.MGCO69, *report.order.MGCO56)} <= texts
