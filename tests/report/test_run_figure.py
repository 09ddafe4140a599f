"""The picture of a run holds the numbers and places that its page draws."""

import re
from dataclasses import replace

import numpy as np
import pytest
from legible import check_legible
from made_up_run import REPORT, made_up_run
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image
from reports import check_forest

from testbench.plant.shapes import hull_points, visual_shapes
from testbench.report import figure as figures
from testbench.report.colours import SCALE, hexadecimal, look
from testbench.report.figure import SOFT, forest, headed, labelled, log_ticks, page, say, sweeps
from testbench.report.run_figure import headline, outlines, overview
from testbench.report.scene import loads, scale_of
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row
from testbench.runs.interrupt import EMPTY_SESSION, session
from testbench.runs.spread import spread


@pytest.fixture(scope="module")
def seen(arm_6r):
    return made_up_run(arm_6r)


@pytest.fixture(scope="module")
def figure(seen):
    return overview(REPORT, seen)


@pytest.mark.parametrize(("pane", "plane"), [(0, [0, 2]), (1, [0, 1])])
def test_the_first_pose_is_drawn_from_aside_and_from_above(figure, seen, pane, plane):
    axes, own = figure.axes[pane], seen.scene.groups[0]
    k, (dots, arrows, path, _) = own.first, own.layers
    assert (axes.get_xlabel(), axes.get_ylabel()) == tuple(f"{'xyz'[i]} [m]" for i in plane)
    lines = [np.column_stack(line.get_data()) for line in axes.get_lines()]
    segments = [
        at for many in axes.collections if isinstance(many, LineCollection) for at in many.get_segments()
    ]
    solids = [many for many in axes.collections if isinstance(many, PolyCollection)]
    for frames, drawn in zip((own.rigid, own.bent), solids, strict=True):
        polygons, _ = outlines(seen.scene.cell, frames, k, np.eye(3)[plane])
        paths = [path.vertices[:-1] for path in drawn.get_paths()]
        assert len(paths) == len(polygons) > 5
        assert all(np.allclose(a, b) for a, b in zip(paths, polygons, strict=True))
    assert any(at.shape == (3, 2) and np.allclose(at, dots.at[k][:, plane], equal_nan=True) for at in lines)
    for j in range(3):
        ends = np.stack([arrows.at[k, j, plane], arrows.to[k, j, plane]])
        assert np.isnan(ends).any() or any(np.allclose(at, ends) for at in segments), j
    still = np.stack([path.at[0, 0, plane], path.to[0, 0, plane]])
    assert any(np.allclose(at, still) for at in segments)
    assert axes.get_title().startswith(own.names[k])


@pytest.mark.parametrize("plane", [[0, 2], [0, 1], [1, 2]])
def test_the_arm_is_drawn_where_its_solids_are_and_not_mirrored(seen, plane):
    cell, frames = seen.scene.cell, seen.scene.groups[0].rigid
    roles = {cell.room.body_names.index(name) for name in (cell.arm.load_point, *cell.arm.markers)}
    solids = [
        frames.positions[0, shape.body] + hull_points(shape) @ frames.rotations[0, shape.body].T
        for shape in visual_shapes(cell.room)
        if shape.body not in roles
    ]
    polygons, _ = outlines(cell, frames, 0, np.eye(3)[plane])
    drawn, every = np.vstack(polygons), np.vstack(solids)[:, plane]
    np.testing.assert_allclose(drawn.min(axis=0), every.min(axis=0))
    np.testing.assert_allclose(drawn.max(axis=0), every.max(axis=0))
    assert abs(every.min(axis=0)[0] + every.max(axis=0)[0]) > 0.01  # else a mirrored one has the same ends


def test_a_weight_hangs_below_its_hook_in_both_views(seen):
    own = seen.scene.groups[0]
    hook = np.random.default_rng(2).uniform(0.5, 1.5, (len(own.names), 3))
    [weight] = loads(hook, np.tile([0, 0, -4512.6], (len(hook), 1)), 3.0)
    figure = overview(
        REPORT, replace(seen, scene=replace(seen.scene, groups=[replace(own, layers=[weight])]))
    )
    figure.draw_without_rendering()
    check_legible(figure)
    r, at = weight.radius, weight.to[own.first, 0]
    for axes, plane in zip(figure.axes, ([0, 2], [0, 1]), strict=False):
        [drawn] = [many for many in axes.collections if isinstance(many, PatchCollection)]
        [path] = drawn.get_paths()
        ends = np.array([path.vertices.min(axis=0), path.vertices.max(axis=0)])
        below = 2 * r if plane[1] == 2 else r
        np.testing.assert_allclose(ends[0], at[plane] - [r, below])
        np.testing.assert_allclose(ends[1], at[plane] + [r, 2 * r - below])
    [words] = figure.axes[0].texts
    assert words.get_text() == weight.labels[0] == "460 kg"


def test_the_arm_fills_its_pane_in_equal_scales_and_two_panes_fill_the_width(figure):
    figure.draw_without_rendering()
    panes = figure.axes[:2]
    assert sum(axes.bbox.width for axes in panes) > 0.8 * figure.bbox.width
    for axes in panes:
        drawn = [many.get_datalim(axes.transData) for many in axes.collections]
        size = np.max([box.max for box in drawn], axis=0) - np.min([box.min for box in drawn], axis=0)
        shown = np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1)
        assert max(size / shown) > 0.75
        assert shown / [axes.bbox.width, axes.bbox.height] == pytest.approx(shown[0] / axes.bbox.width)


def test_panes_of_one_quantity_have_one_scale_and_others_their_own():
    rows = [Row(row, other=row.error, far=100.0 * (row.n + 1)) for row in MODELS[1:3]]
    again = TableColumn("other", "error", "mm"), TableColumn("far", "time", "s")
    table = Table((*COLUMNS[:2], *again), [Row(row, other=50.0) for row in rows])
    first, second, third = forest(table, {"error": "a", "other": "b", "far": "c"}, "Who wins", "").axes
    assert first.get_xlim() == second.get_xlim() != third.get_xlim()
    assert all(axes.get_xlim()[0] <= x <= axes.get_xlim()[1] for axes in (first, second) for x in (0.3, 50.0))


def test_sweeps_of_one_quantity_have_one_upright_scale_and_others_their_own():
    def swept(values, unit):
        rows = [model(m.name, m.structure, m.constraint, x, n=k) for m in MODELS[:2] for k, x in values]
        return Table((COLUMNS[0], COLUMNS[2], TableColumn("error", "error", unit)), rows)

    first, second, third = sweeps(
        {
            "near": swept([(1, 0.3), (2, 0.4)], "mm"),
            "far": swept([(1, 20.0), (2, 50.0)], "mm"),
            "time": swept([(1, 7.0), (2, 9.0)], "s"),
        },
        "One wins",
        "",
    ).axes
    assert first.get_ylim() == second.get_ylim() != third.get_ylim()
    assert first.get_ylim()[0] <= 0.3 < 50.0 <= first.get_ylim()[1]


def test_figures_write_micrometres_and_powers_and_titles_end_without_a_stop():
    figure = page(2.0)
    say(figure, "The gauge of 5 um errs by 3 urad.", "Bands: 2 um.")
    assert figure.get_suptitle() == "The gauge of 5 µm errs by 3 µrad"
    assert figure.get_supxlabel() == "Bands: 2 µm."
    column = TableColumn("error", "gap", form=".1e")
    table = Table((COLUMNS[0], column), [model("gauge, 5 um", "MGCO56", "psd", 3e-4)])
    [axes] = forest(table, {"error": "a"}, "Who wins", "").axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["gauge, 5 µm  3.0·10⁻⁴"]


def test_the_best_models_and_those_that_tie_with_them_have_bands_and_the_caption_says_so():
    trials = np.linspace(0.9, 1.1, 12)
    several = [trials, np.roll(trials, 5), 3 * trials]  # the second is better in about half of the trials
    for numbers, best in ((map(spread, several), {0, 1}), ((1.0, 1.0, 3.0), set())):
        rows = [model(m.name, m.structure, m.constraint, x) for m, x in zip(MODELS, numbers, strict=False)]
        figure = forest(Table(COLUMNS, rows), {"error": "all"}, "Who wins", "RMS errors.")
        assert {round(patch.get_y() + 0.5) for patch in figure.axes[0].patches} == best
        said = "Band: the best, and all that tie with it." in " ".join(figure.get_supxlabel().split())
        assert said == bool(best)


def test_charts_hold_every_number_in_its_colour_with_its_interval(figure, seen):
    axes, chart = figure.axes[-1], seen.runs[0]
    shown = {line.get_label(): line for line in axes.get_lines()}
    for own in chart.lines:
        assert shown[own.name].get_ydata() == pytest.approx(own.values, nan_ok=True)
        assert shown[own.name].get_color() == own.look.hex
    low, high = chart.lines[1].ends
    corners = np.vstack([path.vertices for path in axes.collections[0].get_paths()])
    for x in np.flatnonzero(np.isfinite(low)):
        ends = corners[corners[:, 0] == x, 1]
        assert (ends.min(), ends.max()) == pytest.approx((low[x], high[x]))
    assert axes.get_title() == "Left (mm)"
    widths = [shown[own.name].get_linewidth() for own in chart.lines]
    assert widths[-1] == max(widths) > max(widths[:-1])  # the winner is last
    alike = overview(REPORT, replace(seen, runs=[replace(chart, leads=False)])).axes[-1].get_lines()
    assert len({line.get_linewidth() for line in alike}) == 1
    above = [replace(own, values=own.values + 50, ends=None) for own in chart.lines]
    apart = overview(REPORT, replace(seen, runs=[replace(chart, lines=above)])).axes[-1]
    assert apart.get_ylim()[0] <= 0  # errors look as large as they are
    assert [text.get_text() for text in axes.get_xticklabels()] == list("abcde")


def test_a_path_is_drawn_from_near_before_and_after_in_the_colours_of_its_error(seen):
    first = seen.scene.groups[0]
    path = np.linspace([1.0, 0, 1], [1.2, 0.5, 1], 5)[None]
    sizes = {"before": np.array([4.0, 3, 2, np.nan]), "after": np.array([1.0, 1, 1, 1])}

    def drawn(change):
        tubes = [
            replace(
                first.layers[2], name=name, kind="tubes", at=path[:, :-1], to=path[:, 1:], labels=(),
                values=change(mm),
            )
            for name, mm in sizes.items()
        ]  # fmt: skip
        insets = [
            replace(first, name=tube.name, layers=[tube], near=path[0], bent=None, ordered=True)
            for tube in tubes
        ]
        whole = replace(first, layers=tubes, ordered=True)
        found = overview(REPORT, replace(seen, scene=replace(seen.scene, groups=[whole, *insets])))
        found.draw_without_rendering()
        return found, tubes

    found, tubes = drawn(lambda mm: mm)
    _, *panes, bar = found.axes[:4]
    assert (*bar.get_ylim(), bar.get_ylabel()) == (1.0, 4.0, "error of the path [mm]")
    for axes, tube in zip(panes, tubes, strict=True):
        assert axes.get_title().startswith(tube.name)
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")  # from above: it is flat
        [lines] = [own for own in axes.collections if isinstance(own, LineCollection)]
        np.testing.assert_allclose(lines.get_segments(), np.stack([path[0, :-1], path[0, 1:]], 1)[:, :, :2])
        shades = [to_hex(colour).upper() for colour in lines.get_colors()]
        ends = {1.0: hexadecimal(SCALE[0]), 4.0: hexadecimal(SCALE[-1])}
        known = [(mm, shade) for mm, shade in zip(tube.values, shades, strict=True) if mm in ends]
        assert known
        assert all(shade == ends[mm] for mm, shade in known)
        assert (shades[-1] == SOFT) == np.isnan(tube.values[-1])
    before, after = panes
    assert before.get_ylim() == pytest.approx(after.get_ylim())  # both paths in one scale
    assert before.get_xlim() == pytest.approx(after.get_xlim())
    found, _ = drawn(lambda mm: 0.02 * mm**4)
    assert found.axes[3].get_ylabel() == "error of the path [mm, logarithmic]"
    check_legible(found)


def model(name, structure, constraint, error, *, prior=False, n=3):
    return Row(name=name, structure=structure, constraint=constraint, prior=prior, error=error, n=n)


MODELS = [
    model("MLS56", "MLS56", "none", spread([0.9, 1.0, 1.3])),
    model("MGCO56 + prior", "MGCO56", "psd", spread([0.2, 0.3, 0.4]), prior=True),
    model("Joints", "Joints", "none", 0.5),
    model("failed", "MGCO56", "psd", None),
]
COLUMNS = (
    TableColumn("name", "model"),
    TableColumn("error", "error", "mm"),
    TableColumn("n", "trials", form="d"),
)


@pytest.mark.parametrize("headline", ["error", ""])
def test_models_are_dots_with_intervals_in_their_looks_and_the_winner_is_first(seen, headline):
    plain = Table(COLUMNS[:2], [Row(name="a", error=1.0), Row(name="b", error=2.0)])
    table = Table(COLUMNS, MODELS, "All models", "MGCO56 + prior", headline)
    figure = overview(REPORT, replace(seen, scene=None, runs=(), tables=[plain, table]))
    [axes] = figure.axes
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names == [
        "GCO of beam links\nwith prior (MGCO56)  0.300",
        "joints-only model  0.500",
        "least squares of\nbeam links (MLS56)  1.000",
    ]
    assert (axes.get_xlabel(), axes.get_title("left")) == (
        "error [mm]",
        "All models; dots: 3 trials",
    )
    rows = [MODELS[k] for k in (1, 2, 0)]
    looks = [look("MGCO56", "psd", prior=True), look("Joints", "none"), look("MLS56", "none")]
    check_forest(axes, [row.error for row in rows], looks)


def test_of_twenty_trials_the_median_has_its_interval_and_more_than_a_hundred_are_not_drawn(seen):
    rng = np.random.default_rng(5)
    rows = [
        model("MLS56", "MLS56", "none", spread(rng.uniform(1, 2, 20))),
        model("MGCO56", "MGCO56", "psd", spread(rng.uniform(0.5, 1, 250))),
    ]
    table = Table(COLUMNS, rows, "", "MGCO56", "error")
    [axes] = overview(REPORT, replace(seen, scene=None, runs=(), tables=[table])).axes
    looks = [look("MGCO56", "psd"), look("MLS56", "none")]
    check_forest(axes, [row.error for row in rows[::-1]], looks)
    assert "100 of 20 to 250 trials" in axes.get_title("left")
    low, high = axes.get_xlim()
    assert all(low <= x <= high for line in axes.get_lines() for x in np.ravel(line.get_xdata()))


@pytest.mark.parametrize("times", [1.05, 1.7, 3.0, 21.0, 400.0, 1e4, 1e13])
@pytest.mark.parametrize(("low", "side"), [(3e-3, "x"), (0.7, "y"), (9e4, "x")])
def test_a_logarithmic_axis_has_ticks_inside_it_each_with_its_number(low, times, side):
    axes = Figure().subplots()
    log_ticks(axes, side, low, low * times)
    axis = axes.xaxis if side == "x" else axes.yaxis
    ends = axes.get_xlim() if side == "x" else axes.get_ylim()
    places, words = axis.get_majorticklocs(), [text.get_text() for text in axis.get_majorticklabels()]
    assert len(places) >= 1 + (times > 10)
    assert [number_of(text) for text in words] == pytest.approx(places)
    assert all(ends[0] <= place <= ends[1] for place in places)
    assert not len(axis.get_minorticklocs())


def number_of(text):
    """What a tick says."""
    size, _, power = text.rpartition("10") if "⁻" in text or set(text) & set("⁰¹²³⁴⁵⁶⁷⁸⁹") else (text, "", "")
    raised = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(size.rstrip("·") or 1) * 10.0 ** int(raised or 0)


def test_a_table_with_several_rows_per_model_is_not_drawn():
    several = Table(COLUMNS, [*MODELS, model("MLS56", "MLS56", "none", 7.0)], headline="error")
    whole = Table(COLUMNS, MODELS, headline="error")
    assert headline([several]) is None
    table, column = headline([several, whole])
    assert (table.rows, column) == ([MODELS[k] for k in (1, 2, 0)], COLUMNS[1])


def test_rows_that_each_add_to_the_one_before_keep_their_order(seen):
    rows = [
        Row(name=name, structure="MGCO56", constraint="psd", prior=False, error=x)
        for name, x in (("geometry", 0.48), ("joint errors", 0.09), ("links", 0.1))
    ]
    for stepwise, order in ((True, [0, 1, 2]), (False, [1, 2, 0])):
        table = Table(COLUMNS[:2], rows, "Errors tried", headline="error", stepwise=stepwise)
        [axes] = overview(REPORT, replace(seen, scene=None, runs=(), tables=[table])).axes
        heads = [text.get_text().split("  ")[0] for text in axes.get_yticklabels()]
        assert heads == [rows[k].name for k in order]


def test_a_dashed_line_is_at_what_noise_alone_stays_below(seen):
    chart = replace(seen.runs[0], limit=1.25)
    [dashed] = [
        line
        for line in overview(REPORT, replace(seen, runs=(chart,))).axes[-1].get_lines()
        if line.get_linestyle() == "--" and line.get_label() == chart.limit_is
    ]
    assert list(dashed.get_ydata()) == [1.25, 1.25]


ENDS = ".svg", "_dark.svg", "_89.svg", "_89_dark.svg"


def test_for_print_there_are_svgs_beside_the_png_of_two_widths_on_light_and_on_dark_ground(pixels, tmp_path):
    with pixels(), session(EMPTY_SESSION._replace(prints=True)):
        for name in ("one.png", "two.png"):
            figure = page(1.0)
            figure.subplots().plot([1, 2], color="#C88304")
            say(figure, "Title", "Words.")
            figures.save(figure, tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}{end}" for name in ("one", "two") for end in (".png", *ENDS)
    }
    for end in ENDS:  # the same figure, the same file
        text = (tmp_path / f"one{end}").read_text()
        assert text == (tmp_path / f"two{end}").read_text()
        [width] = re.findall(r'<svg [^>]*width="([\d.]+)pt"', text)
        assert float(width) * 25.4 / 72 == pytest.approx(89 if "89" in end else 183)
        used = set(re.findall("#[0-9a-f]{6}", text))
        assert "#c88304" in used
        assert used.isdisjoint({"#ffffff", "#000000"}) == ("dark" in end)
        ground = re.search("fill: #([0-9a-f]{2})", text)[1]
        assert int(ground, 16) == (18 if "dark" in end else 255)
        letters = re.search("<svg [^>]*>", text)[0]  # those without a fill of their own are black else
        assert ('fill="#ebebeb"' in letters) == ("dark" in end)


def test_a_scale_is_logarithmic_where_one_model_errs_far_more_and_says_so():
    good, bad = np.array([0.01, 0.02, 0.03]), np.array([0.5, 1.0, 2.0])
    alike, apart = scale_of(good, 1.5 * good), scale_of(good, bad)
    assert (alike.logarithmic, alike.words, alike.ends) == (False, "mm", (0.01, 0.045))
    assert (apart.logarithmic, apart.words, apart.ends) == (True, "mm, logarithmic", (0.01, 2.0))
    for scale in (alike, apart):
        share = np.linspace(0, 1, 5)
        assert scale.shares(scale.errors(share)) == pytest.approx(share, abs=1e-12)
    assert apart.shares(np.array([0.1 * 2**0.5]))[0] == pytest.approx(0.5)
    assert scale_of(np.array([0.0, 1e-9, 3.0])).ends == (0.003, 3.0)  # zero has no logarithm


@pytest.mark.parametrize(
    ("names", "level"), [([f"{k}" for k in range(1, 22)], True), (["cut 12"] * 16, False)]
)
def test_names_of_runs_are_level_where_they_have_room(seen, names, level):
    k = np.arange(len(names))
    chart = replace(
        seen.runs[0], labels=names, lines=[replace(seen.runs[0].lines[0], values=0.1 * k, ends=None)]
    )
    figure = overview(REPORT, replace(seen, scene=None, tables=[], runs=(chart,)))
    figure.draw_without_rendering()
    check_legible(figure)
    assert {text.get_rotation() for text in figure.axes[0].get_xticklabels()} == {0.0 if level else 45.0}


@pytest.mark.parametrize(
    "own", [("MLS56", "MLS56", "none"), ("Joints", "Joints", "none"), ("MGCO56", "MGCO56", "psd")]
)
def test_bands_are_seen_in_the_few_colours_of_a_file(own, pixels, tmp_path):
    wide = spread(np.geomspace(0.1, 10.0, 21))  # the line is at 1, its band far around it
    rows = [model(*own, wide, n=k) for k in (1, 2)]
    figure = sweeps({"": Table((COLUMNS[0], COLUMNS[2], COLUMNS[1]), rows)}, "One wins", "")
    with pixels():
        figures.save(figure, tmp_path / "one.png")
    [axes] = figure.axes
    x, y = axes.transData.transform((1.5, 3.0)).round().astype(int)
    with Image.open(tmp_path / "one.png") as picture:
        whole = picture.convert("RGB")
        assert whole.getpixel((int(x), whole.height - int(y))) != whole.getpixel((0, 0))


@pytest.mark.parametrize(("unit", "shown"), [("um", "µm"), ("urad/(N m)", "µrad/(N m)"), ("mm", "mm")])
def test_axes_write_micrometres_as_they_are_written(unit, shown):
    assert labelled(TableColumn("a", "sum of rms", unit)) == f"sum of rms [{shown}]"


def test_the_bent_arm_is_in_the_key_where_one_is_drawn(figure, seen):
    def keys(drawn):
        return [text.get_text() for text in drawn.axes[2].get_legend().get_texts()]

    assert keys(figure)[-1] == "arm, bent"
    own = replace(seen.scene.groups[0], bent=None)
    assert "arm, bent" not in keys(overview(REPORT, replace(seen, scene=replace(seen.scene, groups=[own]))))


def test_the_winner_is_the_widest_line_of_a_figure_and_joint_stiffness_the_next():
    figure = Figure()
    axes = figure.subplots()
    lines = {name: axes.plot([1, 2], label=name)[0] for name in ("MLS56", "Joints", "MGCO56")}
    headed(figure, "Holds: so it is.", "MLS56")
    for key in ("linewidth", "markersize", "zorder"):
        ours, joints, other = (getattr(line, f"get_{key}")() for line in lines.values())
        assert ours > joints >= other
    assert lines["Joints"].get_linewidth() > lines["MGCO56"].get_linewidth()
    assert figure.get_suptitle().startswith("Holds: so it is")
    tick = axes.xaxis.get_major_ticks()[0].tick1line  # bears no name, and so is no winner of a tie
    before = tick.get_markersize()
    headed(figure, "")
    assert tick.get_markersize() == before


def test_a_line_alone_has_no_key_and_two_have_one(figure, seen):
    assert [text.get_text() for text in figure.axes[-1].get_legend().get_texts()] == ["other", "one"]
    alone = replace(seen.runs[0], lines=seen.runs[0].lines[:1])
    assert overview(REPORT, replace(seen, runs=(alone,))).axes[-1].get_legend() is None


def test_the_layout_that_measures_words_once_is_that_of_matplotlib(seen):
    table = Table(COLUMNS, MODELS)
    for draw in (lambda: forest(table, {"error": "all"}, "Who wins", ""), lambda: overview(REPORT, seen)):
        own, other = draw(), draw()
        other.get_layout_engine().execute(other)
        figures._lay_out(own)
        for a, b in zip(own.axes, other.axes, strict=True):
            np.testing.assert_allclose(a.get_position().bounds, b.get_position().bounds, atol=2e-3)
