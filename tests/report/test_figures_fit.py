"""Figures of fits: their numbers are right, and every pane shows those of report.json and nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest
from legible import _contrast, check_legible
from matplotlib.colors import to_hex, to_rgb
from scipy.stats import kstest, norm

from testbench.data.dataset import line_precision, select_rows
from testbench.errors import BenchError
from testbench.identify.conic import LEVER_LENGTH
from testbench.identify.estimate import deflections_of_models, lilliefors_p_value
from testbench.identify.method import gco, least_squares, with_prior
from testbench.identify.posterior import posterior_of_estimate
from testbench.identify.prior import aggregate_left_out_joints, cad_prior
from testbench.model.structure import Structure, all153, template56
from testbench.model.vjm import add_law_deflections, evaluate_chain, generalised_load
from testbench.report.badge import ratios
from testbench.report.colours import LINK, NEGATIVE, NOMINAL, hexadecimal, look
from testbench.report.figure import row_head
from testbench.report.figures_fit import (
    AXES,
    compared,
    compliance_figure,
    eigenvalue_figure,
    fit_figure,
    model_figure,
    residual_figure,
)
from testbench.report.markdown import Markdown
from testbench.report.report import Report
from testbench.report.scene import ModelLine, PageContent, RunChart
from testbench.report.schema import Table, TableColumn
from testbench.report.table import plain, rows
from testbench.runs.rows import Row
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.fit_numbers import (
    fit_details,
    joint_functional,
    link_compliances,
    numbers_read,
    sag_by_part,
)
from testbench.workflows.model_names import in_words

TAKEN = "ALL153 + prior"
LOOKS = {
    "MLS56": look("MLS56", "none"),
    "MGCO56": look("MGCO56", "psd"),
    TAKEN: look("ALL153", "psd", prior=True),
}


@pytest.fixture(scope="module")
def fitted(kr500):
    """Runs of section 6 and three models of them."""
    runs = simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=2), 1).measured
    template, prior = template56(kr500.arm), cad_prior(kr500.arm)
    methods = {
        "MLS56": (least_squares, template),
        "MGCO56": (gco, template),
        TAKEN: (with_prior(gco, prior), all153(kr500.arm)),
    }
    estimates = {name: method(kr500.vjm, structure, runs) for name, (method, structure) in methods.items()}
    moved = deflections_of_models(kr500.vjm, [*estimates.values()], runs)
    left = {name: runs.deflection - own for name, own in zip(estimates, moved, strict=True)}
    return runs, estimates, left


@pytest.fixture(scope="module")
def details(kr500, fitted):
    """The same as figures have it, read from report.json."""
    runs, estimates, left = fitted
    found = fit_details(kr500.vjm, runs, estimates, left, cad_prior(kr500.arm), 0.3)
    return rows(json.loads(json.dumps(plain(found), allow_nan=False)))


@pytest.mark.study
@pytest.mark.parametrize(("n", "critical", "within"), [(20, 0.190, 0.004), (400, 0.886 / 20, 0.0012)])
def test_lilliefors_rejects_beyond_the_published_distance(n, critical, within):
    """Lilliefors 1967, table 1: 0.190 for 20 residuals at 5 %, 0.886 over the root of n for many."""
    rng = np.random.default_rng(8)
    samples = [3 + 2 * rng.standard_normal(n) for _ in range(100)]
    distance = np.array([kstest(x, norm(x.mean(), x.std(ddof=1)).cdf).statistic for x in samples])
    p = np.array([lilliefors_p_value(x) for x in samples])
    assert distance[p < 0.05].min() > critical - within
    assert distance[p >= 0.05].max() < critical + within
    assert (np.diff(p[np.argsort(distance)]) <= 0).all()


def test_lilliefors_tells_a_flat_distribution_and_refuses_what_is_none():
    assert lilliefors_p_value(np.linspace(-1, 1, 400)) < 0.01
    for wrong in (np.ones(9), np.arange(4.0)):
        with pytest.raises(BenchError, match="residuals"):
            lilliefors_p_value(wrong)


def test_eigenvalues_are_those_of_every_block_in_one_unit_and_signs_say_what_is_conservative(
    kr500, fitted, details
):
    arm, estimates = kr500.arm, fitted[1]
    s = np.array([LEVER_LENGTH] * 3 + [1.0] * 3)
    for name, estimate in estimates.items():
        parts = {row.part: row.urad_per_Nm for row in details.eigenvalues[name]}
        assert [*parts] == [part.name for part in (*arm.links, *arm.joints)]
        for k, link in enumerate(arm.links):
            block = estimate.C_theta[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
            own = np.sort(np.linalg.eigvals(1e6 * block / np.outer(s, s)).real)
            np.testing.assert_allclose(parts[link.name], own, rtol=1e-4, atol=1e-8 * (np.abs(own).max() or 1))
        springs = 1e6 * np.diag(estimate.C_theta)[6 * len(arm.links) : arm.n_theta]
        np.testing.assert_allclose([parts[joint.name][0] for joint in arm.joints], springs, rtol=1e-4)
        assert all(x >= 0 for own in parts.values() for x in own) == estimate.conservative
    assert not estimates["MLS56"].conservative


def test_the_parts_of_every_run_sum_to_its_whole_deflection(kr500, fitted):
    runs, estimates, _ = fitted
    for name in ("MLS56", TAKEN):
        one = sag_by_part(kr500.vjm, estimates[name], select_rows(runs, np.array([3])))
        assert sum(row.share_percent for row in one) == pytest.approx(100)
    where = evaluate_chain(kr500.vjm, runs.q[3:4])
    theta = (estimates["MLS56"].C_theta @ generalised_load(where, runs.wrench[3:4], runs.point[3:4])).T
    joint = one_by_difference(kr500, runs, add_law_deflections(kr500.vjm, theta))
    own = sag_by_part(kr500.vjm, estimates["MLS56"], select_rows(runs, np.array([3])))
    assert {row.part: row.share_percent for row in own}["link_2"] == pytest.approx(joint, rel=1e-3)


def one_by_difference(cell, runs, theta):
    """Share of link 2 in the deflection of the load, by moving the chain a little, per cent."""
    step, place = 1e-4, slice(12, 18)

    def at(turns):
        where = evaluate_chain(cell.vjm, runs.q[3:4], turns)
        return where.tool_position[0] + where.tool_rotation[0] @ runs.point[3]

    still = at(0 * theta)
    alone = np.zeros_like(theta)
    alone[:, place] = theta[:, place]
    whole, part = ((at(step * turns) - still) / step for turns in (theta, alone))
    return 100 * float(whole @ part / (whole @ whole))


def test_residuals_predictions_and_directions_count_every_reading(kr500, fitted, details):
    runs, estimates, left = fitted
    for row in details.residuals:
        own = 1e6 * left[row.name].ravel()
        assert (row.n, sum(row.counts)) == (own.size, own.size)
        assert (row.mean_um, row.deviation_um) == pytest.approx((own.mean(), own.std(ddof=1)))
        assert row.counts == np.histogram(own, row.edges_um)[0].tolist()
        assert row.edges_um[-1] == pytest.approx(np.abs(own).max())
    sizes = 1e3 * np.linalg.norm(runs.deflection, axis=-1).ravel()
    assert details.predictions.measured_mm == pytest.approx(sizes, rel=1e-4)
    predicted = 1e3 * np.linalg.norm(runs.deflection - left["MLS56"], axis=-1).ravel()
    assert details.predictions.predicted_mm["MLS56"] == pytest.approx(predicted, rel=1e-4)
    s = np.array(details.singular_values)
    assert (np.diff(s) <= 0).all()
    assert (s > 1e-9 * s[0]).sum() == estimates[TAKEN].compliance_regression.rank


def test_a_gauge_counts_as_one_residual_and_a_lost_target_as_none(fitted, rng):
    runs = select_rows(fitted[0], np.arange(4))
    direction, shape = np.zeros((4, 3, 3)), (4, 3)
    direction[:, 0] = [0.6, 0, 0.8]  # P1 has a gauge, P2 and P3 are read by a tracker, but P3 is lost once
    precision = np.tile(np.eye(3) / (2 * runs.sigma**2), (4, 3, 1, 1))
    precision[:, 0] = line_precision(direction, 5e-6)[:, 0]
    precision[2, 2] = 0
    data = replace(
        runs,
        line_direction=direction,
        precision=precision,
        line_direction_deviation=np.zeros(shape),
        line_length=np.zeros(shape),
    )
    along, vectors = rng.standard_normal(4), rng.standard_normal((4, 3, 3))
    vectors[:, 0] = along[:, None] * direction[:, 0]
    own = np.concatenate([along, np.delete(vectors[:, 1:].reshape(8, 3), 5, axis=0).ravel()])
    np.testing.assert_allclose(np.sort(numbers_read(data, vectors)), np.sort(own))


def test_a_joint_is_as_stiff_as_the_folder_says_before_and_its_interval_holds_the_truth_after(kr500, details):
    arm = kr500.arm
    for k, (row, joint) in enumerate(zip(details.joints, arm.joints, strict=True)):
        axis = kr500.vjm.joint_axes_in_beam_frame[k]
        compliance = joint.compliance + axis @ arm.links[k].compliance[3:, 3:] @ axis
        assert row.prior.middle == pytest.approx(1e-6 / compliance)
        assert row.prior.low < row.prior.middle < (row.prior.high or np.inf)
        assert (
            row.posterior.low < 1e-6 / compliance < (row.posterior.high or np.inf)
        )  # the truth is the folder
    width = {
        row.joint: row.posterior.high / row.posterior.low for row in details.joints if row.posterior.high
    }
    assert width["joint_3"] < 2.5  # the readings tell it
    assert "joint_1" not in width or width["joint_1"] > width["joint_3"]  # a weight does not turn joint 1


def test_a_joint_yields_with_the_link_before_it_about_an_axis_of_any_direction(slides, rng):
    arm, structure = slides.arm, all153(slides.arm)
    C = np.zeros((arm.n_theta,) * 2)
    for k in range(len(arm.links)):
        own = rng.standard_normal((6, 6))
        C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = own + own.T
    springs = np.arange(6 * len(arm.links), arm.n_theta)
    C[springs, springs] = rng.standard_normal(len(springs))
    for k, joint in enumerate(arm.joints):
        place = 6 * k + (0 if joint.prismatic else 3) + np.arange(3)
        axis = slides.vjm.joint_axes_in_beam_frame[k]
        expected = axis @ C[np.ix_(place, place)] @ axis + C[springs[k], springs[k]]
        assert joint_functional(slides.vjm, structure, k) @ structure.parameters_of(C) == pytest.approx(
            expected
        )


def link_block(vjm, C, k):
    """Block of a link in C, with the joint at its end."""
    structure = Structure.of(vjm.arm, links=[link.name for link in vjm.arm.links])
    return aggregate_left_out_joints(C, vjm, structure)[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]


@pytest.mark.parametrize("name", [TAKEN, "MLS56"])
def test_the_compliance_of_a_link_holds_its_joint_and_the_interval_is_that_of_each_entry(kr500, fitted, name):
    vjm, estimate = kr500.vjm, fitted[1][name]
    sag = sag_by_part(vjm, estimate, fitted[0])
    found = link_compliances(vjm, estimate, kr500.arm.C_theta, sag)
    share = {row.part: row.share_percent for row in sag}
    assert [row.part for row in found] == [link.name for link in kr500.arm.links]
    known = posterior_of_estimate(estimate)
    for k, row in enumerate(found):
        np.testing.assert_allclose(row.estimate, link_block(vjm, estimate.C_theta, k), rtol=6e-5, atol=1e-16)
        np.testing.assert_allclose(row.reference, link_block(vjm, kr500.arm.C_theta, k), rtol=6e-5)
        assert row.share_percent == pytest.approx(share[row.part] + share.get(row.joint, 0))
    one = found[2]  # its entries as functionals, by unit parameters
    units = np.eye(estimate.structure.n_parameters)
    rows_of = np.array([link_block(vjm, estimate.structure.C_theta_of(own), 2) for own in units])
    half = known.half_widths(rows_of.reshape(len(units), 36).T).reshape(6, 6)
    there = rows_of.any(axis=0)
    given = np.array(one.half, dtype=float)
    assert (np.isnan(given) == ~(there & np.isfinite(half))).all()
    np.testing.assert_allclose(given[np.isfinite(given)], half[np.isfinite(given)], rtol=6e-5)
    assert [row.joint for row in found] == [*(joint.name for joint in kr500.arm.joints), None]


def test_the_figure_of_compliances_has_the_numbers_of_the_link_that_bends_most_and_all_links_below(details):
    figure = compliance_figure(details.compliances, TAKEN, "true arm")
    figure.draw_without_rendering()
    check_legible(figure)
    most = max(details.compliances, key=lambda row: row.share_percent)
    assert most.part == "link_2"
    *panes, strip = figure.axes[:4]
    keys = {"reference": "true arm", "estimate": row_head(TAKEN), "half": "half width, 95 %"}
    for axes, (key, title) in zip(panes, keys.items(), strict=True):
        given = in_units(most, key)
        assert axes.get_title() == title
        assert [text.get_text() for text in axes.get_xticklabels()] == [*AXES]
        [image] = axes.images
        np.testing.assert_allclose(image.get_array().filled(np.nan), given)
        said = {tuple(map(round, text.get_position())): text.get_text() for text in axes.texts}
        assert said == {
            (j, i): f"{x:.2f}".replace("-", "−") if abs(x) >= 0.005 else "0"
            for (i, j), x in np.ndenumerate(given)
            if np.isfinite(x)
        }
        for text in axes.texts:  # white on dark cells alone
            j, i = map(round, text.get_position())
            cell = to_rgb(image.to_rgba(image.get_array()[i, j]))
            assert contrast(cell, to_rgb(text.get_color())) > 3
    assert [text.get_text() for text in panes[0].get_yticklabels()] == [*AXES]
    assert [text.get_text() for text in strip.get_xticklabels()] == [row.part for row in details.compliances]
    assert [text.get_text() for text in strip.get_yticklabels()] == [*keys.values()]
    assert len({axes.images[0].get_clim() for axes in panes}) == 1
    [image] = strip.images
    for k, row in enumerate(details.compliances):
        for j, key in enumerate(keys):
            own = np.ma.masked_invalid(in_units(row, key))
            part = image.get_array()[7 * j : 7 * j + 6, 7 * k : 7 * k + 6]
            np.testing.assert_allclose(part, panes[0].images[0].to_rgba(own))
    upper = np.triu_indices(6)
    wrong, half = (np.array(own, dtype=float)[upper] for own in (most.estimate, most.half))
    inside = np.abs(wrong - np.array(most.reference)[upper]) <= half
    told = f"{inside.sum()} of {np.isfinite(half).sum()} entries agree with the true arm"
    assert figure.get_suptitle().startswith(f"link_2 with joint_3: {told}")
    assert f"{most.share_percent:.0f} %" in figure.get_supxlabel()


def in_units(row, key):
    """A matrix of a link over the square roots of the reference's diagonal, (6, 6) [1]."""
    size = np.sqrt(np.diag(row.reference))
    return np.array(row[key], dtype=float) / np.outer(size, size)


def contrast(one, other):
    """Contrast of two colours, as WCAG has it [1]."""
    own = sorted((_contrast(one), _contrast(other)))
    return own[1] / own[0]


def test_the_figure_of_eigenvalues_draws_each_and_crosses_the_negative_ones_in_red(details):
    figure = eigenvalue_figure(details, LOOKS, [*LOOKS])
    figure.draw_without_rendering()
    check_legible(figure)
    for axes, name in zip(figure.axes, LOOKS, strict=True):
        given = [(y, x) for y, row in enumerate(details.eigenvalues[name]) for x in row.urad_per_Nm]
        red = hexadecimal(NEGATIVE)
        lines = [line for line in axes.get_lines() if line.get_linestyle() == "None"]
        crosses = [line for line in lines if (line.get_marker(), line.get_color()) == ("X", red)]
        others = [line for line in lines if line not in crosses]
        assert sorted(marks(crosses)) == sorted(pair for pair in given if pair[1] < 0)
        assert sorted(marks(others)) == sorted(pair for pair in given if pair[1] >= 0)
        assert {line.get_color() for line in others} == {LOOKS[name].hex}
        low, high = axes.get_xlim()
        assert all(low <= x <= high for _, x in given)
        bad = sum(x < 0 for _, x in given)
        told = f"{bad} of {len(given)} negative" if bad else "none negative"
        assert axes.get_title() == f"{row_head(name)}:\n{told}"
    assert len({axes.get_xlim() for axes in figure.axes}) == 1  # models compare on one scale
    assert figure.get_suptitle().startswith("Not conservative: least squares of beam links (")
    parts = [row.part for row in details.eigenvalues["MLS56"]]
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == parts


def marks(lines):
    return [(y, x) for line in lines for x, y in zip(*line.get_data(), strict=True)]


def test_the_figure_of_residuals_draws_both_histograms_their_normal_curves_and_predictions(details):
    figure = residual_figure(details, LOOKS, ("MGCO56", "MLS56"), ("MLS56", TAKEN))
    figure.draw_without_rendering()
    check_legible(figure)
    by_name = {row.name: row for row in details.residuals}
    for axes, name in zip(figure.axes, ("MGCO56", "MLS56"), strict=False):
        check_residuals(axes, by_name[name], LOOKS[name])
        low, high = axes.get_xlim()
        assert (low, high) == figure.axes[0].get_xlim()  # side by side one residual is as far from zero
        assert low < by_name[name].edges_um[0] < by_name[name].edges_um[-1] < high
    check_predictions(figure.axes[-1], details.predictions, ("MLS56", TAKEN))
    title = " ".join(figure.get_suptitle().split())
    for name in ("MGCO56", "MLS56"):
        assert (in_words(name) in title) == (by_name[name].lilliefors_p >= 0.05)


def check_residuals(axes, row, look):
    """Bars, the normal curve and words of a histogram."""
    bars, _ = axes.patches
    np.testing.assert_array_equal(bars.get_data().values, row.counts)
    np.testing.assert_allclose(bars.get_data().edges, row.edges_um)
    assert to_hex(bars.get_facecolor()).upper() == look.hex
    [curve] = axes.get_lines()
    x, y = curve.get_data()
    area = row.n * (row.edges_um[1] - row.edges_um[0])
    np.testing.assert_allclose(y, area * norm(row.mean_um, row.deviation_um).pdf(x))
    assert axes.get_xlabel() == "residual [µm]"
    assert axes.get_ylim()[1] > max(*row.counts, *y)
    said = axes.texts[0].get_text()
    assert f"n {row.n}," in said
    assert f"deviation {row.deviation_um:.0f} µm" in said
    assert ("not normal" in said) == (row.lilliefors_p < 0.05)


def check_predictions(axes, found, names):
    """Dots of every model against what was measured."""
    *dots, line = axes.get_lines()
    for own, name in zip(dots, names, strict=True):
        assert own.get_label() == in_words(name).removeprefix("the ")
        np.testing.assert_array_equal(own.get_xdata(), found.measured_mm)
        np.testing.assert_array_equal(own.get_ydata(), found.predicted_mm[name])
    np.testing.assert_array_equal(*line.get_data())
    assert axes.get_xlabel().endswith(" deflection [mm]")
    assert axes.get_ylabel() == "predicted [mm]"


@pytest.fixture(scope="module")
def f(details):
    """Numbers of `identify`."""
    models = [
        Row(
            name=n,
            structure=n.split()[0],
            constraint="none" if n == "MLS56" else "psd",
            prior=n == TAKEN,
            rms=k,
        )
        for k, n in enumerate(LOOKS, 1)
    ]
    rng = np.random.default_rng(2)
    errors = {name: rng.uniform(1, 2, 8) * k for name, k in zip(LOOKS, (3, 2, 1), strict=True)}
    over = ratios(TAKEN, {name: (errors[TAKEN], own, None) for name, own in errors.items() if name != TAKEN})
    blocks = [Row(part=row.part, told_percent=5.0 * k) for k, row in enumerate(details.sag)]
    return Row(
        models=models, recommended=TAKEN, details=details, over=over, seen=Row(blocks=blocks), errors=errors
    )


@pytest.mark.study
def test_the_figure_of_a_fit_has_models_ratios_with_intervals_residuals_and_runs(f):
    name, rms = TableColumn("name", "model"), TableColumn("rms", "RMS", "mm")
    own = [ModelLine(TAKEN, LOOKS[TAKEN], np.array([0.1, 0.3, 0.2]))]
    seen = PageContent(
        runs=[RunChart("Left (mm)", 0, "run", "abc", own)], tables=[Table((name, rms), f.models, bold=TAKEN)]
    )
    figure = fit_figure(report(), seen, f, LOOKS)
    figure.draw_without_rendering()
    check_legible(figure)
    forest, ratio, *others, runs = figure.axes
    order = [TAKEN, "MLS56", "MGCO56"]
    heads = [text.get_text().rsplit("  ", 1)[0] for text in forest.get_yticklabels()]
    assert heads == [row_head(name) for name in order]
    by_name = {row.name: row.ratio for row in f.over}
    dots = [line for line in ratio.get_lines() if line.get_marker() not in ("None", None)]
    middles = [float(np.ravel(line.get_xdata())[0]) for line in dots]
    assert middles == pytest.approx([getattr(by_name[name], "median", by_name[name]) for name in order])
    spans = [tuple(line.get_xdata()) for line in ratio.get_lines() if len(set(line.get_ydata())) == 1]
    for name in ("MLS56", "MGCO56"):
        assert (by_name[name].p05, by_name[name].p95) in spans
        assert by_name[name].p05 <= np.median(f.errors[name] / f.errors[TAKEN]) <= by_name[name].p95
    by_name = {row.name: row for row in f.details.residuals}
    for axes, model in zip(others, compared(f), strict=False):
        check_residuals(axes, by_name[model], LOOKS[model])
    check_predictions(others[-1], f.details.predictions, compared(f))
    assert runs.get_lines()[0].get_ydata() == pytest.approx([0.1, 0.3, 0.2])


def report():
    words = {name: Markdown("One. Two.") for name in ("question", "title", "answer")}
    return Report(scenario="identify", numbers={}, tables={}, body=[], **words)


@pytest.mark.study
def test_the_figure_of_a_model_has_eigenvalues_sag_stiffness_and_what_the_runs_tell(f):
    proposals = [Row(place=k, measure=f"way {k}", rank=9, expected_error_mm=0.1 * k) for k in (1, 2, 3)]
    assert len(model_figure(f, LOOKS).axes) == 6
    figure = model_figure(Row(f, identifiability=Row(help=proposals)), LOOKS)
    figure.draw_without_rendering()
    check_legible(figure)
    first, second, sag, stiff, told, parts, last = figure.axes
    heads = [axes.get_title().split(":")[0] for axes in (first, second)]
    assert heads == [row_head(name) for name in ("MLS56", TAKEN)]
    assert [axes.get_xlabel() for axes in (first, sag, stiff, parts, last)] == [
        "eigenvalue [µrad/(N m)]",
        "share of the load's deflection [%]",
        f"stiffness [{f.details.joints[0].unit}]",
        "prior variance removed [%]",
        "expected error at random poses [mm]",
    ]
    check_bars(sag, [row.part for row in f.details.sag], [row.share_percent for row in f.details.sag])
    check_bars(parts, [row.part for row in f.seen.blocks], [row.told_percent for row in f.seen.blocks])
    check_bars(last, ["way 1", "way 2", "way 3"], [0.1, 0.2, 0.3])
    assert [text.get_text() for text in last.texts] == [" 0.100 mm", " 0.200 mm", " 0.300 mm"]
    colours = {"link": hexadecimal(LINK), "joint": hexadecimal(NOMINAL)}
    for bar, row in zip(sag.patches, f.details.sag, strict=True):
        assert to_hex(bar.get_facecolor()).upper() == colours[row.part.partition("_")[0]]
    [whiskers] = [own.get_segments() for own in sag.collections]
    assert [tuple(ends[:, 0]) for ends in whiskers] == [
        (row.least_percent, row.most_percent) for row in f.details.sag
    ]
    shares = [row.share_percent for row in f.details.sag]
    assert shares == sorted(shares, reverse=True)
    assert [text.get_text() for text in sag.texts] == [f"{share:.0f} %" for share in shares]
    said = f"{in_words(TAKEN)} is conservative; {f.details.sag[0].part} causes {shares[0]:.0f} %"
    assert " ".join(figure.get_suptitle().split()).casefold().startswith(said.casefold())
    assert [line.get_label() for line in stiff.get_lines()] == ["the arm's folder, ±30 %", "identified"]
    for line, spans, key in zip(stiff.get_lines(), stiff.collections, ("prior", "posterior"), strict=True):
        every = [row[key] for row in f.details.joints]
        assert line.get_xdata() == pytest.approx([own.middle for own in every])
        for (x, y), own, (low, high) in zip(line.get_xydata(), every, spans.get_segments(), strict=True):
            assert low[1] == high[1] == y
            assert low[0] == pytest.approx(own.low) if own.low else low[0] < x
            assert high[0] == pytest.approx(own.high) if own.high else high[0] > x
    assert [text.get_text() for text in stiff.get_yticklabels()] == [row.joint for row in f.details.joints]
    dots, _ = told.get_lines()
    np.testing.assert_allclose(dots.get_ydata(), np.maximum(f.details.singular_values, 1e-4))
    decided = sum(x > 1 for x in f.details.singular_values)
    assert told.get_title() == f"Readings determine {decided} of 153 directions"


def check_bars(axes, names, widths):
    """Bars of these widths, each beside its name."""
    named = dict(zip(axes.get_yticks(), [text.get_text() for text in axes.get_yticklabels()], strict=True))
    assert [named[bar.get_y() + bar.get_height() / 2] for bar in axes.patches] == names
    assert [bar.get_width() for bar in axes.patches] == pytest.approx(widths)
