"""What people see of section 5.1 equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, check_words, unit_in
from made_up import around, fill, filled, single
from read_back import PLACED, chunks_of, columns, document, picture, plotted

from testbench.studies.single_link import figure, recording
from testbench.studies.single_link.order import Order, which_m
from testbench.studies.single_link.pinning import Expected, Pinning
from testbench.studies.single_link.printed import Matrix, OwnData, OwnOrder, PrintedMatrices, SymmetricMatrix
from testbench.studies.single_link.report import LinkModel, LinkReport, Paired, Printed
from testbench.studies.single_link.study import STUDY
from testbench.studies.single_link.summary import worst
from testbench.studies.single_link.trial import Settings
from testbench.studies.single_link.verdict import claims
from testbench.studies.study import Run
from testbench.trials.spread import ends, middle, triple
from testbench.views.colours import GCO, LEAST_SQUARES, hexadecimal
from testbench.views.markdown import grid
from testbench.views.recording.compliance import colours
from testbench.views.recording.pen import snake
from testbench.views.recording.plane import SMALLEST
from testbench.views.schema import best_of

NAMES = {"MLS36": "none", "MLS21": "none", "MGCO21": "psd"}
SHAPE = {
    "model": "name",
    "conservative": "conservative",
    "symmetric": "symmetric",
    "eigenvalue below 0": "negative_eigenvalue_matrix",
    "of symmetric part below 0": "negative_eigenvalue",
    "smallest eigenvalue, 10^-6 SI": "min_eigenvalue_matrix",
    "smallest of symmetric part, 10^-6 SI": "min_eigenvalue",
    "F_M": "f_m",
    "floor": "f_m_floor",
}
ERRORS = {
    "model": "name",
    "position error, um": "prediction.position_rms_um",
    "of the deflection, %": "prediction.position_relative_percent",
    "rotation error, urad": "prediction.rotation_rms_urad",
    "of the rotation, %": "prediction.rotation_relative_percent",
    "C force-position, um/N": "entries.translation_rms_um_per_N",
    "C moment-position, um/(N m)": "entries.coupling_translation_rms_um_per_Nm",
    "C force-rotation, urad/N": "entries.coupling_rotation_rms_urad_per_N",
    "C moment-rotation, urad/(N m)": "entries.rotation_rms_urad_per_Nm",
}
ORDERS = {
    "m": "m",
    "F_M": "f_m",
    "F_M above the optimum, %": "excess_percent",
    "reaches the optimum": "reaches_optimum",
    "position error, um": "prediction.position_rms_um",
    "rotation error, urad": "prediction.rotation_rms_urad",
}
OWN = {
    "m": "m",
    "F_M on the paper's data": "f_m",
    "RMS distance to Eq. (23), sigma/load": "rms_to_eq_23_over_sigma",
}
WINS = {
    "position error": "position_rms_um",
    "rotation error": "rotation_rms_urad",
    "C force-position": "translation_rms_um_per_N",
    "C moment-position": "coupling_translation_rms_um_per_Nm",
    "C force-rotation": "coupling_rotation_rms_urad_per_N",
    "C moment-rotation": "rotation_rms_urad_per_Nm",
}


def matrix(rng):
    return (1e-6 * rng.uniform(-99, 99, (6, 6))).tolist()


def values(rng):
    return sorted((1e-6 * rng.uniform(-99, 99, 6)).tolist())


def small(rng):
    return around(1e-6 * float(rng.uniform(11, 99)))


def models(rng):
    """Three models; least squares and GCO have a printed matrix."""
    found = []
    for name, constraint in NAMES.items():
        eigen = {key: -1e-6 * rng.uniform(2, 9) for key in ("min_eigenvalue", "min_eigenvalue_matrix")}
        flags = {f"negative_{key.removeprefix('min_')}": bool(rng.integers(2)) for key in eigen}
        paper = single(fill(Printed, rng, **eigen, **flags, symmetric=bool(rng.integers(2))))
        paper = None if name == "MLS21" else paper
        found.append(
            fill(
                LinkModel,
                rng,
                name=name,
                structure=name,
                constraint=constraint,
                min_eigenvalue=small(rng),
                min_eigenvalue_matrix=small(rng),
                rank_of_C={"5": 3, "6": 4},
                entry_rms=matrix(rng),
                entry_bias=matrix(rng),
                min_eigenvalues=(1e-6 * rng.uniform(-9, 9, 40)).tolist(),
                paper=paper,
            )
        )
    return found


def printed(rng):
    own = fill(
        OwnData,
        rng,
        order=filled(OwnOrder, rng, [{"m": m} for m in range(1, 7)]),
        optimum_matrix=matrix(rng),
        optimum_eigenvalues=values(rng),
    )
    shares = {f"if_sigma_is_of_a_{what}": fill(Expected, rng) for what in ("deflection", "reading")}
    return fill(
        PrintedMatrices,
        rng,
        pinning=fill(Pinning, rng, negative_eigenvalue_expected=shares),
        eq_22=Matrix(matrix(rng), values(rng), values(rng)),
        eq_23=SymmetricMatrix(matrix(rng), values(rng)),
        eq_23_from_the_data_of_eq_22=own,
    )


def judged(report):
    """The same with the verdicts that follow from its numbers."""
    errors = {m.name: m.prediction for m in report.models}
    made = replace(
        report,
        best_position=best_of({n: e.position_rms_um for n, e in errors.items()}).names,
        best_rotation=best_of({n: e.rotation_rms_urad for n, e in errors.items()}).names,
        which_m=which_m(report.order, report.order_range, report.order_draws),
    )
    return replace(made, claims=claims(made))


@pytest.fixture
def report(rng):
    rows = [{"m": m, "name": "MGCO21", "eigenvalues": [small(rng) for _ in range(6)]} for m in range(1, 7)]
    paired = {
        name: Paired(99, {key: int(rng.integers(10, 99)) for key in WINS.values()})
        for name in ("MLS36", "MLS21")
    }
    made = fill(
        LinkReport,
        rng,
        draws=99,
        models=models(rng),
        paired=paired,
        order=filled(Order, rng, rows, reaches_optimum=0.25, rank_of_C={"5": 3}),
        order_range=(3.5, 6.0),
        eq_22_23=printed(rng),
        first_draw={name: Matrix(matrix(rng), values(rng), values(rng)) for name in NAMES},
        truth_matrix=np.diag(np.abs(values(rng))).tolist(),
        claims=[],
    )
    return judged(made)


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else judged(single(report))
    tables = STUDY.tables(report)
    known = {title: f"paper.{path}" for title, path in (SHAPE | ERRORS).items() if path != "f_m_floor"}
    del known["model"]
    check_table(tables["shape"], report.models, SHAPE, {t: p for t, p in known.items() if t in SHAPE})
    check_table(tables["errors"], report.models, ERRORS, {t: p for t, p in known.items() if t in ERRORS})
    check_table(tables["order"], report.order, ORDERS)
    check_table(tables["own"], report.eq_22_23.eq_23_from_the_data_of_eq_22.order, OWN)
    wins = [
        {"name": words} | {name: pair.gco_better[key] for name, pair in report.paired.items()}
        for words, key in WINS.items()
    ]
    means = {"draws in which MGCO21 is closer to the truth": "name"}
    check_table(tables["paired"], wins, means | {f"than {n}": n for n in ("MLS36", "MLS21")})
    check_report(STUDY, report)
    check_words(STUDY.words(report))


def test_matrices_and_eigenvalues_are_those_of_their_title(report):
    tables, own = STUDY.tables(report), report.eq_22_23.eq_23_from_the_data_of_eq_22
    found = {
        "truth, Eq. (21)": report.truth_matrix,
        **{f"{name}, first draw": C.matrix for name, C in report.first_draw.items()},
        "LS, Eq. (22)": report.eq_22_23.eq_22.matrix,
        "GCO, Eq. (23)": report.eq_22_23.eq_23.matrix,
        "optimum of the paper's data": own.optimum_matrix,
    }
    axes = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
    for title, C in found.items():
        text = grid(tables[f"matrix {title}"])
        assert text.startswith(f"| {title}, 10^-6 SI | {' | '.join(axes)} |")
        for axis, row in zip(axes, C, strict=True):
            assert f"| {axis} | {' | '.join(f'{1e6 * x:.3f}' for x in row)} |" in text
    eigen = {
        "MLS36, first draw": report.first_draw["MLS36"].eigenvalues_matrix,
        "MGCO21, first draw, symmetric part": report.first_draw["MGCO21"].eigenvalues_symmetric_part,
        "LS, Eq. (22)": report.eq_22_23.eq_22.eigenvalues_matrix,
        "LS, Eq. (22), symmetric part": report.eq_22_23.eq_22.eigenvalues_symmetric_part,
        "GCO, Eq. (23)": report.eq_22_23.eq_23.eigenvalues,
        "optimum of the paper's data": own.optimum_eigenvalues,
    }
    for title, row in eigen.items():
        assert f"| {title} | {' | '.join(f'{1e6 * x:.3f}' for x in row)} |" in grid(tables["eigenvalues"])
    for row in report.order:
        shown = " | ".join(f"{1e6 * v.median:.3f}" for v in row.eigenvalues)
        assert f"| m = {row.m} | {shown} |" in grid(tables["spectra"])


def with_error(report, name, **errors):
    found = [
        replace(m, prediction=replace(m.prediction, **errors)) if m.name == name else m for m in report.models
    ]
    return judged(replace(report, models=found))


@pytest.mark.parametrize("winner", NAMES)
def test_words_name_the_best_whichever_it_is_and_never_exchange_the_methods(report, winner):
    made = with_error(report, winner, position_rms_um=around(2.34), rotation_rms_urad=around(3.0))
    words, by_name = STUDY.words(made), {m.name: m for m in made.models}
    ls, ours = by_name["MLS36"], by_name["MGCO21"]
    answer, statements, more = (words.block(name) for name in ("answer", "statements", "more"))
    assert answer.startswith(
        f"Position error: GCO {ours.prediction.position_rms_um.median:.1f} um, "
        f"least squares {ls.prediction.position_rms_um.median:.1f} um; "
    )
    assert answer.endswith(
        f"Conservative in {100 * ours.conservative:.4g} % of 99 draws with GCO, in "
        f"{100 * ls.conservative:.4g} % with least squares of 36 free entries, in "
        f"{100 * by_name['MLS21'].conservative:.4g} % of 21 symmetric ones."
    )
    assert f"Least position error: {winner}." in more
    assert f"Least rotation error: {winner}." in more
    assert f"symmetric in {100 * ls.symmetric:.4g} % of the draws" in statements
    assert f"negative eigenvalue in {100 * ls.negative_eigenvalue_matrix:.4g} %" in statements
    better = made.paired["MLS36"].gco_better
    assert f"better than least squares in {better['position_rms_um']} of 99 draws" in more
    assert f"rotations in {better['rotation_rms_urad']}." in more
    middle_one = by_name["MLS21"]
    assert f"(MLS21) errs {middle_one.prediction.position_rms_um.median:.1f} um: " in statements
    assert (
        f"MLS21, is conservative in "
        f"{100 * middle_one.conservative:.4g} %. GCO beats it in "
        f"{made.paired['MLS21'].gco_better['position_rms_um']} draws"
    ) in more


def test_models_of_the_same_error_are_alike(report):
    made = with_error(report, "MLS21", position_rms_um=2.02)
    made = with_error(made, "MGCO21", position_rms_um=2.0)
    assert "Least position error: MGCO21 and MLS21 (alike)." in STUDY.words(made).block("more")


def test_the_worst_entry_is_that_of_the_largest_error_over_its_true_value(report):
    true = np.diag([2e-6, 4e-6, 4e-6, 4e-6, 8e-6, 4e-6])
    errors = {"MGCO21": np.diag([1e-6] * 4 + [6e-6, 1e-6]), "MLS36": np.diag([3e-6] * 4 + [7e-6, 1e-6])}
    by_name = {m.name: m for m in report.models}
    ours, theirs = (replace(by_name[n], entry_rms=C.tolist()) for n, C in errors.items())
    found = worst(true, ours, theirs)
    assert (found.name, found.unit) == ("c55", "urad/(N m)")
    assert (found.true, found.gco, found.least_squares) == pytest.approx((8.0, 6.0, 7.0))


def verdicts(report):
    return [claim.verdict == "confirmed" for claim in judged(report).claims]


def test_claims_follow_the_numbers(report):
    shares = {"MLS36": 0.0, "MLS21": 0.5, "MGCO21": 1.0}
    found = [replace(m, conservative=shares[m.name]) for m in report.models]
    made = replace(report, models=found, paired=better_in(MLS36=95, MLS21=94))
    assert verdicts(made)[:5] == [True, True, False, True, False]
    assert verdicts(replace(made, paired=better_in(MLS36=94, MLS21=95)))[3:5] == [False, True]
    found = [replace(m, conservative=0.99 if m.name == "MGCO21" else 0.01) for m in report.models]
    assert verdicts(replace(report, models=found))[:2] == [False, False]


def better_in(**draws):
    """GCO's position error is the smaller one in so many of 100 draws."""
    return {name: Paired(100, dict.fromkeys(WINS.values(), n)) for name, n in draws.items()}


@pytest.mark.parametrize(("optimum", "holds"), [(2.0, False), (2.8, True)])
def test_eq_23_is_the_optimum_only_if_its_rounding_reaches_it(report, optimum, holds):
    own = replace(
        report.eq_22_23.eq_23_from_the_data_of_eq_22,
        printed_f_m=2.9,
        printed_f_m_within_rounding=[2.8, 3.0],
        optimum_f_m=optimum,
        optimum_f_m_excess_bound=1e-5,
    )
    made = replace(report, eq_22_23=replace(report.eq_22_23, eq_23_from_the_data_of_eq_22=own))
    assert verdicts(made)[5] == holds
    said = "- Not confirmed: Eq. (23) has the least F_M" in STUDY.words(judged(made)).block("more")
    assert said != holds


@pytest.mark.parametrize("least", [4, 5, 6, None])
def test_the_order_to_take_is_the_least_that_always_reaches_the_optimum(report, least):
    order = [replace(r, reaches_optimum=1.0 if least and r.m >= least else 0.25) for r in report.order]
    made = judged(replace(report, order=order))
    text = made.which_m
    assert text in STUDY.words(made).block("more")
    draws = made.order_draws
    if least is None:
        assert text.startswith(f"No order m reaches the certified optimum of F_M in all {draws} draws.")
    else:
        assert text.startswith(
            f"Take m = {least}, the least that reaches the certified optimum of F_M in all {draws}"
        )
    for row in order[3:]:
        low, high = ends(row.excess_percent)
        error = middle(row.prediction.position_rms_um)
        said = f"m = {row.m} reaches it in 25 %: F_M is {low:.0f} to {high:.0f} % above it, position "
        said += f"error {error:.1f} um"
        assert (said in text) == (row.reaches_optimum < 1)
    assert verdicts(made)[6] == (least == 4)


def test_the_figure_draws_the_reports_numbers_in_the_units_of_its_axes(report):
    left, cost, error = figure.single_link(report).axes
    ls, _, ours = report.models
    orange, green = hexadecimal(LEAST_SQUARES), hexadecimal(GCO)
    assert "[10\u207b\u2076 SI]" in left.get_xlabel()
    inside = [1e6 * x for x in ls.min_eigenvalues]
    [bars, *_] = left.containers
    width = bars[0].get_width()
    weight = sum(b.get_height() * (b.get_x() + width / 2) for b in bars)
    assert sum(b.get_height() for b in bars) == 40
    assert hexadecimal([round(255 * c) for c in bars[0].get_facecolor()[:3]]) == orange
    assert abs(weight - sum(inside)) < 40 * width / 2  # a draw is at most half a bin from its bin's middle
    texts = [t.get_text() for t in left.get_legend().get_texts()]
    assert texts[0] == f"least squares, MLS36: below zero in {100 * ls.negative_eigenvalue_matrix:.4g} %"
    assert texts[1] == f"GCO, MGCO21: below zero in {100 * ours.negative_eigenvalue_matrix:.4g} %"
    assert f"Eq. (22): {1e6 * ls.paper.min_eigenvalue_matrix:.2f} " in left.texts[0].get_text()
    [line] = [x for x in left.get_lines() if x.get_linestyle() == "--"]
    assert line.get_xdata()[0] == pytest.approx(1e6 * ls.paper.min_eigenvalue_matrix)
    for axes, numbers in (
        (cost, [row.f_m for row in report.order]),
        (error, [row.prediction.position_rms_um for row in report.order]),
    ):
        [drawn] = [x for x in axes.get_lines() if x.get_label() == "MGCO21"]
        assert drawn.get_color() == green
        np.testing.assert_allclose(drawn.get_data(), ([1, 2, 3, 4, 5, 6], [v.median for v in numbers]))
    assert unit_in(error.get_ylabel()) == "um"
    [level] = [x for x in error.get_lines() if x.get_label() == "MLS36"]
    assert (level.get_ydata()[0], level.get_color()) == (ls.prediction.position_rms_um.median, orange)


def test_the_recording_holds_the_reports_numbers_and_words(report, tmp_path):
    words, tables = STUDY.words(report), STUDY.tables(report)
    run = Run(Settings(), range(1, 100), report, words, tables, tmp_path, "{}")
    recording.write_recording(run, tmp_path / "recording.rrd")
    chunks = chunks_of(tmp_path / "recording.rrd")
    summary = document(chunks, "/summary")
    assert all(words.block(name) in summary for name in ("question", "answer", "statements", "pictures"))
    means = {t: SHAPE[t] for t in ("model", "conservative", "symmetric", "eigenvalue below 0")}
    means |= {t: ERRORS[t] for t in ("position error, um", "rotation error, urad")}
    known = {title: f"paper.{path}" for title, path in means.items() if path != "name"}
    check_table(tables["recorded"], report.models, means, known)
    assert grid(tables["recorded"]) in summary
    assert grid(tables["eigenvalues"]) in document(chunks, "/eigenvalue")
    for what, unit, key in (("position", "um", "position_rms_um"), ("rotation", "urad", "rotation_rms_urad")):
        shown = columns(chunks, f"/error_{unit}/{what}_error/number")["Points2D:labels"][0]
        names = columns(chunks, f"/error_{unit}/{what}_error/name")["Points2D:labels"][0]
        assert names == list(NAMES)
        for text, model in zip(shown, report.models, strict=True):
            assert text.split()[0] == f"{getattr(model.prediction, key).median:.{1 if unit == 'um' else 0}f}"
            assert text.endswith(f") {unit}")
    for root, numbers in (
        ("f_m_above_the_optimum_percent", [row.excess_percent for row in report.order]),
        ("position_error_um", [row.prediction.position_rms_um for row in report.order]),
    ):
        expected = np.maximum([triple(v) for v in numbers], SMALLEST)
        np.testing.assert_allclose(plotted(chunks, f"/{root}")["MGCO21"], expected, rtol=PLACED)
    C, true = np.array(report.first_draw["MGCO21"].matrix), np.diag(report.truth_matrix)
    shown = picture(chunks, f"/compliance/{snake('MGCO21, first draw')}/cells")
    np.testing.assert_array_equal(shown, colours(C / np.sqrt(np.outer(true, true))))
