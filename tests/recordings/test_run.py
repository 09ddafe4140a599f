"""Any run is recorded as its page draws it: places, ends, numbers, orders and words are the same."""

from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from made_up_run import LOOK, REPORT, made_up_run
from PIL import Image
from read_back import chunks_of, columns, document, on, rerun, series, sound, views
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from testbench.report.colours import SCALE, look
from testbench.report.page.page import seen_plain
from testbench.report.recording.run import write_run
from testbench.report.recording.stream import RecordingHeader
from testbench.report.run_figure import overview
from testbench.report.scene import ModelLine, PageContent, typical_first


@pytest.fixture(scope="module")
def seen(arm_6r):
    return made_up_run(arm_6r)


def written(path, seen, **figures):
    write_run(path, RecordingHeader("made_up", "{}", 1), REPORT, seen, figures)
    return path


@pytest.fixture(scope="module")
def chart(tmp_path_factory):
    path = tmp_path_factory.mktemp("chart") / "chart.png"
    Image.new("RGB", (40, 20)).save(path)
    return path


@pytest.fixture(scope="module")
def file(seen, chart, tmp_path_factory):
    return written(tmp_path_factory.mktemp("run") / "recording.rrd", seen, Chart=chart)


@pytest.fixture(scope="module")
def chunks(file):
    return chunks_of(file)


#: Pose 3 is worst, then 4, 0, 1; the pose without a number is last.
ORDER = [3, 4, 0, 1, 2]


def test_equal_runs_are_equal_recordings(file, seen, chart, tmp_path):
    again = written(tmp_path / "again.rrd", seen, Chart=chart)
    assert rerun("compare", "--unordered", file, again)[0] == 0


def test_it_is_whole_and_every_view_has_data_where_the_reader_lands(file):
    sound(file, "It is 3.000 mm off.")
    names = {name for _, _, name in views(file)}
    assert {
        "Runs (m): Errors x 10.",
        "Left (mm), by run, a typical one, then the worst first",
        "Error (mm), by pose, in order",  # its first pose is not the worst
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
    found = series(chunks, "/charts/runs/left_mm/one", "typical_first")
    order = [own.first, *(k for k in ORDER if k != own.first)]
    assert np.array(found, float) == pytest.approx(seen.runs[0].lines[-1].values[order], nan_ok=True)
    assert np.array(series(chunks, "/charts/runs/left_mm/one"), float) == pytest.approx(
        size[ORDER], nan_ok=True
    )  # worst_first stays sorted
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
        data = columns(on(chunks, "worst_first"), sorted(set(moved))[-1])
        keys = ("worst_first", "Transform3D:translation", "Transform3D:quaternion")
        _, at, turn = zip(*sorted(zip(*map(data.get, keys), strict=True)), strict=True)
        apart = np.abs(np.reshape(at, (-1, 1, 3)) - frames.positions[ORDER]).max(axis=(0, 2))
        assert apart.min() < 1e-6
        turned = Rotation.from_quat(np.reshape(turn, (-1, 4))).as_matrix()
        assert turned == pytest.approx(frames.rotations[ORDER][:, apart.argmin()], abs=1e-6)
        assert [c.entity_path for c in chunks if c.entity_path.startswith("/world/arm_1/")]  # of the places


def test_layers_are_where_the_page_has_them_and_what_was_lost_is_left_out(chunks, seen):
    dots, arrows, lines, _ = seen.scene.groups[0].layers
    data = columns(chunks, "/world/runs/target_as_read")
    for rank, at in zip(data["worst_first"], data["Points3D:positions"], strict=True):
        own = dots.at[ORDER[rank]]
        assert np.array(at) == pytest.approx(own[np.isfinite(own).all(axis=1)], abs=1e-6)
    data = columns(chunks, "/world/runs/error_of_one")
    for rank, start, way in zip(
        data["worst_first"], data["Arrows3D:origins"], data["Arrows3D:vectors"], strict=True
    ):
        known = np.isfinite(arrows.at[ORDER[rank]]).all(axis=1)
        assert np.array(start) == pytest.approx(arrows.at[ORDER[rank]][known], abs=1e-6)
        assert np.array(start) + np.array(way) == pytest.approx(arrows.to[ORDER[rank]][known], abs=1e-6)
    [strips] = columns(chunks, "/world/runs/path_asked")["LineStrips3D:strips"]
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
    data = columns(on(chunks, "worst_first"), "/here/runs")
    texts = [t[0] for _, t in sorted(zip(data["worst_first"], data["TextDocument:text"], strict=True))]
    assert [text.partition("\n")[0] for text in texts] == [f"**{'abcde'[k]}** {k} mm off" for k in ORDER]
    assert all(f"{x}: " in texts[0] for x in ("rust dots", "green arrows", "green lines"))
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
    colours = [(c >> 24, c >> 16 & 255, c >> 8 & 255) for c in data["Points3D:colors"][0]]
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
    shown = series(chunks, "/charts/places/error_mm/one")
    assert np.array(shown, float) == pytest.approx(mm, nan_ok=True)


def test_the_winner_less_joint_stiffness_has_the_colour_of_the_one_that_errs_less(seen, tmp_path):
    mm = seen.map.lines[0].values
    joints, ours = ModelLine("Joints", look("Joints", "none"), mm), ModelLine("one", LOOK, 0.5 * mm)
    ours.values[1] = 3 * mm[1]
    both = replace(seen.map, lines=[joints, ours])
    assert seen.map.difference is None
    assert both.difference == (ours, joints)
    chunks = sound(written(tmp_path / "a.rrd", replace(seen, map=both)), "It is 3.000 mm off.")
    known = np.isfinite(mm)
    off = (ours.values - mm)[known]
    data = columns(chunks, "/world/map/difference/field")
    colours = [(c >> 24, c >> 16 & 255, c >> 8 & 255) for c in data["Points3D:colors"][0]]
    assert colours == [LOOK.colour if x < 0 else joints.look.colour for x in off]
    assert np.argmax(data["Points3D:radii"][0]) == np.argmax(np.abs(off))
    errs = f"one errs less in {len(off) - 1} of {len(off)} places, by {np.abs(off).max():.3f} mm at most"
    assert errs in document(chunks, "/map_words")
    drawn = seen_plain(replace(seen, map=both))["map"]
    assert [drawn["lines"][k]["name"] for k in drawn["difference"]] == ["one", "Joints"]


def test_lines_have_the_colour_of_their_model_and_a_cross_where_it_has_a_prior(chunks, seen):
    shapes, widths = {}, []
    for line in seen.runs[0].lines:
        data = columns(chunks, f"/charts/runs/left_mm/{line.name}")
        for part in ("SeriesLines:colors", "SeriesPoints:colors"):
            assert [c >> shift & 255 for c in data[part][0] for shift in (24, 16, 8)] == [*line.look.colour]
        assert data["SeriesLines:names"] == [[line.name]]
        widths.append(data["SeriesLines:widths"][0][0])
        shapes[line.name] = data["SeriesPoints:markers"][0][0]
    assert widths[-1] > max(widths[:-1])  # the winner is last
    assert (shapes["one"] == rr.components.MarkerShape.Cross.value) != (
        shapes["other"] == rr.components.MarkerShape.Cross.value
    )


def test_a_map_without_an_arm_is_drawn_alone(seen, tmp_path):
    chunks = sound(written(tmp_path / "a.rrd", PageContent(map=seen.map)), "It is 3.000 mm off.")
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
    assert not rr.strict_mode()


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


def test_a_run_without_a_scene_has_its_figures_and_tables(chart, tmp_path):
    kinds = {kind for _, kind, _ in views(written(tmp_path / "a.rrd", PageContent(), Chart=chart))}
    assert kinds == {"2D", "TextDocument"}
