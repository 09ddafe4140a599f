"""What people see of a calibration equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, check_report, check_table, check_words, ends_of, unit_in
from made_up import around, fill, filled, of_one_trial, single

from testbench.bench.campaign import Scenario
from testbench.bench.default import DEFAULT
from testbench.bench.error_places import ErrorPlaces, WorstPlace
from testbench.bench.rows import ErrorRow, error_row
from testbench.bench.truths import CALLED
from testbench.identify.evaluate import Score
from testbench.studies.gravity_calibration.gains import gains
from testbench.studies.gravity_calibration.study import STUDY
from testbench.studies.gravity_calibration.summary import (
    ByArm,
    GravityReport,
    ModelReport,
    compared,
    leaders,
    recommended,
    summary,
    winners,
)
from testbench.studies.gravity_calibration.trial import Measured, ModelRow, Settings
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.gains import ratio


def model(name, structure, constraint, conservative):
    prior = name.endswith("+ prior")
    return {"name": name, "structure": structure, "constraint": constraint, "prior": prior} | {
        "conservative": conservative
    }


MODELS = [
    model("Joints", "Joints", "none", True),
    model("MLS32", "MLS32", "none", False),
    model("MLS56, PSD of equal fit", "MLS56", "free", 0.3),
    model("MGCO56", "MGCO56", "psd", True),
    model("Joints + prior", "Joints", "none", True),
    model("MLS56 + prior", "MLS56", "none", 0.4),
    model("MGCO56 + prior", "MGCO56", "psd", True),
    model("ALL153 + prior", "ALL153", "psd", True),
]
PAPER = ("identification_rms_mm", "check_rms_mm", "check_max_mm", "check_max_relative_percent")
ERRORS = {
    "RMS fit, mm": "identification.rms_mm",
    "RMS check, readings, mm": "check.rms_mm",
    "RMS check, true, mm": "check_true.rms_mm",
    "95 % check, readings, mm": "check.p95_mm",
    "max check, readings, mm": "check.max_mm",
    "max rel., %": "check.max_relative_percent",
    "RMS workspace, true, mm": "workspace.rms_mm",
    "times less than LS": "times_less",
}
LONG = {
    "F_M",
    "floor",
    "RMS check, true, mm",
    "95 % check, readings, mm",
    "max check, readings, mm",
    "max rel., %",
}
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
    "RMS check, readings, mm": "paper.check_rms_mm",
    "max check, readings, mm": "paper.check_max_mm",
    "max rel., %": "paper.check_max_relative_percent",
}
PANELS = ("workspace.rms_mm", "check_true.rms_mm", "check.rms_mm")
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
    worst = WorstPlace(1, (1.2, -0.35, 2.0), "joint_1 10.0 deg", 0.75)
    models = filled(ModelReport, rng, MODELS, paper={key: float(rng.uniform(1, 9)) for key in PAPER})
    return fill(
        GravityReport,
        rng,
        seed=[1, 2],
        models=models,
        recommended="MGCO56",
        twins=[],
        duels=[],
        take=DEFAULT,
        gains=gains({m.name: [m] for m in models}, DEFAULT, "MGCO56", leaders(winners(models))),
        map=fill(ErrorPlaces, rng, worst={DEFAULT: worst}, error_mm={"MLS32": (4.0, 5.0)}),
        by_arm=[
            ByArm(m.name, arm, 4 + k, around(float(rng.uniform(1, 9))))
            for m in models
            for k, arm in enumerate(("tubes", "cast"))
        ],
        winners=winners(models),
    )


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else single(report)
    tables = STUDY.tables(report)
    short = {t: path for t, path in MEANS.items() if t not in LONG}
    check_table(tables["models"], report.models, MEANS, KNOWN)
    check_table(tables["short"], report.models, short)
    check_table(tables["fits"], report.models, FITS)
    cells = {(row.name, CALLED[row.true_arm]): f"{middle(row.workspace_mm):.3f}" for row in report.by_arm}
    columns, rows = tables["by_arm"].columns[1:], tables["by_arm"].rows
    shown = {(row["name"], c.heading): c.cell(row) for row in rows for c in columns}
    assert shown == cells
    check_report(STUDY, report)
    check_words(STUDY.words(report))


def judged(report, models):
    """The report of these models, its verdicts as the study computes them."""
    best, found, by_name = recommended(models), winners(models), {m.name: [m] for m in models}
    own = gains(by_name, DEFAULT, best, leaders(found))
    return replace(report, models=models, winners=found, recommended=best, gains=own)


def with_error(model, mm):
    return replace(model, workspace=replace(model.workspace, rms_mm=around(mm)))


def test_a_completion_that_exists_in_no_seed_has_no_row_beside_least_squares(report):
    name = "MLS56, PSD of equal fit"
    made = judged(report, [replace(m, conservative=m.conservative is True) for m in report.models])
    told = [m for m in made.models if m.name != name]
    check_table(STUDY.tables(made)["models"], made.models, MEANS, KNOWN)
    check_table(STUDY.tables(made)["short"], told, {t: p for t, p in MEANS.items() if t not in LONG})
    assert "No conservative model fits as well as least squares of MLS56" in more(made)
    assert "in 30 % of the seeds" in more(report)


def statements(report):
    return STUDY.words(report).block("statements")


def more(report):
    return STUDY.words(report).block("more")


@pytest.mark.parametrize("winner", ["Joints", "MLS32", "MGCO56", "MGCO56 + prior", "ALL153 + prior"])
def test_the_answer_names_each_method_with_its_own_error(report, winner):
    """Every model has an error of its own; the conservative one of least error is recommended."""
    sizes = {m.name: 20.0 + 10 * k for k, m in enumerate(report.models)} | {winner: 11.0}
    made = judged(report, [with_error(m, sizes[m.name]) for m in report.models])
    held = {m.name: sizes[m.name] for m in report.models if m.conservative is True}
    assert made.recommended == min(held, key=held.get)
    text, others = STUDY.words(made).block("answer"), statements(made)
    ours = sizes["ALL153 + prior"]
    size = sizes["MLS32"] / ours
    less = f"{ratio(size)} times less" if size > 1 else f"{ratio(1 / size)} times as much"
    assert text.startswith(
        f"True RMS error over the workspace: ALL153 + prior {ours:.3f} mm, "
        f"least squares {sizes['MLS32']:.3f} mm; {less}. "
        f"Joints alone {sizes['Joints']:.3f} mm, "
    )
    assert f"; GCO without prior {sizes['MGCO56']:.3f} mm, against least squares " in text
    if winner == "ALL153 + prior":
        assert "Take ALL153 + prior, marked: no other conservative model errs less" in others
    else:
        least = f"The least error of a conservative model is that of {made.recommended}: "
        assert f"{least}{ratio(ours / sizes[made.recommended])} times less." in others
    marks = {name: table.bold for name, table in STUDY.tables(made).items() if table.bold}
    assert set(marks.values()) == {"ALL153 + prior"}
    assert compared(sizes, least_squares="MLS32", take=made.take) == ["MLS32", "Joints", "ALL153 + prior"]


def test_of_models_alike_the_conservative_one_of_fewest_unknowns_is_recommended(report):
    same = [replace(with_error(m, 20.0), conservative=True, parameters=30) for m in report.models]
    fewest = [replace(m, parameters=9) if m.name == "Joints" else m for m in same]
    assert recommended(same) == "MGCO56"
    assert recommended(fewest) == "Joints"  # a baseline that is as good and simpler wins
    none = [replace(m, conservative=False) for m in same]
    made = replace(judged(report, none), take="", gains=gains({}, "", "", ("", "", "")))
    assert "none is recommended" in STUDY.words(made).block("answer")


def test_duels_count_the_seeds_by_true_errors_and_say_where_the_cone_does_nothing(rng):
    """Three seeds: workspace and check, true; against readings the order is the other way round."""
    sizes = {
        "Joints": ((3.0, 3.0), (3.0, 3.0), (3.0, 3.0)),
        "MGCO56": ((2.0, 1.0), (4.0, 1.0), (6.0, 9.0)),
        "MLS56 + prior": ((1.0, 1.0), (1.0, 1.0), (1.0, 1.0)),
        "MGCO56 + prior": ((1.0, 1.0), (1.0, 1.0), (1.0, 1.0)),
        "ALL153 + prior": ((1.5, 1.0), (1.5, 2.0), (2.0, 2.0)),
    }
    kept = [m for m in MODELS if m["name"] in sizes]
    arms = ("off_10", "off_10", "cast")
    rows = [[made(rng, m, sizes[m["name"]][k], arms[k]) for m in kept] for k in range(3)]
    asked = Settings("kr500_l480", Scenario(arm="kr500_l480"), 50.0)
    found = summary(asked, range(1, 4), list(enumerate(rows, 1)))
    duels = {(d.ours, d.theirs): d for d in found.duels}
    assert next(iter(duels)) == ("MGCO56 + prior", "Joints")
    against = duels["MGCO56", "Joints"]
    assert (against.workspace, against.check, against.alike, against.seeds) == (1, 2, 0, 3)
    assert against.ratio.median == pytest.approx(4 / 3)
    assert not against.cone
    cone = duels["MGCO56 + prior", "MLS56 + prior"]
    assert (cone.workspace, cone.alike, cone.cone) == (0, 3, True)
    text = more(found)
    assert "MGCO56 beats Joints over the workspace in 1 of 3 seeds, 1.33" in text
    assert "MGCO56 + prior and MLS56 + prior err alike in all 3 seeds: there the cone does nothing" in text
    assert (found.take, found.gains.joints.times.median) == ("ALL153 + prior", pytest.approx(2.0))
    assert (found.worst.true_arm_is, found.worst.take_mm) == ("cast links", 2.0)
    own = {(row.name, row.true_arm): (row.seeds, row.workspace_mm.median) for row in found.by_arm}
    assert own["MGCO56", "off_10"] == (2, 3.0)
    assert own["MGCO56", "cast"] == (1, 6.0)
    assert found.template_is_true is False
    assert set(found.check_best) == {"MGCO56", "MGCO56 + prior"}  # against readings it would be Joints


def made(rng, own, sizes, arm):
    area, check = sizes
    true = {"workspace": errors(rng, area), "check_true": errors(rng, check)}
    errors_of = true | {"check": errors(rng, 1 / check)}
    measured = of_one_trial(Measured, np.random.default_rng(1))  # the same in every seed
    return of_one_trial(
        ModelRow,
        rng,
        **own,
        **errors_of,
        measured=measured,
        true_arm=arm,
        template_is_true=arm == "tubes",
        parameters=56 if "56" in own["name"] else 6,
    )


def errors(rng, rms):
    return fill(ErrorRow, rng, rms_mm=rms)


def test_the_figure_draws_the_reports_numbers_in_the_colour_of_each_model(report):
    figure = STUDY.figures["models.png"](report)
    for axes, path in zip(figure.axes, PANELS, strict=True):
        assert unit_in(axes.get_xlabel()) == "mm"
        lines = axes.get_lines()
        for y, m in enumerate(report.models):
            own = [line for line in lines if np.ravel(line.get_ydata())[0] == y]
            spread, dot = own[0], own[1]
            value = at(m, path)
            assert tuple(spread.get_xdata()) == ends_of(value)
            assert np.ravel(dot.get_xdata())[0] == value.median
            shade = look(m.structure, m.constraint, m.prior).hex
            assert dot.get_color() == shade
            assert (dot.get_markerfacecolor() == shade) == m.prior
            head = f"{m.name}  " if path == PANELS[0] else ""
            assert axes.get_yticklabels()[y].get_text() == f"{head}{value.median:.3f}"


def test_errors_are_shown_in_millimetres_and_per_cent():
    row = error_row(Score(rms=1e-3, p95=2e-3, max=3e-3, p95_relative=0.04, max_relative=0.05))
    assert row == ErrorRow(1.0, 2.0, 3.0, 4.0, 5.0)
