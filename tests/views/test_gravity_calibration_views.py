"""What people see of a calibration equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, check_report, check_table, unit_in
from made_up import around, fill, filled, single

from testbench.bench.campaign import Scenario
from testbench.bench.rows import ErrorRow, error_row
from testbench.identify.evaluate import Score
from testbench.studies.gravity_calibration.study import STUDY
from testbench.studies.gravity_calibration.summary import (
    GravityReport,
    ModelReport,
    recommended,
    summary,
    winners,
)
from testbench.studies.gravity_calibration.trial import ModelRow, Settings
from testbench.views.colours import look

MODELS = [
    {"name": "MLS32", "structure": "MLS32", "constraint": "none", "prior": False, "conservative": False},
    {"name": "MGCO56", "structure": "MGCO56", "constraint": "psd", "prior": False, "conservative": True},
    {"name": "MLS56 + prior", "structure": "MLS56", "constraint": "none", "prior": True, "conservative": 0.4},
    {
        "name": "MGCO56 + prior",
        "structure": "MGCO56",
        "constraint": "psd",
        "prior": True,
        "conservative": True,
    },
]
PAPER = ("identification_rms_mm", "check_rms_mm", "check_max_mm", "check_max_relative_percent")
ERRORS = {
    "RMS fit, mm": "identification.rms_mm",
    "RMS check, mm": "check.rms_mm",
    "95 % check, mm": "check.p95_mm",
    "max check, mm": "check.max_mm",
    "max rel., %": "check.max_relative_percent",
    "RMS workspace, mm": "workspace.rms_mm",
}
SHORT = {"95 % check, mm", "max rel., %"}
MEANS = {
    "model": "name",
    "unknowns": "parameters",
    "seen": "rank",
    "conservative": "conservative",
    "F_M": "f_m",
    "floor": "f_m_floor",
    **ERRORS,
}
KNOWN = {
    "RMS fit, mm": "paper.identification_rms_mm",
    "RMS check, mm": "paper.check_rms_mm",
    "max check, mm": "paper.check_max_mm",
    "max rel., %": "paper.check_max_relative_percent",
}
FITS = {
    "model": "name",
    "method": "method",
    "status": "status",
    "duality gap": "duality_gap",
    "trace weight costs at most": "f_m_excess_bound",
} | {
    "smallest eigenvalue": "min_eigenvalue",
    "time, s": "solve_seconds",
    **{
        title: f"residuals.{group}.{key}"
        for group in ("identification", "check")
        for title, key in (
            (f"residual mean, {group}, um", "mean_um"),
            (f"residual standard deviation, {group}, um", "std_um"),
            (f"Lilliefors p, {group}", "lilliefors_p"),
        )
    },
}


@pytest.fixture
def report(rng):
    models = filled(ModelReport, rng, MODELS, paper={key: float(rng.uniform(1, 9)) for key in PAPER})
    return fill(
        GravityReport,
        rng,
        seed=[1, 2],
        models=models,
        recommended="MGCO56",
        twins=[],
        winners=winners(models),
    )


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else single(report)
    tables = STUDY.tables(report)
    short = {t: path for t, path in MEANS.items() if t not in SHORT and t != "floor"}
    check_table(tables["models"], report.models, MEANS, KNOWN)
    check_table(tables["short"], report.models, short, {t: p for t, p in KNOWN.items() if t in short})
    check_table(tables["fits"], report.models, FITS)
    check_report(STUDY, report)


def judged(report, models):
    """The report of these models, its verdicts as the study computes them."""
    return replace(report, models=models, winners=winners(models), recommended=recommended(models))


def with_error(model, mm):
    return replace(model, workspace=replace(model.workspace, rms_mm=around(mm)))


@pytest.mark.parametrize("winner", ["MLS32", "MGCO56", "MGCO56 + prior"])
def test_the_answer_names_each_method_with_its_own_error(report, winner):
    """Every model has an error of its own; the conservative one of least error is recommended."""
    sizes = {m.name: 20.0 + 10 * k for k, m in enumerate(report.models)} | {winner: 11.0}
    made = judged(report, [with_error(m, sizes[m.name]) for m in report.models])
    held = {m.name: sizes[m.name] for m in report.models if m.conservative is True}
    assert made.recommended == min(held, key=held.get)
    text = STUDY.words(made).block("answer")
    assert f"GCO without prior {sizes['MGCO56']:.3f} (" in text
    assert f"least squares {sizes['MLS32']:.3f} (" in text
    assert text.index("(MGCO56)") < text.index("(MLS32)")
    assert ("MGCO56 + prior" in text) == (made.recommended == "MGCO56 + prior")
    assert f"marked with *: {made.recommended}," in STUDY.words(made).block("statements")
    [marked] = {table.bold for table in STUDY.tables(made).values() if table.bold}
    assert marked == made.recommended


def test_of_models_alike_the_conservative_one_of_fewest_unknowns_is_recommended(report):
    same = [replace(with_error(m, 20.0), conservative=True, parameters=30) for m in report.models]
    fewest = [replace(m, parameters=9) if m.name == "MGCO56 + prior" else m for m in same]
    assert recommended(same) == "MGCO56"
    assert recommended(fewest) == "MGCO56 + prior"
    none = [replace(m, conservative=False) for m in same]
    assert "none is recommended" in STUDY.words(judged(report, none)).block("statements")


def test_paired_counts_seeds_of_the_best_of_each_method_without_prior(rng):
    """Three seeds; GCO is better at the check poses in two, over the workspace in one."""
    rows = {
        seed: [
            fill(ModelRow, rng, **own, check=errors(rng, check), workspace=errors(rng, area))
            for own, check, area in zip(MODELS[:2], checks, areas, strict=True)
        ]
        for seed, checks, areas in (
            (1, (2.0, 1.0), (9.0, 5.0)),
            (2, (3.0, 3.5), (7.0, 8.0)),
            (3, (2.0, 1.5), (7.0, 8.0)),
        )
    }
    asked = Settings("kr500_l480", Scenario(arm="kr500_l480"), 50.0)
    found = summary(asked, range(1, 4), list(rows.items()))
    assert found.check_best == ("MGCO56",)
    paired = found.paired
    assert (paired.conservative, paired.least_squares) == ("MGCO56", "MLS32")
    assert (paired.check, paired.workspace, paired.seeds) == (2, 1, 3)


def errors(rng, rms):
    return fill(ErrorRow, rng, rms_mm=rms)


def test_the_figure_draws_the_reports_numbers_in_the_colour_of_each_model(report):
    figure = STUDY.figures["models.png"](report)
    for axes, path in zip(figure.axes, ("check.rms_mm", "workspace.rms_mm"), strict=True):
        assert unit_in(axes.get_xlabel()) == "mm"
        lines = axes.get_lines()
        for y, m in enumerate(report.models):
            own = [line for line in lines if np.ravel(line.get_ydata())[0] == y]
            spread, dot = own[0], own[1]
            value = at(m, path)
            assert tuple(spread.get_xdata()) == (value.p05, value.p95)
            assert np.ravel(dot.get_xdata())[0] == value.median
            shade = look(m.structure, m.constraint).hex
            assert dot.get_color() == shade
            assert (dot.get_markerfacecolor() == shade) == m.prior
            assert axes.get_yticklabels()[y].get_text() == f"{m.name}  {value.median:.3f}"


def test_least_squares_is_orange_and_gco_green():
    assert look("MLS56", "none").hex == "#E69F00"
    assert look("MGCO56", "psd").hex == "#009E73"
    assert len({look(name, "psd").hex for name in ("MGCO47", "MGCO56", "MGCO68", "MGCO147")}) == 4


def test_errors_are_shown_in_millimetres_and_per_cent():
    row = error_row(Score(rms=1e-3, p95=2e-3, max=3e-3, p95_relative=0.04, max_relative=0.05))
    assert row == ErrorRow(1.0, 2.0, 3.0, 4.0, 5.0)
