"""What people see of the solver comparison equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, check_words, curves, unit_in
from made_up import fill, filled

from testbench.studies.solver_comparison.recording import race
from testbench.studies.solver_comparison.report import (
    Convergence,
    End,
    LocalMinima,
    ModelReport,
    SolverComparisonReport,
    SolverReport,
)
from testbench.studies.solver_comparison.rows import SolverRow
from testbench.studies.solver_comparison.study import STUDY
from testbench.studies.solver_comparison.theses import theses
from testbench.studies.study import Run
from testbench.trials.spread import Spread, middle
from testbench.views.schema import show

KEYS = ("a", "a'", "b", "b'", "c", "d")
MEANS = {
    "solver": "title",
    "F_M": "f_m",
    "over (d)": "relative_excess",
    "over the bound": "relative_excess_bound",
    "time, s": "seconds",
    "time to 1 %, s": "seconds_to_1_percent",
    "to 1 %, times (d)": "ratio_to_conic",
    "whole time, times (d)": "whole_ratio_to_conic",
    "F_M evaluations": "evaluations",
    "local solves": "local_solves",
    "of them elsewhere": "local_solves_elsewhere",
    "conservative": "conservative",
    "RMS true, mm": "check_true.rms_mm",
    "95 % true, mm": "check_true.p95_mm",
    "status": "status",
}


@pytest.fixture
def report(rng):
    made = filled(SolverReport, rng, [{"key": key} for key in KEYS])
    points = {key: [(float(k + 1), float(rng.uniform(1, 9))) for k in range(3)] for key in KEYS}
    minima = {f"m={m}": fill(LocalMinima, rng, m=m, seeds=[1, 2]) for m in (6, 4, 3)}
    runs = [fill(End, rng, seed=seed, key=key) for seed in (1, 2) for key in KEYS]
    return fill(
        SolverComparisonReport,
        rng,
        seed=[1, 2],
        solvers=made,
        models=filled(ModelReport, rng, [{"paper": None}]),
        local_minima=minima,
        runs=runs,
        convergence=Convergence(1, points),
    )


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    check_table(tables["solvers"], report.solvers, MEANS)
    short = {"solver": "key", **{t: MEANS[t] for t in list(MEANS)[1:7]}, "RMS true, mm": "check_true.rms_mm"}
    check_table(tables["short"], report.solvers, short)
    text = check_report(STUDY, report)
    check_words(STUDY.words(report))
    for row in report.local_minima.values():
        shares = f"{100 * row.share_sharp:.0f} | {100 * row.share_close:.0f}"
        line = f"| {row.m} | {row.starts_per_seed} in each of 2 seeds | {row.reference} | {shares} | "
        assert f"{line}{show(row.median, '.1e')} | {show(row.worst, '.1e')} | {row.unfinished} |" in text


def test_the_answer_has_the_times_of_the_conic_program_and_of_the_papers_search(report):
    rows = {row.key: row for row in report.solvers}
    text = STUDY.words(report).block("answer")
    assert f"takes {show(1000 * middle(rows['d'].seconds), '.3g')} ms" in text
    assert f"F_M to {show(100 * middle(rows['d'].relative_excess_bound), '.2g')} %." in text
    assert f"(a) takes {rows['a'].times} as long." in text
    assert ("never ends" in text) == report.theses.conic_never_above_paper.met
    never = [replace(row, ratio_to_conic=None) if row.key == "a" else row for row in report.solvers]
    assert "(a) never comes within 1 %." in STUDY.words(replace(report, solvers=never)).block("answer")


def rows_of(rng, f_m):
    """One row a seed for every solver, with an F_M of each."""
    return {
        key: [fill(SolverRow, rng, f_m=v, ratio_to_conic=2000.0, f_m_excess_bound=0.5)]
        for key, v in f_m.items()
    }


@pytest.mark.parametrize("least", ["a", "b", "d"])
def test_who_is_above_whom_is_judged_by_f_m(rng, least):
    f_m = {key: 5.0 if key == least else 6.0 for key in KEYS}
    made = filled(SolverReport, rng, [{"key": key, "local_solves": 4} for key in KEYS])
    found = theses(rows_of(rng, f_m), made, Spread(1.0, 1.0, 1.0))
    never = found.conic_never_above_paper
    assert never.met == (least != "a")
    assert never.largest_relative_excess_of_d_over_any == pytest.approx(0.0 if least == "d" else 0.2)
    assert found.conic_1000_times_faster_than_paper_to_1_percent.least_ratio == 2000.0
    counted = [row for row in made if row.key in ("a", "a'", "b", "c")]
    assert found.all_local_solves_reach_the_conic_f_m.of == 16
    assert found.all_local_solves_reach_the_conic_f_m.elsewhere == sum(
        row.local_solves_elsewhere for row in counted
    )


def test_the_figure_draws_ways_and_ends_of_every_solver(report):
    left, right = STUDY.figures["solver_comparison.png"](report).axes
    assert unit_in(left.get_xlabel()) == "s"
    drawn = curves(left)
    for row in report.solvers:
        x, y = drawn[row.title]
        own = [run for run in report.runs if run.key == row.key]
        assert x.tolist() == [run.seconds for run in own]
        assert y.tolist() == [run.gap_to_bound for run in own]
        way = report.convergence.points[row.key]
        steps = [line for line in left.get_lines() if line.get_drawstyle() == "steps-post"]
        assert any(np.array_equal(line.get_xydata()[:-1], way) for line in steps)
    strips = [line for line in right.get_lines() if line.get_marker() == "."]
    for strip, row in zip(strips, report.local_minima.values(), strict=True):
        assert strip.get_ydata().tolist() == row.excess


def test_dots_of_the_recording_are_the_reports_times(report):
    run = Run(None, range(1, 4), report, STUDY.words(report), STUDY.tables(report), None, "{}")
    dots = {dot.name: dot for dot in race(run).times}
    for row in report.solvers:
        for name, value in (("time", row.seconds), ("time to 1 %", row.seconds_to_1_percent)):
            dot = dots[f"{name}: ({row.key})"]
            assert dot.value == value
            assert dot.text.endswith(" s")
