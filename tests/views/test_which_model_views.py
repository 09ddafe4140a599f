"""What people see of the study of the default method equals its report, for trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import (
    check_pivot,
    check_report,
    check_spread,
    check_table,
    check_words,
    ends_of,
    summaries,
    unit_in,
)
from made_up import of_one_trial

from testbench.bench.truths import CALLED, TRUTHS
from testbench.bench.wrong_prior import PRIORS, PRIORS_CALLED
from testbench.studies.which_model import figure, tables
from testbench.studies.which_model.methods import COVERED
from testbench.studies.which_model.rows import Case, Cover, Doubted, FitRow
from testbench.studies.which_model.study import STUDY
from testbench.studies.which_model.trial import POSES, Settings, pairs
from testbench.trials.spread import middle
from testbench.views.markdown import grid

SEEDS = range(2, 14)
SETTINGS = Settings(arm="kr500_l480", sigma=40e-6)
DEFAULT = "default"
FIXED = {
    "Joints": ("Joints", "none", False),
    "MLS56, PSD of equal fit": ("MLS56", "free", False),
    "MLS56": ("MLS56", "none", False),
    "MGCO56": ("MGCO56", "psd", False),
    "MLS56 + prior": ("MGCO56", "none", True),
    "ALL153 + prior": ("ALL153", "psd", True),
}
METHODS = {DEFAULT: ("ALL153", "psd", True), **FIXED}
LINKS = ("link_1", "link_2")
FAMILY = {
    "method": "method",
    "RMS error, mm": "workspace_mm",
    "at check poses, mm": "check_mm",
    "over joints alone": "over_joints",
    "loses to them": "loses",
    "over the best fixed": "over_best",
    "over the best of the case": "over_least",
    "is the best in": "wins",
    "F_M over floor": "misfit",
    "conservative": "conservative",
}
LOSSES = {
    "true arm": "truth",
    "prior": "prior",
    "poses": "poses",
    "method": "method",
    "cases": "cases",
    "loses": "loses",
    "over joints alone": "over_joints",
    "RMS error, mm": "workspace_mm",
}
WORST = {
    "trial": "trial",
    "true arm": "truth",
    **{key: key for key in ("prior", "poses", "chosen")},
    "RMS error, mm": "workspace_mm",
    "over joints alone": "over_joints",
    "over the best fixed": "over_best",
}  # fmt: skip
COVER = {
    "cases": "where",
    "how many": "cases",
    "covered, %": "covered",
    "covered, case by case, %": "by_case",
    "half width, mm": "half_mm",
    "of the ideal, mm": "ideal_mm",
    "half width over the ideal": "over_ideal",
}
DOUBTS = {
    "prior": "prior",
    "which cases": "what",
    "how many": "cases",
    "any doubt": "doubted",
    "what is wrong is contradicted": "told",
    "is named as unchecked": "unchecked",
    "where another one is wrong": "otherwise",
    "contradicted or unchecked": "either",
}


def trials(rng, errors=None):
    """Made-up rows; `errors` fixes the error over the workspace by method, or by method and poses."""
    found = []
    for seed in SEEDS:
        rows = []
        for truth, prior in pairs(seed):
            wrong = {"link": LINKS[seed % 2], "joints": "joints"}.get(prior)
            share = rng.uniform(0.01, 0.04) + 0.05 * (wrong == LINKS[1]) if prior == "link" else None
            case = Case(truth, prior, rng.uniform(0.1, 0.5), rng.uniform(0.1, 0.5), wrong, share)
            for name, (structure, constraint, filled) in METHODS.items():
                for poses in POSES:
                    row = of_one_trial(
                        FitRow, rng, case=case, poses=poses, method=name, structure=structure,
                        constraint=constraint, filled=filled, **said(rng, name, prior),
                    )  # fmt: skip
                    own = (errors or {}).get((name, poses), (errors or {}).get(name))
                    rows.append(row if own is None else replace(row, workspace_mm=own))
        found.append((seed, rows))
    return found


def said(rng, name, prior):
    """What is known of some methods alone."""
    heard = tuple(n for n in (*LINKS, "joints") if rng.random() < 0.4)
    unread = tuple(n for n in LINKS if rng.random() < 0.5) if prior == "link" else None
    return {
        "chosen": rng.choice(list(FIXED)).item() if name == DEFAULT else None,
        "cover": Cover(*rng.uniform(0.2, 0.9, 3)) if name in COVERED else None,
        "doubted": Doubted(heard, unread) if name == DEFAULT else None,
    }


summed, made, report = summaries(STUDY, SETTINGS, SEEDS, trials)


def errors_of(made, method, poses, truth="", prior=""):
    """Of all cases, by seed and truth."""
    return {
        (seed, row.case.truth): row.workspace_mm
        for seed, rows in made
        for row in rows
        if (row.method, row.poses) == (method, poses)
        and truth in ("", row.case.truth)
        and prior in ("", row.case.prior)
    }


def test_every_method_is_compared_case_by_case_with_joints_with_the_best_and_with_the_least(made, report):
    assert len(report.family) == len(METHODS) * len(POSES)
    for poses in POSES:
        every = {m: errors_of(made, m, poses) for m in METHODS}
        best = min(FIXED, key=lambda m: np.median(list(every[m].values())))
        [advice] = [a for a in report.advice if a.poses == poses]
        assert advice.best.method == best
        assert advice.default.method == DEFAULT
        plain = [m for m, (_, _, filled) in FIXED.items() if not filled]
        assert advice.without_prior.method == min(plain, key=lambda m: np.median(list(every[m].values())))
        for own in [m for m in report.family if m.poses == poses]:
            mine = every[own.method]
            check_spread(own.workspace_mm, list(mine.values()))
            over = np.array([v / every["Joints"][k] for k, v in mine.items()])
            check_spread(own.over_joints, over)
            check_spread(own.over_best, [v / every[best][k] for k, v in mine.items()])
            least = {k: min(every[m][k] for m in FIXED) for k in mine}
            check_spread(own.over_least, [v / least[k] for k, v in mine.items()])
            assert own.loses == pytest.approx(np.mean(over > 1.05))
            assert own.wins == pytest.approx(np.mean([v <= least[k] for k, v in mine.items()]))


def test_cases_are_gathered_by_truth_by_prior_and_by_both(made, report):
    assert len(report.by_truth) == len(METHODS) * len(POSES) * len(TRUTHS)
    assert len(report.cells) == len(METHODS) * len(POSES) * len(TRUTHS) * len(PRIORS)
    assert {m.method for m in report.by_prior} == {m for m, (_, _, filled) in METHODS.items() if filled}
    for own in (*report.by_truth, *report.by_prior, *report.cells):
        values = errors_of(made, own.method, own.poses, own.truth, own.prior)
        assert own.cases == len(values)
        check_spread(own.workspace_mm, list(values.values()))
    for truth in report.truths:
        cases = {row.case for _, rows in made for row in rows if row.case.truth == truth.truth}
        assert len(cases) == len(SEEDS)
        check_spread(truth.cad_mm, [case.cad_mm for case in cases])
        check_spread(truth.off_tubes, [case.off_tubes for case in cases])


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    for name in ("family", "family_short"):
        check_pivot(tables[name], report.family, ("method", "poses", "workspace_mm"), "poses")
    for advice in report.advice:
        own = {
            key: [m for m in getattr(report, key) if m.poses == advice.poses]
            for key in ("family", "by_truth", "by_prior", "cells")
        }
        check_table(tables[f"family_{advice.poses}"], own["family"], FAMILY)
        check_pivot(
            tables[f"truth_{advice.poses}"],
            own["by_truth"],
            ("method", "truth", "workspace_mm"),
            called=({}, CALLED),
        )
        check_pivot(
            tables[f"prior_{advice.poses}"],
            own["by_prior"],
            ("method", "prior", "workspace_mm"),
            called=({}, PRIORS_CALLED),
        )
        cells = [m for m in own["cells"] if m.method == DEFAULT]
        both = CALLED, PRIORS_CALLED
        for name, rows, paths, called in (
            ("truth", own["by_truth"], ("method", "truth", "workspace_mm"), ({}, CALLED)),
            ("prior", own["by_prior"], ("method", "prior", "workspace_mm"), ({}, PRIORS_CALLED)),
            ("default", cells, ("truth", "prior", "workspace_mm"), both),
            ("over_best", cells, ("truth", "prior", "over_best"), both),
        ):
            check_pivot(tables[f"{name}_{advice.poses}"], rows, paths, called=called)
        check_pivot(
            tables[f"default_{advice.poses}"],
            cells,
            ("truth", "prior", "workspace_mm"),
            called=(CALLED, PRIORS_CALLED),
        )
        check_pivot(
            tables[f"over_best_{advice.poses}"],
            cells,
            ("truth", "prior", "over_best"),
            called=(CALLED, PRIORS_CALLED),
        )
    check_table(tables["losses"], report.losses, LOSSES)
    check_table(tables["worst"], report.worst, WORST)
    check_table(tables["cover"], [c for c in report.cover if c.method == DEFAULT], COVER)
    check_pivot(tables["covered"], report.cover, ("where", "method", "covered"))
    check_pivot(tables["widths"], report.cover, ("where", "method", "over_ideal"))
    check_table(tables["doubts"], [d for d in report.doubts if d.poses is None], DOUBTS)
    check_table(tables["chosen"], report.chosen, {k: k for k in ("poses", "method", "cases", "share")})
    text = check_report(STUDY, report)
    check_words(STUDY.words(report))
    for name, table in tables.items():
        assert (grid(table) in text) == (name != "family_short"), name


def test_losses_are_where_the_default_loses_to_joints_worst_first(rng):
    """Of a default that loses with one truth alone."""
    found = [(seed, [replace(row, workspace_mm=_lost(row)) for row in rows]) for seed, rows in trials(rng)]
    report = summed(found)
    assert {a.best.method for a in report.advice} == {"Joints"}
    assert {(m.truth, m.method, m.loses) for m in report.losses} == {("cast", DEFAULT, 1.0)}
    assert len(report.losses) == len(PRIORS) * len(POSES)
    worst = [m.over_joints.median for m in report.losses]
    assert worst == sorted(worst, reverse=True)
    assert worst[0] == pytest.approx(1.8)
    cases = {(c.truth, c.poses) for c in report.worst}
    assert cases == {("cast", 20)}
    np.testing.assert_allclose([c.over_joints for c in report.worst], 1.8)


def _lost(row):
    if row.method == "Joints":
        return 0.5
    if row.method != DEFAULT:
        return 0.9
    return 0.03 * row.poses + 0.3 if row.case.truth == "cast" else 0.1


def rows_of(made):
    """Of the default, all cases."""
    return [row for _, rows in made for row in rows if row.method == DEFAULT]


def test_coverage_is_the_share_of_components_over_all_cases_and_over_parts(made, report):
    for own in report.cover:
        rows = [
            row
            for _, trial in made
            for row in trial
            if row.method == own.method
            and own.truth in ("", row.case.truth)
            and own.prior in ("", row.case.prior)
            and own.poses in (None, row.poses)
        ]
        assert own.cases == len(rows)
        assert own.covered == pytest.approx(np.mean([row.cover.covered for row in rows]))
        check_spread(own.over_ideal, [row.cover.half_mm / row.cover.ideal_mm for row in rows])
    parts = 1 + len(POSES) + len(TRUTHS) + len(PRIORS)
    assert {c.method for c in report.cover} == set(COVERED) & set(METHODS)
    assert len({c.where for c in report.cover}) == parts
    assert len(report.cover) == parts * len(set(COVERED) & set(METHODS))


def test_doubts_are_counted_as_said_and_as_right(made, report):
    rows = rows_of(made)
    for prior in PRIORS:
        own = [row for row in rows if row.case.prior == prior]
        [every] = [d for d in report.doubts if (d.prior, d.what, d.poses) == (prior, "all", None)]
        assert every.doubted == pytest.approx(np.mean([len(row.doubted.contradicted) > 0 for row in own]))
        told = [row.case.wrong in row.doubted.contradicted for row in own]
        assert every.told == (pytest.approx(np.mean(told)) if prior in ("link", "joints") else None)
        if prior != "link":
            assert every.unchecked is every.either is every.otherwise is None
    own = [row for row in rows if row.case.prior == "link"]
    parts = {
        "all": own,
        "less than 5 % of the deflection": [row for row in own if row.case.share < 0.05],
        "more than 5 % of the deflection": [row for row in own if row.case.share > 0.05],
        **{name: [row for row in own if row.case.wrong == name] for name in LINKS},
    }
    found = [d for d in report.doubts if d.prior == "link"]
    assert {d.what for d in found} == set(parts)
    for d in found:
        part = [row for row in parts[d.what] if d.poses in (None, row.poses)]
        told = np.array([row.case.wrong in row.doubted.contradicted for row in part])
        open_ = np.array([row.case.wrong in row.doubted.unchecked for row in part])
        assert (d.cases, d.told) == (len(part), pytest.approx(told.mean()))
        assert d.unchecked == pytest.approx(open_.mean())
        assert d.either == pytest.approx((told | open_).mean())
        others = {
            name: np.mean([name in row.doubted.unchecked for row in own if row.case.wrong != name])
            for name in LINKS
        }
        assert d.otherwise == pytest.approx(np.mean([others[row.case.wrong] for row in part]))
    tubes = [row for row in rows if (row.case.prior, row.case.truth) == ("right", "tubes")]
    [alarm] = [d for d in report.doubts if (d.prior, d.what, d.poses) == ("right", "links of tubes", None)]
    assert (alarm.cases, alarm.told) == (len(tubes), None)
    assert alarm.doubted == pytest.approx(np.mean([len(row.doubted.contradicted) > 0 for row in tubes]))


def test_the_coverage_and_the_doubts_of_a_prior_far_off_are_said(made, report):
    rows, text = rows_of(made), STUDY.words(report).block("statements")
    covered = 100 * np.mean([row.cover.covered for row in rows])
    assert f"95 % intervals cover {covered:.1f} % of the true deflections" in text
    by_prior = {
        prior: [bool(row.doubted.contradicted) for row in rows if row.case.prior == prior] for prior in PRIORS
    }
    said = [
        f"{name}, in {100 * np.mean(by_prior[prior]):.0f} %"
        for prior, name in (("link", "one link off"), ("joints", "joints off"))
    ]
    assert f"ten times off: {said[0]}; {said[1]} of cases." in text


@pytest.mark.parametrize("factor", [1.04, 1.06])
def test_a_method_loses_beyond_five_per_cent(rng, factor):
    own = summed(trials(rng, {"Joints": 0.2, "MGCO56": 0.2 * factor}))
    lost = {m.loses for m in own.family if m.method == "MGCO56"}
    assert lost == {1.0 if factor > 1.05 else 0.0}


@pytest.mark.parametrize("best", FIXED)
def test_the_answer_names_the_best_at_every_number_of_poses(rng, best):
    errors = {name: 0.4 + 0.1 * k for k, name in enumerate(FIXED)} | {(best, 12): 0.123, DEFAULT: 0.3}
    report = summed(trials(rng, errors))
    words, first = STUDY.words(report), report.advice[0]
    text = words.block("statements")
    if best == "Joints":
        assert "Of the fixed methods Joints errs least with 8, 12 and 20 poses." in text
    else:
        assert f"errs least Joints with 8, {best} with 12, Joints with 20 poses." in text
    assert words.block("answer").startswith("8 poses: default 0.300 mm over the workspace")
    joints = "0.123" if best == "Joints" else "0.400"
    assert f"With 12 poses the default errs 0.300 mm, joints alone {joints}; with 20" in text
    assert "Joints alone 0.400 mm, 1.3 times as much." in words.block("answer")
    assert middle(first.gains.joints.times) == pytest.approx(4 / 3)
    plain = best if not METHODS[best][2] else "Joints"
    value = "0.123" if plain == best else "0.400"
    said = f"12 poses: without a prior the least error is that of {plain}, {value} mm."
    assert said in words.block("more")
    assert "8, 12 or 20 poses" in words.block("question")


def test_where_the_default_never_loses_the_report_says_so(rng):
    errors = {name: 0.4 + 0.1 * k for k, name in enumerate(FIXED)} | {DEFAULT: 0.4}
    text = check_report(STUDY, summed(trials(rng, errors)))
    assert "With no true arm and no prior." in text
    assert "By more than 5 % the default loses to joints alone in 0.0 %, 0.0 %, 0.0 % of 72 cases." in text


def test_the_figure_draws_the_reports_numbers(report):
    drawn = figure.methods(report)
    assert len(drawn.axes) == len(POSES)
    for k, (axes, advice) in enumerate(zip(drawn.axes, report.advice, strict=True)):
        assert axes.get_title() == f"{advice.poses} poses"
        assert unit_in(axes.get_xlabel()) == "mm"
        own = [m for m in report.family if m.poses == advice.poses]
        names = [label.get_text() for label in axes.get_yticklabels()]
        heads = [f"{m.method}  " if k == 0 else "" for m in own]
        assert names == [f"{h}{m.workspace_mm.median:.3f}" for h, m in zip(heads, own, strict=True)]
        bold = [label.get_fontweight() == "bold" for label in axes.get_yticklabels()]
        assert [m.method for m, marked in zip(own, bold, strict=True) if marked] == [DEFAULT]
        line, *others = (np.array(shape.get_xdata(), float) for shape in axes.get_lines())
        np.testing.assert_allclose(line, advice.joints.workspace_mm.median)
        for spread, dot, m in zip(others[::2], others[1::2], own, strict=True):
            np.testing.assert_allclose(spread, ends_of(m.workspace_mm))
            np.testing.assert_allclose(dot, m.workspace_mm.median)
    assert len({tables.look_of(m) for m in report.family}) == len(METHODS)
    shown = tables.tables(report)["family_short"].looks
    assert shown == {m.method: tables.look_of(m) for m in report.family}
