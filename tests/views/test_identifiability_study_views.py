"""What people see of the study of identifiability equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import (
    bands,
    check_report,
    check_table,
    check_words,
    curves,
    key_of,
    looks_differ,
    shows,
    tables_of,
    unit_in,
)
from made_up import around, fill, filled, single, spread

from testbench.studies.identifiability import figure
from testbench.studies.identifiability.study import STUDY
from testbench.studies.identifiability.summary import (
    Beaten,
    Choice,
    Coverage,
    IdentifiabilityReport,
    ModelReport,
    Ratio,
    verdict,
)
from testbench.studies.identifiability.verdict import gains
from testbench.trials.spread import ends, middle
from testbench.views.colours import look

KINDS = {
    "Joints": ("Joints", "none", "none", "least squares"),
    "MLS56, PSD of equal fit": ("MLS56", "free", "none", "conservative least squares of equal fit"),
    "MLS56": ("MLS56", "none", "none", "least squares"),
    "MGCO56": ("MGCO56", "psd", "none", "GCO"),
    "MGCO68": ("MGCO68", "psd", "none", "GCO"),
    "MGCO56, least trace": ("MGCO56", "psd", "least trace", "GCO of least trace"),
    "MGCO68, least trace": ("MGCO68", "psd", "least trace", "GCO of least trace"),
    "Joints, LS + prior": ("Joints", "none", "prior", "least squares with prior"),
    "MGCO56, LS + prior": ("MGCO56", "none", "prior", "least squares with prior"),
    "MGCO56, GCO + prior": ("MGCO56", "psd", "prior", "GCO with prior"),
    "MGCO68, LS + prior": ("MGCO68", "none", "prior", "least squares with prior"),
    "MGCO68, GCO + prior": ("MGCO68", "psd", "prior", "GCO with prior"),
    "MGCO68, GCO + log-det": ("MGCO68", "psd", "log-det prior", "GCO with log-det prior"),
}
"""Structure, constraint, filling and the method in words, by the model's name."""
SCALED = ["MGCO56, LS + prior", "MGCO56, GCO + prior", "MGCO68, LS + prior", "MGCO68, GCO + prior"]
OVER_POSES = ["Joints", "MLS56", "MGCO56", "MGCO68", "MGCO56, GCO + prior", "MGCO68, GCO + prior"]
MEANS = {
    "model": "name",
    "unknowns": "parameters",
    "seen": "rank",
    "conservative": "conservative",
    "uncertainty of the prior, %": "uncertainty_percent",
    "RMS check, readings, mm": "check.rms_mm",
    "RMS check, true, mm": "check_true.rms_mm",
    "RMS workspace, mm": "workspace.rms_mm",
    "max workspace, mm": "workspace.max_mm",
}
SHORT = {
    "model": "name",
    "conservative": "linear.conservative",
    "RMS workspace, mm": "linear.workspace.rms_mm",
    "non-linear truth, mm": "nonlinear.workspace.rms_mm",
}
DUELS = {
    "model": "ours",
    "against": "theirs",
    "seeds": "seeds",
    "better over the workspace": "workspace",
    "alike": "alike",
    "error over its": "ratio",
    "better at check poses": "check",
}
PERCENT = {"covered, %": "covered", "standard error, %": "standard_error", "unbounded, %": "unbounded"}


def models(rng):
    believed = ("prior", "log-det prior")
    rows = [
        {"name": name, "structure": s, "constraint": c, "filling": f, "prior": f in believed}
        for name, (s, c, f, _) in KINDS.items()
    ]
    return filled(ModelReport, rng, rows, paper=None)


def judged(report):
    """The same with the verdict that follows from its numbers."""
    both = [gains(own, {m.name: [m] for m in own}) for own in (report.models, report.nonlinear)]
    gained = {"gains": both[0], "gains_nonlinear": both[1]}
    return replace(report, **vars(verdict(report.models, report.nonlinear)), **gained)


def intervals(rng, kinds):
    rows = [
        fill(Coverage, rng, kind=k, **{key: rng.uniform(0.2, 0.9) for key in PERCENT.values()}) for k in kinds
    ]
    return {row.name: row for row in rows}


@pytest.fixture
def report(rng):
    linear, nonlinear = models(rng), models(rng)
    by_name = {name: spread(rng) for name in ("joints", "MGCO56", "MGCO68")}
    choice = fill(
        Choice,
        rng,
        recommended=("MGCO56",),
        chosen={name: rng.uniform(0.1, 0.3) for name in by_name},
        held_out_f_m={name: spread(rng) for name in by_name},
        workspace_mm=by_name,
    )
    made = fill(
        IdentifiabilityReport,
        rng,
        seed=[4, 5, 6],
        models=linear,
        nonlinear=nonlinear,
        beaten=[Beaten(5, 2, 20), Beaten(13, 17, 20)],
        scales=[{"scale": x, **{n: spread(rng) for n in SCALED}} for x in (0.2, 2.5)],
        poses=[{"poses": x, **{n: spread(rng) for n in OVER_POSES}} for x in (5, 13, 40)],
        fixed_scale={"MGCO56": spread(rng), "MGCO68": spread(rng)},
        choice=choice,
        never_worse={name: fill(Ratio, rng) for name in ("MGCO56", "MGCO68")},
        coverage=intervals(rng, ["linearised", "bootstrap", "posterior", "set", "set"]),
        family_coverage=intervals(rng, ["family", "family"]),
    )
    return judged(made)


def with_errors(report, errors):
    """Errors over the workspace by model's name, under both truths; all others are larger."""

    def own(m, factor):
        rms = around(factor * errors[m.name]) if m.name in errors else m.workspace.rms_mm
        return replace(m, workspace=replace(m.workspace, rms_mm=rms))

    linear = [own(m, 1.0) for m in report.models]
    return judged(replace(report, models=linear, nonlinear=[own(m, 1.5) for m in report.nonlinear]))


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else judged(single(report))
    tables = STUDY.tables(report)
    check_table(tables["models"], report.models, MEANS)
    check_table(tables["nonlinear"], report.nonlinear, MEANS)
    pairs = [
        {"name": a.name, "linear": a, "nonlinear": b}
        for a, b in zip(report.models, report.nonlinear, strict=True)
    ]
    check_table(tables["short"], pairs, SHORT)
    check_table(tables["duels"], report.duels, DUELS)
    check_table(tables["duels_nonlinear"], report.duels_nonlinear, DUELS)
    check_table(tables["poses"], report.poses, {"poses": "poses"} | {f"{n}, mm": n for n in OVER_POSES})
    scale = {"prior softer than the truth, times": "scale"}
    check_table(tables["scales"], report.scales, scale | {f"{n}, mm": n for n in SCALED})
    check_report(STUDY, report)
    check_words(STUDY.words(report))


def test_tables_of_choice_and_coverage_show_the_reports_numbers(report):
    text = STUDY.words(report).whole()
    found = {tuple(head): rows for head, rows in tables_of(text)}
    choice = report.choice
    rows = found["structure", "recommended", "F_M held out", "RMS workspace, mm"]
    assert [row[0] for row in rows] == list(choice.chosen)
    for name, chosen, held_out, error in rows:
        assert shows(chosen, choice.chosen[name])
        assert shows(held_out, choice.held_out_f_m[name])
        assert shows(error, choice.workspace_mm[name])
    [head] = [head for head in found if head[0] == "interval"]
    both = {**report.coverage, **report.family_coverage}
    assert [row[0] for row in found[head]] == list(both)
    for cells in found[head]:
        row = dict(zip(head, cells, strict=True))
        own = both[row["interval"]]
        assert row["datasets"] == str(own.datasets)
        assert shows(row["mean width, um"], own.width_um)
        for title, key in PERCENT.items():
            assert float(row[title]) == pytest.approx(100 * getattr(own, key), abs=0.5001), (title, own)


@pytest.mark.parametrize("winner", KINDS)
def test_the_answer_is_the_gain_of_the_best_whichever_it_is(report, winner):
    structure, _, filling, method = KINDS[winner]
    made = with_errors(report, {winner: 2.0, "MLS56": 7.0} | ({"MLS56": 2.0} if winner == "MLS56" else {}))
    words = STUDY.words(made)
    answer, shown = words.block("answer"), f"{method} ({structure})"
    if winner == "MLS56":
        assert answer.startswith(f"Best over the workspace is {shown}, 2.000 (1.060 to 3.420) mm.")
    else:
        said = f"RMS error over the workspace: {winner} 2.000 mm, least squares 7.000 mm; 3.5 times less."
        assert answer.startswith(said)
    joints = made.models[0].workspace.rms_mm
    assert f"Joints alone {joints.median:.3f} mm" in answer
    plain = f"{shown}: 2.000" if filling in ("none", "least trace") else "least squares (MLS56): 7.000"
    assert f"Without a prior the least error is that of {plain} mm." in words.block("statements")
    said = f"With non-linear truth the best is {shown}, 3.000 (1.590 to 5.130) mm; without a prior "
    assert said in words.block("more")
    assert words.block("worst").startswith(f"Worst with non-linear truth: {winner} 3.000 mm")


def test_of_methods_alike_that_by_gco_is_named(report):
    made = with_errors(report, {"MGCO56, LS + prior": 2.0, "MGCO68, GCO + prior": 2.03, "MGCO56": 2.5})
    assert STUDY.words(made).block("answer").startswith("RMS error over the workspace: MGCO68, GCO + prior")
    alike = "least squares with prior (MGCO56) and GCO with prior (MGCO68) (alike), 2.000 ("
    assert made.best.words.startswith(alike)


def test_statements_carry_the_reports_numbers_under_the_right_names(report):
    head = STUDY.words(report).block("statements")
    text = STUDY.words(report).block("more")
    error = {m.name: m.workspace.rms_mm for m in report.models}

    def shown(value):
        return f"{value.median:.3f} ({value.p05:.3f} to {value.p95:.3f}) mm"

    for name in ("MGCO56", "MGCO68"):
        plain, ours, trace = (error[n] for n in (name, f"{name}, GCO + prior", f"{name}, least trace"))
        ratio = f"(ratio {plain.median / ours.median:.3g})"
        assert f"- {name} by GCO: {shown(plain)} without a prior, {shown(ours)} with it {ratio}. " in text
        assert f"metric: {shown(trace)}." in text
        r = report.never_worse[name]
        assert f"is {r.best_ratio:.3f} to {r.worst_ratio:.3f} times that of least squares" in text
        assert f"in {r.seeds_worse} of {r.seeds} seeds" in text
    assert "5, 13: MGCO56 without a prior beats Joints in 2, 17 of 20 seeds" in text
    assert f"joints alone {shown(report.joints_nonlinear.workspace.rms_mm)}." in text
    low, high = (f"{row['MGCO56, GCO + prior'].median:.3f}" for row in report.scales)
    assert (
        f"A prior 0.2 and 2.5 times softer than the truth: MGCO56, GCO + prior errs by {low} and {high} mm"
        in text
    )
    assert f"MGCO56 errs by {shown(report.fixed_scale['MGCO56'])}." in text
    choice, out = report.choice, report.outliers
    said = f"recommends MGCO56, which errs {choice.chosen_workspace_mm.median:.3f} mm; the best in hindsight"
    assert f"{said} {choice.best_workspace_mm.median:.3f} mm." in head
    for value, words in (
        (out.plain_mm, " with the plain loss"),
        (out.robust_mm, " with the robust one"),
    ):
        assert shown(value) + words in text
    assert f"without outliers by {shown(out.clean_mm)}" in text
    exact = [100 * row.covered for row in report.coverage.values() if row.kind != "set"]
    sets = [100 * row.covered for row in report.coverage.values() if row.kind == "set"]
    assert f"in {min(exact):.1f} to {max(exact):.1f} % of the cases" in head
    assert f"deflection in at least {min(sets):.1f} %" in text
    for row in report.family_coverage.values():
        assert f"{100 * row.covered:.1f} % ({row.name})" in text


def test_the_figure_draws_the_reports_numbers(report):
    drawn = STUDY.figures["identifiability.png"](report)
    left, centre, right = drawn.axes
    looks_differ(key_of(drawn))
    assert unit_in(left.get_xlabel()) == unit_in(centre.get_ylabel()) == unit_in(right.get_ylabel()) == "mm"
    assert [t.get_text().rsplit("  ", 1)[0] for t in left.get_yticklabels()] == list(KINDS)
    for y, m in enumerate(report.models):
        line, dot = left.get_lines()[2 * y : 2 * y + 2]
        assert tuple(line.get_xdata()) == ends(m.workspace.rms_mm)
        assert set(line.get_ydata()) == set(dot.get_ydata()) == {y}
        assert np.ravel(dot.get_xdata())[0] == middle(m.workspace.rms_mm)
        assert dot.get_color() == look(m.structure, m.constraint, m.prior, m.filling).hex
    gco = [name for name in SCALED if KINDS[name][1] == "psd"]
    for axes, rows, names, x in (
        (centre, report.poses, OVER_POSES, "poses"),
        (right, report.scales, gco, "scale"),
    ):
        found = curves(axes)
        assert list(found) == names
        for name in names:
            assert found[name][0].tolist() == [row[x] for row in rows]
            assert found[name][1].tolist() == [middle(row[name]) for row in rows]
        for name, band in zip([n for n in names if n in figure.BANDS], bands(axes), strict=True):
            np.testing.assert_allclose(band, [(row[x], *ends(row[name])) for row in rows])
    assert [t.get_text() for t in right.get_xticklabels()] == ["0.2", "2.5"]
    assert centre.get_xlabel() == "poses"
    assert right.get_xlabel() == "prior softer than the truth, times"
