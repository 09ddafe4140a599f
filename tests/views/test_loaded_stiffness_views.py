"""What people see of the study of Eq. (7) equals its report, for reports that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, check_words, unit_in
from made_up import fill, filled
from read_back import PLACED, chunks_of, document, plotted

from testbench.studies.loaded_stiffness import figure, recording
from testbench.studies.loaded_stiffness.study import STUDY
from testbench.studies.loaded_stiffness.summary import (
    NAMES,
    JointsRow,
    LoadedReport,
    LoadedRow,
    TangentRow,
    best,
)
from testbench.studies.loaded_stiffness.trial import Settings
from testbench.studies.study import Run
from testbench.views.colours import GCO, LEAST_SQUARES, NOMINAL, hexadecimal
from testbench.views.gains import ratio

LOADS = [1100.0, 4300.0, 9700.0]
TRUTHS = {"weightless": "-", "own weight": "--"}
METHODS = {
    "linear": ("Eq. (6)", hexadecimal(LEAST_SQUARES), "o"),
    "secant": ("Eq. (7) once", hexadecimal(NOMINAL), "s"),
    "integrated": ("Eq. (7) integrated", hexadecimal(GCO), "D"),
}
QUANTITIES = {
    "RMS error": "rms", "median error": "median", "5 % of errors": "p05", "95 % of errors": "p95",
    "largest error": "max",
}  # fmt: skip
EVERY = {
    "arm": "truth",
    "load, kN": "load_N",
    "method": "method",
    "deflection RMS, mm": "deflection_rms_mm",
    "RMS error, um": "rms_mm",
    "vertical RMS error, um": "vertical_rms_mm",
    **{f"{words}, um": f"{key}_mm" for words, key in list(QUANTITIES.items())[1:]},
    **{f"{words}, %": f"{key}_percent" for words, key in QUANTITIES.items()},
}
BESIDE = {"arm": "truth", "load, kN": "load_N", "deflection RMS, mm": "linear.deflection_rms_mm"} | {
    f"{words}, {unit}": f"{method}.rms_{key}"
    for method, (words, *_) in METHODS.items()
    for unit, key in (("um", "mm"), ("%", "percent"))
}
TANGENT = {"load, kN": "load_N", "largest difference, ppm": "max_relative_difference"}
EXACT = {"rms_mm": 4e-10, "rms_percent": 1e-8}


def judged(report):
    """The same with the verdict that follows from its numbers."""
    heaviest = {t: [r for r in report.rows if (r.load_N, r.truth) == (LOADS[-1], t)] for t in TRUTHS}
    return replace(report, best={truth: best(rows) for truth, rows in heaviest.items()})


def changed(report, truth, errors):
    """The same with other RMS errors of some methods under one truth [mm]."""
    rows = [
        replace(r, rms_mm=errors[r.method]) if r.truth == truth and r.method in errors else r
        for r in report.rows
    ]
    return judged(replace(report, rows=rows))


@pytest.fixture
def report(rng):
    cases = [{"load_N": n, "truth": t, "method": m} for n in LOADS for t in TRUTHS for m in METHODS]
    tangents = filled(TangentRow, rng, [{"load_N": n} for n in LOADS])
    made = fill(
        LoadedReport,
        rng,
        seed=3,
        loads_N=LOADS,
        methods={m: f"what {m} is" for m in METHODS},
        rows=filled(LoadedRow, rng, cases),
        tangent=tangents,
        joints=filled(JointsRow, rng, [{"truth": t} for t in TRUTHS]),
        best={},
    )
    return judged(made)


def row(report, load, truth, method):
    [found] = [r for r in report.rows if (r.load_N, r.truth, r.method) == (load, truth, method)]
    return found


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    check_table(tables["rows"], [r for t in TRUTHS for r in report.rows if r.truth == t], EVERY)
    beside = [
        {"truth": t, "load_N": n} | {m: row(report, n, t, m) for m in METHODS} for t in TRUTHS for n in LOADS
    ]
    check_table(tables["errors"], beside, BESIDE)
    check_table(tables["tangent"], report.tangent, TANGENT)
    small = [replace(r, rms_mm=r.rms_mm / 1e3, deflection_rms_mm=9.87) for r in report.rows]
    check_report(STUDY, replace(report, rows=small))
    check_words(STUDY.words(report))


def test_what_is_rounding_is_said_to_be_exact_and_never_shown_as_a_number(report):
    rows = [replace(r, **EXACT) if r.method == "integrated" else r for r in report.rows]
    made = judged(replace(report, rows=rows))
    words, errors = STUDY.words(made), STUDY.tables(made)["errors"]
    assert "Least error under 9.7 kN: Eq. (7) integrated, exact to rounding." in words.block("answer")
    assert "e-" not in words.whole()
    assert [c.cell(errors.rows[0]) for c in errors.columns[-2:]] == ["exact", "exact"]
    texts = [t.get_text() for t in figure.loaded_stiffness(made).axes[0].texts]
    assert "Eq. (7) integrated, weightless arm: exact to rounding" in texts


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("winner", METHODS)
def test_words_name_the_method_of_least_error_whichever_it_is(report, truth, winner):
    words = STUDY.words(changed(report, truth, {winner: 0.0123}))
    said = f"{METHODS[winner][0]}, 12.30 um RMS, "
    percent = f"{row(report, LOADS[-1], truth, winner).rms_percent:.2f} % of the deflection"
    if truth == "weightless":
        assert words.block("answer").startswith(f"Least error under 9.7 kN: {said}{percent}.")
    else:
        assert f"which no method knows: least error by {said}{percent}." in words.block("statements")
    for method, block in (("linear", "answer"), ("secant", "statements")):
        light = row(report, LOADS[-1], "weightless", method)
        if method != winner:
            assert f": {1000 * light.rms_mm:.2f} um RMS, {light.rms_percent:.2f} % of" in words.block(block)


@pytest.mark.parametrize(("over", "word"), [(15.3, "more"), (0.5, "less")])
def test_words_say_what_joints_alone_leave(report, over, word):
    made = replace(report, joints=[replace(row, over_linear=over) for row in report.joints])
    text = STUDY.words(made).block("statements")
    said = f"joints alone {1000 * made.joints[0].rms_mm:.0f} um, {ratio(over)} times that."
    assert said in STUDY.words(made).block("answer")
    for row in made.joints:
        assert f"{1000 * row.rms_mm:.0f} um RMS, {row.rms_percent:.1f} % ({row.truth})" in text
    assert f"{over:g} times what Eq. (6) loses: leaving out links costs {word} than" in text


def test_methods_of_the_same_error_are_alike(report):
    made = changed(report, "weightless", {"linear": 0.0101, "secant": 0.01})
    assert made.best["weightless"] == ("secant", "linear")
    assert "Eq. (7) once and Eq. (6) (alike), 10.00 um RMS" in STUDY.words(made).block("answer")
    assert changed(report, "weightless", {"linear": 1e-9, "secant": 3e-8}).best["weightless"] == (
        "linear",
        "secant",
    )


def test_the_figure_draws_the_reports_numbers_in_the_units_of_its_axes(report):
    [axes] = figure.loaded_stiffness(report).axes
    assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("kN", "um")
    legend = {t.get_text(): h for t, h in zip(*legend_of(axes), strict=True)}
    drawn = {
        (line.get_color(), line.get_linestyle()): line.get_data()
        for line in axes.get_lines()
        if len(line.get_xdata())
    }
    shares = {t.get_text() for t in axes.texts}
    for truth, style in TRUTHS.items():
        for method, (words, colour, mark) in METHODS.items():
            x, y = drawn.pop((colour, style))
            np.testing.assert_allclose(x, [n / 1e3 for n in LOADS])
            np.testing.assert_allclose(y, [1e3 * row(report, n, truth, method).rms_mm for n in LOADS])
            assert (legend[words].get_color(), legend[words].get_marker()) == (colour, mark)
            assert f"{row(report, LOADS[-1], truth, method).rms_percent:.2f} %" in shares
    assert not drawn
    assert legend["weightless arm"].get_linestyle() == "-"
    assert legend["arm that sags under its own weight"].get_linestyle() == "--"
    assert [t.get_text() for t in axes.get_xticklabels()] == ["1.1", "4.3", "9.7"]


def legend_of(axes):
    legend = axes.get_legend()
    return legend.get_texts(), legend.legend_handles


def test_the_recording_holds_the_reports_numbers_and_words(report, tmp_path):
    words = STUDY.words(report)
    run = Run(Settings(arm="kr500_l480"), range(3, 4), report, words, STUDY.tables(report), tmp_path, "{}")
    recording.write_recording(run)
    chunks = chunks_of(tmp_path / "recording.rrd")
    summary = document(chunks, "/summary")
    assert all(words.block(name) in summary for name in ("question", "answer", "statements"))
    drawn = plotted(chunks, "/error_of_the_tool_s_deflection_um")
    for truth in ("weightless", "own weight"):
        for method, name in NAMES.items():
            rows = [row(report, n, truth, method) for n in LOADS]
            expected = [[1e3 * getattr(r, f"{key}_mm") for key in ("median", "p05", "p95")] for r in rows]
            np.testing.assert_allclose(drawn[f"{name}, {truth}"], expected, rtol=PLACED)
