"""Any run is recorded as its page draws it: places, ends, numbers, orders and words are the same."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from made_up_run import LOOK, REPORT, made_up_run
from matplotlib.figure import Figure
from read_back import chunks_of, columns, document, documents, panes, rerun, rgb, series, sound, views
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from testbench.identify.base_frame import register_dataset
from testbench.model.vjm import tool_poses
from testbench.plant.tracker import DRAW_WIRE, Gauge
from testbench.report.colours import GREY, SCALE, hexadecimal, look
from testbench.report.page import seen_plain
from testbench.report.recording.run import (
    CHART_HIGH,
    LEAST_CHART,
    LINE,
    _beyond,
    _from_zero,
    _heights,
    _legend_room,
    _seen,
    write_run,
)
from testbench.report.recording.stream import RecordingHeader
from testbench.report.run_figure import overview
from testbench.report.scene import (
    ModelLine,
    PageContent,
    at_one_target,
    ellipsoid_layer,
    faces,
    gauges,
    label_places,
    legs,
    loads,
    read_along,
    typical_first,
)
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row
from testbench.workflows.campaign import poses_with_weight, read_instruments
from testbench.workflows.instruments import Mounted


@pytest.fixture(scope="module")
def seen(arm_6r):
    return made_up_run(arm_6r)


def written(path, seen, **figures):
    write_run(path, RecordingHeader("made_up", "{}", 1), REPORT, seen, figures)
    return path


def looked_at(folder, seen, **figures):
    """Chunks of a recording that is sound."""
    return sound(written(folder / "a.rrd", seen, **figures), "It is 3.000 mm off.")


def with_layers(seen, *layers):
    """The run with these layers alone in its first group, and without a map."""
    own = replace(seen.scene.groups[0], layers=[*layers])
    return replace(seen, scene=replace(seen.scene, groups=[own]), map=None)


@pytest.fixture(scope="module")
def chart():
    """A figure of two panes side by side that share the names of their rows, and of a bar of colours."""
    figure = Figure()
    left, right = figure.subplots(1, 2)
    left.plot([1.0, 2.0], [0, 1], "o-", color="#C88304", label="MLS56")
    left.barh([0, 1], [1.0, 2.0], 0.5, color="#43835C")
    left.set_yticks([0, 1], ["MLS56  1.00", "Joints  2.00"])
    right.set_yticks([0, 1], ["3.00", "4.00"])
    for axes, title in ((left, "check"), (right, "workspace")):
        axes.set(xlabel="error [mm]", title=title, xlim=(0, 2), ylim=(-0.5, 1.5))
    return figure


@pytest.fixture(scope="module")
def file(seen, chart, tmp_path_factory):
    return written(tmp_path_factory.mktemp("run") / "recording.rrd", seen, Chart=chart)


@pytest.fixture(scope="module")
def chunks(file):
    return chunks_of(file)


#: Pose 3 is worst, then 4, 0, 1; the pose without a number is last. A reader lands on the first of the page.
ORDER = [3, 4, 0, 1, 2]
SHOWN = [3, *ORDER]


def test_equal_runs_are_equal_recordings(file, seen, chart, tmp_path):
    again = written(tmp_path / "again.rrd", seen, Chart=chart)
    assert rerun("compare", "--unordered", file, again)[0] == 0


def test_it_is_whole_and_every_view_has_data_where_the_reader_lands(file):
    sound(file, "It is 3.000 mm off.")
    names = {name for _, _, name in views(file)}
    assert {
        "Runs. Errors x 10.",
        "Left (mm), by run, the worst first",
    } <= names


def test_a_reader_lands_on_the_pose_of_median_error_then_on_the_worst(seen, tmp_path):
    """Of 3, 2, 1 and 0 mm the lower median is 1 mm; the page and the picture open there too."""
    drawn = typical_first(seen)
    own = drawn.scene.groups[0]
    size = seen.runs[0].lines[-1].values
    known = np.sort(size[np.isfinite(size)])
    assert (size[own.first], own.worst) == (known[(len(known) - 1) // 2], ORDER[0])
    assert seen_plain(drawn)["scene"]["groups"][0]["first"] == own.first
    chunks = chunks_of(written(tmp_path / "typical.rrd", drawn))
    texts = documents(chunks, "/here/runs")
    assert [text.partition("**")[2][0] for text in texts] == ["abcde"[k] for k in (own.first, *ORDER)]
    found = series(chunks, "/charts/runs/left_mm/one")
    assert np.array(found, float) == pytest.approx(size[ORDER], nan_ok=True)
    starts = zip(
        *map(columns(chunks, "/charts/runs/left_mm/one").get, ("typical_first", "Scalars:scalars")),
        strict=True,
    )
    assert dict(starts)[0] == []  # the typical one stands once in the curve, at its place
    left, right = overview_panes(drawn)
    assert left.startswith(f"{own.names[own.first]}, typical")
    assert right.startswith(f"{own.names[own.worst]}, worst")


def overview_panes(seen):
    """Titles of the two panes of the arm in the picture of a run."""
    titles = [axes.get_title() for axes in overview(REPORT, seen).axes]
    return [title for title in titles if "from the side" in title or "from above" in title]


def test_the_arm_and_its_ghost_stand_in_every_pose_worst_first(chunks, seen):
    own = seen.scene.groups[0]
    for root, frames in (("arm", own.rigid), ("arm_deflected", own.bent)):
        moved = [
            c.entity_path for c in chunks if c.entity_path.startswith(f"/world/{root}/") and not c.is_static
        ]
        data = columns(chunks, sorted(set(moved))[-1])
        keys = ("typical_first", "Transform3D:translation", "Transform3D:quaternion")
        _, at, turn = zip(*sorted(zip(*map(data.get, keys), strict=True)), strict=True)
        apart = np.abs(np.reshape(at, (-1, 1, 3)) - frames.positions[SHOWN]).max(axis=(0, 2))
        assert apart.min() < 1e-6
        turned = Rotation.from_quat(np.reshape(turn, (-1, 4))).as_matrix()
        assert turned == pytest.approx(frames.rotations[SHOWN][:, apart.argmin()], abs=1e-6)
        assert [c.entity_path for c in chunks if c.entity_path.startswith("/world/arm_1/")]  # of the places


def test_layers_are_where_the_page_has_them_and_what_was_lost_is_left_out(chunks, seen):
    dots, arrows, lines, _ = seen.scene.groups[0].layers
    data = columns(chunks, "/world/runs/target_as_read")
    for rank, at in zip(data["typical_first"], data["Points3D:positions"], strict=True):
        own = dots.at[SHOWN[rank]]
        assert np.array(at) == pytest.approx(own[np.isfinite(own).all(axis=1)], abs=1e-6)
    data = columns(chunks, "/world/runs/error_of_one")
    for rank, start, way in zip(
        data["typical_first"], data["Arrows3D:origins"], data["Arrows3D:vectors"], strict=True
    ):
        known = np.isfinite(arrows.at[SHOWN[rank]]).all(axis=1)
        assert np.array(start) == pytest.approx(arrows.at[SHOWN[rank]][known], abs=1e-6)
        assert np.array(start) + np.array(way) == pytest.approx(arrows.to[SHOWN[rank]][known], abs=1e-6)
    [strips] = columns(chunks, "/world/runs/intended_path")["LineStrips3D:strips"]
    assert np.array(strips) == pytest.approx(np.stack([lines.at[0], lines.to[0]], axis=1), abs=1e-6)
    names = columns(chunks, "/world/runs/target_as_read_names")
    assert names["Points3D:labels"][0] == ["P1", "P3"]


def test_charts_hold_the_numbers_largest_first_with_their_intervals(chunks, seen):
    other, one = seen.runs[0].lines
    for path, values in (
        ("one", one.values),
        ("other", other.values),
        ("one_lower", one.ends[0]),
        ("one_upper", one.ends[1]),
    ):
        found = series(chunks, f"/charts/runs/left_mm/{path}")
        assert np.array(found, float) == pytest.approx(values[ORDER], nan_ok=True), path


def test_words_say_which_pose_is_shown_and_what_colours_are(chunks):
    texts = documents(chunks, "/here/runs")
    assert [text.partition("\n")[0] for text in texts] == [f"**{'abcde'[k]}.** {k} mm off" for k in SHOWN]
    assert all(f"{x}: " in texts[0].lower() for x in ("rust dots", "green arrows", "green lines"))
    assert "hidden" not in texts[0]
    text = document(chunks, "/summary")
    assert (
        text.index("How far is it off?")
        < text.index("**It is 3.000 mm off.**")
        < text.index("Worst in pose d.")
    )
    assert "| one |" in document(chunks, "/tables")


def test_a_map_has_a_ball_a_place_the_larger_and_brighter_the_more(chunks, seen):
    mm, known = seen.map.lines[0].values, np.isfinite(seen.map.lines[0].values)
    data = columns(chunks, "/world/map/one/field")
    assert np.array(data["Points3D:positions"][0]) == pytest.approx(seen.map.at[known], abs=1e-6)
    radii = np.array(data["Points3D:radii"][0])
    assert (np.argsort(radii) == np.argsort(mm[known])).all()
    colours = rgb(data["Points3D:colors"][0])
    assert colours[int(np.argmax(mm[known]))] == SCALE[-1]
    assert colours[int(np.argmin(mm[known]))] == SCALE[0]
    assert "0.500, 1.625, 2.750, 3.875, 5.000 mm" in document(chunks, "/map_words")
    k = int(np.nanargmax(mm))
    worst = columns(chunks, "/world/map/one/worst")
    assert worst["Points3D:labels"] == [["worst 5.000 mm"]]
    assert worst["Points3D:positions"][0][0][:2] == pytest.approx(seen.map.at[k, :2], abs=1e-6)
    assert len(columns(chunks, "/world/map/one/none")["Ellipsoids3D:centers"][0]) == 1
    x, y, z = seen.map.at[k]
    assert f"- one: 5.000 mm, E, x {x:.2f}, y {y:.2f}, z {z:.2f} m" in document(chunks, "/map_words")


def test_the_winner_less_joint_stiffness_has_the_colour_of_the_one_that_errs_less(seen, tmp_path):
    mm = seen.map.lines[0].values
    joints, ours = ModelLine("Joints", look("Joints", "none"), mm), ModelLine("one", LOOK, 0.5 * mm)
    ours.values[1] = 3 * mm[1]
    both = replace(seen.map, lines=[joints, ours])
    assert seen.map.difference is None
    assert both.difference == (ours, joints)
    chunks = looked_at(tmp_path, replace(seen, map=both))
    known = np.isfinite(mm)
    off = (ours.values - mm)[known]
    data = columns(chunks, "/world/map/difference/field")
    colours = rgb(data["Points3D:colors"][0])
    assert colours == [LOOK.colour if x < 0 else joints.look.colour for x in off]
    assert np.argmax(data["Points3D:radii"][0]) == np.argmax(np.abs(off))
    places = f"in {len(off) - 1} of {len(off)} places, by {np.abs(off).max():.3f} mm at most"
    errs = f"one errs less than the joints-only model {places}"
    assert errs in document(chunks, "/map_words")
    drawn = seen_plain(replace(seen, map=both))["map"]
    assert [drawn["lines"][k]["name"] for k in drawn["difference"]] == ["one", "Joints"]


def test_lines_have_the_colour_of_their_model_and_a_cross_where_it_has_a_prior(chunks, seen):
    shapes, widths = {}, []
    for line in seen.runs[0].lines:
        data = columns(chunks, f"/charts/runs/left_mm/{line.name}")
        for part in ("SeriesLines:colors", "SeriesPoints:colors"):
            assert rgb(data[part][0]) == [line.look.colour]
        assert data["SeriesLines:names"] == [[line.name]]
        widths.append(data["SeriesLines:widths"][0][0])
        shapes[line.name] = data["SeriesPoints:markers"][0][0]
    assert widths[-1] > max(widths[:-1])  # the winner is last
    assert (shapes["one"] == rr.components.MarkerShape.Cross.value) != (
        shapes["other"] == rr.components.MarkerShape.Cross.value
    )


def test_a_map_without_an_arm_is_drawn_alone(seen, tmp_path):
    chunks = looked_at(tmp_path, PageContent(map=seen.map))
    assert "- one: 5.000 mm, place 5, " in document(chunks, "/map_words")


def test_a_failure_half_way_leaves_the_earlier_file_whole(seen, tmp_path, monkeypatch):
    path = tmp_path / "recording.rrd"
    path.write_bytes(b"earlier")

    def fail(*_, **__):
        assert rr.strict_mode()
        raise RuntimeError("half-way")

    monkeypatch.setattr(rr.RecordingStream, "send_columns", fail)
    with pytest.raises(RuntimeError, match="half-way"):
        written(path, seen)
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_runs_whose_views_differ_have_other_layouts(seen, tmp_path):
    """Or the viewer would show one by the layout of the other."""
    found = set()
    for name in ("a", "b"):
        own = replace(seen, scene=replace(seen.scene, title=f"Errors x {name}."))
        (entry,) = RrdReader(written(tmp_path / f"{name}.rrd", own)).recordings()
        found.add(entry.application_id)
    assert len(found) == 2


def test_seed_scenario_and_versions_are_properties(chunks):
    properties = columns(chunks, "/__properties/study")
    assert (properties["seed"], properties["scenario"]) == ([[1]], [["made_up"]])
    versions = columns(chunks, "/__properties/versions")
    assert {"testbench", "mujoco", "pin", "rerun-sdk", "numpy"} <= set(versions)


def test_a_run_without_a_scene_opens_on_its_figures_drawn_anew(chart, tmp_path):
    file = written(tmp_path / "a.rrd", PageContent(), Chart=chart)
    chunks = sound(file, "It is 3.000 mm off.")
    assert {kind for _, kind, _ in views(file)} == {"2D", "TextDocument"}
    assert {"check", "workspace"} <= {name for *_, name in views(file)}
    rows = [columns(chunks, f"/figures/chart_{k}/y_numbers")["Points2D:labels"] for k in (0, 1)]
    assert rows == [[["MLS56 1.00", "Joints 2.00"]], [["MLS56 3.00", "Joints 4.00"]]]
    assert columns(chunks, "/figures/chart_0/x_name")["Points2D:labels"] == [["error [mm]"]]
    [[(_, (_, high), (wide, _))]] = columns(chunks, "/figures/chart_0/axes")["LineStrips2D:strips"]
    dots = np.array(columns(chunks, "/figures/chart_0/dots")["Points2D:positions"][0])
    assert dots == pytest.approx(np.array([[wide / 2, 0.75 * high], [wide, 0.25 * high]]))  # downwards
    strips = columns(chunks, "/figures/chart_0/lines")["LineStrips2D:strips"][0]
    joined, *bars = [np.array(strip) for strip in strips]
    assert joined == pytest.approx(dots)
    round_ = 0.25 * high / 2  # radius of the ends of bars
    assert [(bar[0, 0], bar[1, 0]) for bar in bars] == [
        pytest.approx((round_, share * wide - round_)) for share in (0.5, 1.0)
    ]
    key = columns(chunks, "/figures/chart_0/key_0")
    assert key["Points2D:labels"] == [["MLS56"]]
    assert rgb(key["Points2D:colors"][0]) == [(0xC8, 0x83, 0x04)]


ERRORS = (0.4, 0.1)  #: Of "other" and "one".


@pytest.fixture
def models(seen, tmp_path):
    """What a recording has of a table of two models, which has one more column of numbers."""

    def drawn(column, numbers=ERRORS, *, conservative=False):
        rows = [
            Row(
                name=own.name, structure="MGCO56", constraint="psd", prior=own.name == "one",
                conservative=x < 0.2, **{column.key: x},
            )
            for own, x in zip(seen.runs[0].lines, numbers, strict=True)
        ]  # fmt: skip
        shown = [TableColumn("name", "model"), column]
        shown += [TableColumn("conservative", "conservative", form="yes")] if conservative else []
        table = Table(tuple(shown), rows, "Models", "one", column.key)
        chunks = looked_at(tmp_path, replace(seen, tables=[table]))
        return lambda name, column: columns(chunks, f"/models/{name}")[column]

    return drawn


def test_models_are_bars_from_zero_each_with_its_name_and_number(models):
    part = models(TableColumn("error", "error", "mm"))
    assert part("y_numbers", "Points2D:labels") == [["one", "other"]]  # the best first
    assert part("texts", "Points2D:labels") == [["0.100", "0.400"]]
    ends = [np.array(strip)[:, 0].max() for strip in part("lines", "LineStrips2D:strips")[0]]
    reached = np.add(ends, part("lines", "LineStrips2D:radii")[0])
    assert reached[1] / reached[0] == pytest.approx(4.0)


def test_ratios_are_dots_beside_a_line_at_one(models):
    part = models(TableColumn("ratio", "ratio"), (0.5, 2.0))
    [[line]] = part("lines", "LineStrips2D:strips")
    half, twice = np.sort(np.array(part("dots", "Points2D:positions")[0])[:, 0])
    assert np.array(line)[:, 0] == pytest.approx((half + twice) / 2)  # on a logarithmic axis


def test_a_model_that_is_not_conservative_says_so_beside_its_number_in_a_place_of_its_own(models):
    part = models(TableColumn("error", "error", "mm"), conservative=True)
    assert part("texts", "Points2D:labels") == [["0.100", "0.400, not conservative"]]
    heights = np.array(part("texts", "Points2D:positions")[0])[:, 1]
    assert np.diff(np.sort(heights)).min() >= LINE  # a label is one line high


def test_a_summary_has_room_for_its_words_and_charts_for_their_lines():
    short, long = "## **Holds**", "\n\n".join(["## **Holds**", *["- " + "word " * 40] * 20])
    for charts in (1, 2):
        (usual, chart), (told, left) = (_heights(words, 900.0, charts) for words in (short, long))
        assert usual + charts * chart == pytest.approx(900) == told + charts * left
        assert chart > usual  # few words leave most to the charts
        assert told > usual
        assert left >= LEAST_CHART
    assert _heights(long, 900.0, 1)[1] == CHART_HIGH > LEAST_CHART  # notes may be scrolled
    headings = "\n\n".join(["## **Holds**", *["#### " + "word " * 40] * 12])
    assert _heights(headings, 900.0, 1)[1] == LEAST_CHART
    assert _heights(short, 900.0, 0) == (900.0, 0.0)


def test_tables_of_a_recording_say_first_what_the_names_of_models_mean(seen, tmp_path):
    rows = [
        Row(name=name, structure=name, constraint="psd", prior=False, error=x)
        for name, x in (("MGCO56", 0.4), ("mine.py:best", 0.1))
    ]
    table = Table((TableColumn("name", "model"), TableColumn("error", "error", "mm")), rows, "Models")
    chunks = chunks_of(written(tmp_path / "a.rrd", replace(seen, tables=[table])))
    assert document(chunks, "/tables").startswith("Models: **MGCO56**: GCO of beam links.")
    [names] = columns(chunks, "/models/y_numbers")["Points2D:labels"]
    assert names == ["mine.py:best", "GCO of beam links"]


BEFORE, AFTER = np.array([4.0, 3, 2, np.nan]), np.array([1.0, 1, 1, 1])


def test_lines_end_where_their_axes_end_and_names_of_two_lines_are_whole(seen, tmp_path):
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.0, 1.0, 5.0], [-2.0, 0.5, 4.5], label="grows")
    axes.set_yticks([0, 1], ["GCO of all links and\njoints with prior  1.00", "Joints  2.00"])
    axes.set(xlabel="error [mm]", xlim=(0, 2), ylim=(0, 1))
    chunks = looked_at(tmp_path, seen, chart=figure)
    [[(_, (_, high), (wide, _))]] = columns(chunks, "/figures/chart_0/axes")["LineStrips2D:strips"]
    [strips] = columns(chunks, "/figures/chart_0/lines")["LineStrips2D:strips"]
    ends = np.concatenate([np.array(strip) for strip in strips])
    assert ends.min() >= -1.5  # a pixel
    assert (ends <= [wide + 1.5, high + 1.5]).all()
    [lines] = columns(chunks, "/figures/chart_0/y_numbers")["Points2D:labels"]
    assert lines == ["GCO of all links and", "joints with prior 1.00", "Joints 2.00"]
    [key] = columns(chunks, "/figures/chart_0/key_0")["Points2D:positions"]
    assert key[0][0] > wide  # beside the axes


def test_a_path_has_its_order_its_colours_on_one_scale_and_its_insets_in_the_first_tab(seen, tmp_path):
    first = seen.scene.groups[0]
    path = np.linspace([1.0, 0, 1], [1.0, 1, 1], 5)[None]
    tube = replace(first.layers[2], kind="tubes", at=path[:, :-1], to=path[:, 1:], labels=())
    parts = [replace(tube, name=name, values=mm) for name, mm in (("before", BEFORE), ("after", AFTER))]
    whole = replace(first, ordered=True, layers=parts)
    insets = [replace(whole, name=part.name, layers=[part], near=path[0], bent=None) for part in parts]
    page = replace(seen, scene=replace(seen.scene, groups=[whole, *insets]), map=None)
    file = written(tmp_path / "path.rrd", page)
    chunks = sound(file, "It is 3.000 mm off.")
    assert page.scene.insets == insets
    assert len(panes(file)) == 2  # that of the arm, and the tables
    assert page.scene.tube_scale.ends == (1.0, 4.0)
    shades = {}
    for name in ("before", "after"):
        shades[name] = rgb(columns(chunks, f"/world/{name}/{name}")["LineStrips3D:colors"][0])
    assert shades["before"][0] == SCALE[-1]
    assert shades["before"][-1] == GREY
    assert shades["after"] == [SCALE[0]] * 4
    found = series(chunks, "/charts/runs/left_mm/one")
    assert np.array(found, float) == pytest.approx(seen.runs[0].lines[-1].values, nan_ok=True)
    drawn = seen_plain(page)["scene"]["groups"][0]["layers"]
    assert drawn[0]["colours"][0] == hexadecimal(SCALE[-1])
    assert drawn[1]["colours"] == [hexadecimal(SCALE[0])] * 4


def test_a_weight_hangs_below_its_hook_as_large_as_steel_and_a_force_is_an_arrow_of_its_length(
    seen, tmp_path
):
    hook = np.array([[1.0, 0, 2], [2.0, 0, 1], [0.0, 1, 1], [1.0, 1, 1], [1.0, 0, 1]])
    force = np.array([[0, 0, -981.0], [0, 0, -981.0], [300.0, 0, 0], [-300.0, 0, 0], [0, 0, 0]])
    weight, push = loads(hook, force, reach=3.0)
    assert (weight.kind, weight.labels, push.kind, push.labels) == (
        "weights",
        ["100 kg"],
        "arrows",
        ["300 N"],
    )
    assert 2 * np.pi * weight.radius**3 * 7850 == pytest.approx(100, rel=1e-6)
    assert np.isfinite(weight.at[:, 0, 0]).tolist() == [True, True, False, False, False]
    assert np.isfinite(push.at[:, 0, 0]).tolist() == [False, False, True, True, False]
    assert (push.to - push.at)[2:4, 0] == pytest.approx(0.2 * 3 * force[2:4] / 981)
    assert push.to[3, 0] == pytest.approx(hook[3])  # into the arm: it ends there, or the arm would hide it
    chunks = looked_at(tmp_path, with_layers(seen, weight, push))
    bodies = columns(chunks, "/world/runs/load_body")
    for rank, at in zip(bodies["typical_first"], bodies["Cylinders3D:centers"], strict=True):
        here = np.isfinite(weight.at[SHOWN[rank], 0, 0])
        below = weight.to[SHOWN[rank]] - [0, 0, weight.radius]
        assert np.array(at or np.zeros((0, 3))) == pytest.approx(
            below if here else np.zeros((0, 3)), abs=1e-6
        )


def test_a_face_is_a_square_across_its_normal_seen_through_and_named(seen, tmp_path):
    rng = np.random.default_rng(5)
    at, u = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    names = ["plane 1", "plane 2", "plane 3"]
    drawn = with_layers(seen, faces(at, u, 0.4, names))
    chunks = looked_at(tmp_path, drawn)

    def still(path, column):
        [part] = columns(chunks, f"/world/runs/{path}")[column]
        return part

    corners = np.array(still("faces", "Mesh3D:vertex_positions")).reshape(3, 4, 3)
    assert corners.mean(axis=1) == pytest.approx(at, abs=1e-6)
    assert np.vecdot(corners - at[:, None], u[:, None]) == pytest.approx(0, abs=1e-6)
    for far, size in ((1, 0.8), (2, 0.8 * np.sqrt(2))):  # sides and diagonals
        length = np.linalg.norm(corners - np.roll(corners, far, axis=1), axis=2)
        assert length == pytest.approx(size, abs=1e-6)
    [colour] = still("faces", "Mesh3D:albedo_factor")
    assert colour & 0xFF == 70  # of 255
    way = np.array(still("faces_normals", "Arrows3D:vectors"))
    assert way / np.linalg.norm(way, axis=1, keepdims=True) == pytest.approx(u, abs=1e-6)
    assert list(still("faces_names", "Points3D:labels")) == names
    [on_page] = seen_plain(drawn)["scene"]["groups"][0]["layers"]
    assert np.reshape(on_page["squares"], (3, 4, 3)) == pytest.approx(1e4 * corners, abs=0.51)
    [side] = [axes for axes in overview(REPORT, drawn).axes if axes.get_ylabel() == "z [m]"]
    outlines = [path.vertices[:4] for c in side.collections for path in c.get_paths()]
    for square in corners[:, :, [0, 2]]:
        assert any(len(found) == 4 and np.allclose(found, square, atol=1e-6) for found in outlines)
    assert {*names} <= {text.get_text() for text in side.texts}


def test_a_gauge_is_a_cylinder_along_its_direction_that_touches_its_marker_from_outside(seen, tmp_path):
    rng = np.random.default_rng(4)
    at, tool, u = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 3)), rng.normal(size=(5, 2, 3))
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    u[3, 1] = 0  # no gauge there
    [layer] = gauges(at, u, tool, reach=3.0)
    length = layer.to - layer.at
    assert (np.vecdot(length, at - tool[:, None])[u.any(axis=2)] > 0).all()
    drawn = columns(looked_at(tmp_path, with_layers(seen, layer)), "/world/runs/gauges")
    for rank, *parts in zip(
        drawn["typical_first"],
        *(drawn[f"Cylinders3D:{name}"] for name in ("centers", "lengths", "quaternions")),
        strict=True,
    ):
        pose, there = SHOWN[rank], u[SHOWN[rank]].any(axis=1)
        centre, size, turn = (np.array(part) for part in parts)
        axis = Rotation.from_quat(turn).as_matrix()[:, :, 2]
        assert size == pytest.approx(0.05 * 3, abs=1e-6)
        assert np.abs(np.vecdot(axis, u[pose, there])) == pytest.approx(1, abs=1e-6)
        assert centre - 0.5 * length[pose, there] == pytest.approx(at[pose, there], abs=1e-6)


def test_what_reads_along_lines_is_drawn_and_a_lost_reading_is_not(kr500):
    tip, wire = Mounted(Gauge(), "P1", np.eye(3)[2]), Mounted(DRAW_WIRE, "P2", fixed=np.array([2.2, 0, 0.1]))
    loaded = poses_with_weight(kr500, np.zeros((2, 6)) + 0.1, np.arange(2) + 1, 100.0)
    data = read_instruments(kr500, "linear", loaded, [tip, wire], np.random.default_rng(1))
    data = register_dataset(kr500.vjm, data).data
    tool, reach = tool_poses(kr500.vjm, data.q)[0], kr500.vjm.reach
    stylus, line = read_along(data, tool, reach)
    assert stylus.at[:, 0] == pytest.approx(data.before[:, 0])
    assert np.isnan(stylus.at[:, 1:]).all()
    assert line.at[:, 1] == pytest.approx(np.tile([2.2, 0, 0.1], (2, 1)), abs=1e-2)  # turned with the load
    lost = replace(data, precision=data.precision * np.array([[0, 1, 1]])[..., None, None])
    assert [layer.name for layer in read_along(lost, tool, reach)] == ["distances"]
    plain = replace(
        data,
        line_direction=None,
        line_direction_deviation=None,
        line_length=None,
        tilt_error=None,
        precision=None,
    )
    assert read_along(plain, tool, reach) == []


def test_ellipsoids_stand_still_with_the_sizes_and_directions_of_report_json(seen, tmp_path):
    rng = np.random.default_rng(3)
    rows = [
        Row(
            label=f"{k}",
            at_m=rng.uniform(-1, 1, 3).tolist(),
            semi_axes_mm=[3.0, 2.0, 1.0],
            directions=np.linalg.svd(rng.standard_normal((3, 3)))[0].tolist(),
        )
        for k in range(6)
    ]
    times, layer = ellipsoid_layer(rows, 900.0)
    page = with_layers(seen, layer)
    chunks = looked_at(tmp_path, page)
    path = "/world/runs/where_900_n_in_any_direction_move_the_tool"
    data = {name: column[0] for name, column in columns(chunks, path).items()}
    plain = seen_plain(page)["scene"]["groups"][0]["layers"][0]
    parts = ("Ellipsoids3D:centers", "Ellipsoids3D:half_sizes", "Ellipsoids3D:quaternions")
    for k, (row, at, half, turn) in enumerate(zip(rows, *map(data.get, parts), strict=True)):
        assert at == pytest.approx(row.at_m, abs=1e-6)
        assert half == pytest.approx(times / 1e3 * np.array(row.semi_axes_mm), rel=1e-5)
        along = np.abs(np.sum(Rotation.from_quat(turn).as_matrix().T * row.directions, axis=1))
        assert along == pytest.approx(1)
        semi = times / 1e3 * np.array(row.semi_axes_mm)[:, None] * np.array(row.directions)
        assert plain["semi_axes"][k] == pytest.approx(1e4 * semi.ravel(), abs=0.5)
    assert (
        "teal ellipsoids: where 900 n in any direction move the tool"
        in document(chunks, "/here/runs").lower()
    )


def test_masses_and_forces_that_differ_are_told_apart():
    hook, down = np.ones((6, 3)), np.array([0, 0, -9.81])
    several = loads(hook, np.outer([1, 1, 2, 2, 3, 3], down), 1.0)
    assert [own.labels for own in several] == [["1 kg"], ["2 kg"], ["3 kg"]]
    assert several[0].radius < several[2].radius
    [many] = loads(hook, np.outer(np.arange(1, 7), down), 1.0)
    assert (many.name, many.labels) == ("load, 1 to 6 kg", ())
    assert loads(hook, np.zeros((6, 3)), 1.0) == []
    way = np.array([1.0, 0, 0])
    [pushes] = loads(hook, np.outer([1010, 1010, 1020, 1020, 0, 0], way), 1.0)  # one entry of a key
    assert (pushes.name, pushes.labels) == ("force, 1,010 to 1,020 N", ["1,010 N", "1,020 N"])
    there = np.isfinite(pushes.at[:, :, 0])
    assert there.tolist() == [[True, False]] * 2 + [[False, True]] * 2 + [[False, False]] * 2


def test_the_size_of_a_force_is_written_at_the_end_of_its_arrow_that_the_arm_does_not_hide():
    hook = np.array([[2.0, 0, 1]] * 3)
    force = np.array([[300.0, 0, 0], [-300.0, 0, 0], [0, 0, 300.0]])
    [push] = loads(hook, force, reach=3.0)
    at = label_places(push)[:, 0]
    assert at == pytest.approx(hook + 0.2 * 3 * np.array([[1, 0, 0], [1, 0, 0], [0, 0, 1.0]]))


def test_a_tracker_stands_on_the_floor_where_that_is_near():
    feet = legs(np.array([[1.0, 2, 1.5], [0.0, 0, -3]]))[:, 1]
    assert feet[:3, 2] == pytest.approx(0.0)
    assert (feet[3:, 2] < -3).all()


def test_errors_are_drawn_at_the_target_where_the_model_errs_most():
    at = np.arange(18.0).reshape(2, 3, 3)
    errors = {"a": np.ones((2, 3, 3)), "b": np.zeros((2, 3, 3))}
    errors["b"][0, 1], errors["b"][1, 2], errors["b"][1, 0] = 1.0, 2.0, np.nan
    start, one = at_one_target(at, errors, "b")
    assert start[:, 0] == pytest.approx(at[[0, 1], [1, 2]])
    assert one["b"][:, 0] == pytest.approx(np.array([[1.0] * 3, [2.0] * 3]))
    assert one["a"].shape == (2, 1, 3)


def test_names_beside_an_axis_stand_apart_however_many_they_are(seen, tmp_path):
    figure = Figure()
    axes = figure.subplots()
    axes.plot(np.arange(17.0), np.arange(17), "o")
    axes.set_yticks(range(17), [f"model {k}" for k in range(17)])
    axes.set(xlabel="error [mm]", ylabel="true arm", ylim=(16.5, -0.5))
    chunks = looked_at(tmp_path, seen, chart=figure)
    at = np.array(columns(chunks, "/figures/chart_0/y_numbers")["Points2D:positions"][0])
    dots = np.array(columns(chunks, "/figures/chart_0/dots")["Points2D:positions"][0])
    assert np.diff(at[:, 1]) == pytest.approx(np.diff(dots[:, 1]))
    assert np.diff(at[:, 1]).min() > 10
    assert columns(chunks, "/figures/chart_0/y_name")["Points2D:labels"] == [["true arm"]]


@pytest.mark.parametrize(("count", "letters"), [(2, 30), (6, 8)])
def test_the_legend_of_a_chart_covers_no_number(seen, count, letters):
    line = seen.runs[0].lines[0]
    lines = [replace(line, name=f"{k}" * letters, values=np.full(5, 2.0), ends=None) for k in range(count)]
    chart = replace(seen.runs[0], lines=lines, limit=None)
    above, aside = _legend_room(chart, 28 + 25 + 250)
    top = _from_zero(chart, above).range.as_arrow_array().to_pylist()[0][1]
    last = _beyond(40, aside).view_range.as_arrow_array().to_pylist()[0]["end"]
    wide, high = (40 + 5.5 * letters) / 620, 23.5 * count / 250  # as the viewer draws it [pixel]
    assert (1 - high) * top >= 2.0 or (1 - wide) * last >= 40


def test_what_is_dark_or_pale_on_paper_is_seen_on_any_ground():
    assert _seen((0.1, 0.1, 0.1)) == _seen((1.0, 1.0, 1.0)) == GREY
    assert _seen((1.0, 0.5, 0.0)) == (255, 128, 0)


def test_layers_that_look_alike_share_their_colour_in_words(seen, tmp_path):
    first = seen.scene.groups[0]
    tube = replace(first.layers[2], kind="tubes", labels=(), values=np.ones(first.layers[2].at.shape[1]))
    layers = [replace(tube, name="before"), first.layers[0], replace(tube, name="after")]
    page = replace(seen, scene=replace(seen.scene, groups=[replace(first, layers=layers)]), map=None)
    chunks = looked_at(tmp_path, page)
    assert "Tubes: before, after; rust dots: target as read." in document(chunks, "/here/runs")


@pytest.mark.parametrize(("second", "written_again"), [("grows", False), ("falls", True)])
def test_panes_with_the_same_key_have_it_once_and_axes_of_one_width(tmp_path, second, written_again):
    figure = Figure()
    for axes, label in zip(figure.subplots(2, 1), ("grows", second), strict=True):
        axes.plot([0.0, 1.0], [0.0, 1.0], color="#C88304", label=label)
        axes.set_yticks([0, 1], ["soft arm", "stiff arm"])
        axes.set(xlabel="error [mm]", xlim=(0, 1), ylim=(0, 1))
    chunks = looked_at(tmp_path, PageContent(), Chart=figure)
    keys = [columns(chunks, f"/figures/chart_{k}/key_0").get("Points2D:labels") for k in (0, 1)]
    assert keys == [[["grows"]], [[second]] if written_again else None]
    corners = [columns(chunks, f"/figures/chart_{k}/axes")["LineStrips2D:strips"][0] for k in (0, 1)]
    assert corners[0] == corners[1]


def test_places_of_a_map_have_words_without_the_colours_of_what_is_not_drawn_there(seen, tmp_path):
    first, places = seen.scene.groups
    dots = replace(first.layers[0], at=seen.map.at[:, None], labels=())
    groups = [first, replace(places, layers=[dots])]
    own = replace(seen, scene=replace(seen.scene, groups=groups))
    chunks = looked_at(tmp_path, own)
    with_colours, alone = (
        columns(chunks, f"/{name}/places")["TextDocument:text"] for name in ("here", "place")
    )
    assert all("rust dots: " in text.lower() for [text] in with_colours)
    assert not any("dots: " in text.lower() for [text] in alone)
