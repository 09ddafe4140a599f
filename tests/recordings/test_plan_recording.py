"""The recording of a measurement plan, read back from its file."""

import re

import numpy as np
import pytest
from read_back import PLACED, chunks_of, columns, document, layout, on, panes, plotted, rerun, views

from testbench.bench.error_places import Meaning, error_places, places_at
from testbench.model.vjm import chain
from testbench.plant.shapes import body_names, rigid_frames
from testbench.trials.spread import Spread, triple
from testbench.views.colours import look
from testbench.views.recording.error_map import shades, sizes
from testbench.views.recording.error_maps import PlaceScene
from testbench.views.recording.plan import write_plan
from testbench.views.recording.plan_world import PlanScene
from testbench.views.recording.stream import Header
from testbench.views.recording.swept import Point, Sweep
from testbench.views.scale import scale_of, shares
from testbench.views.schema import Column

BUDGET = 2**20
POSES, STATION, LOADS = 5, (4.5, -2.5, 1.6), (230.0, 460.3)
CHART = "/other_plans_mm"
HEADER = Header("pose_selection", "{}", 1)
MEANS = Meaning("expected error", "of a predicted deflection", "RMS")
RIVAL, OURS = "MLS56", "ALL153 + prior"
WITHOUT = 3  #: Places where the rival has no bound.


def sweep():
    points = [
        Point(n, name, Spread(a / n, 0.8 * a / n, 1.3 * a / n))
        for n in (4, 8)
        for name, a in (("plan", 1), ("random", 2))
    ]
    error = Column("error", "RMS error in the tasks", "mm")
    looks = {"plan": look("MGCO56", "psd"), "random": look("MLS56", "none")}
    return Sweep(Column("poses", "poses"), error, points, looks)


def plan(cell, poses=POSES, candidates=300, field=40, **changes):
    """Poses drawn evenly over the joint limits, whatever they collide with, and a smooth error."""
    rng = np.random.default_rng(7)
    lower, upper = cell.arm.limits
    q = rng.uniform(lower, upper, (poses, len(lower)))
    every_q = rng.uniform(lower, upper, (candidates + field + 9, len(lower)))
    some = chain(cell.vjm, every_q).position
    error = 0.05 + 0.02 * np.linalg.norm(some - [2, 0, 1.5], axis=1)
    every = {
        "station": STATION,
        "payload": np.array(LOADS)[np.arange(poses) % 2],
        "candidates": some[field + 9 :],
        "q": q,
        "pose_words": [f"**Step {k + 1}**" for k in range(poses)],
        "deflection_mm": np.linspace(3, 9, poses),
        "error_mm": np.linspace(0.2, 0.05, poses),
        "map": map_of(cell, every_q[9 : field + 9], error[9 : field + 9], (some[:9], error[:9])),
        "summary": "### Which poses?\n\n#### **These 5: 0.07 mm**",
        "tables": "### Criteria compared\n\n| D | 0.1 |",
        "sweep": sweep(),
        "sweep_words": "### How many poses are enough?",
    }
    return PlanScene(cell=cell, **every | changes)


def map_of(cell, q, error, tasks):
    """The rival errs three times as much, and at some places nobody knows how much."""
    at = places_at(cell.arm, q, chain(cell.vjm, q).position, np.ones(len(q)))
    theirs = [*[None] * WITHOUT, *(3 * error[WITHOUT:]).tolist()]
    found = error_places(at, {RIVAL: theirs, OURS: error.tolist()}, [RIVAL, OURS], MEANS)
    return PlaceScene(found, tasks={OURS: tasks})


def recorded(path, scene):
    write_plan(path, HEADER, scene)
    return chunks_of(path)


@pytest.fixture(scope="module")
def scene(kr500):
    return plan(kr500)


@pytest.fixture(scope="module")
def file(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "recording.rrd"
    write_plan(path, HEADER, scene)
    return path


@pytest.fixture(scope="module")
def chunks(file):
    return chunks_of(file)


@pytest.fixture(scope="module")
def markers(kr500, scene):
    """Markers of every pose by Pinocchio's kinematics, (poses, m, 3) [m]: the recording has MuJoCo's."""
    where = chain(kr500.vjm, scene.q)
    return where.position[:, None] + kr500.vjm.markers @ where.rotation.swapaxes(1, 2)


def test_the_file_is_one_whole_recording_and_equal_plans_are_equal(file, scene, tmp_path):
    assert "1 file verified without error" in rerun("verify", file)[1]
    again = tmp_path / "again.rrd"
    write_plan(again, HEADER, scene)
    assert rerun("compare", "--unordered", file, again)[0] == 0


def check_views(file, chunks):
    for origin, *_ in views(file):
        assert [c for c in chunks if f"{c.entity_path}/".startswith(f"/{origin}/")], origin
    assert max(panes(file)) <= 8


def test_every_view_has_data_under_its_origin(file, chunks):
    assert len(panes(file)) == 4
    check_views(file, chunks)


def test_every_number_has_its_unit_in_the_title_of_its_view(file):
    for origin, kind, name in views(file):
        assert kind == "TextDocument" or re.search(r"\((m|mm|log10 mm)\)", name), (origin, name)


def test_entities_are_few_and_in_snake_case(chunks):
    paths = {c.entity_path for c in chunks if not c.entity_path.startswith("/__properties")}
    assert len(paths) < 100
    assert all(re.fullmatch(r"(/[a-z][a-z0-9_]*)+", path) for path in paths)


def test_all_that_moves_is_there_in_every_pose_of_the_run(file, chunks):
    assert layout(file)["/time_panel"]["TimePanelBlueprint:timeline"] == [["run"]]
    moving = [c for c in chunks if "run" in c.timeline_names]
    assert {name for c in chunks for name in c.timeline_names} == {"run", "place"}
    for chunk in moving:
        assert columns([chunk], chunk.entity_path)["run"] == list(range(1, POSES + 1)), chunk.entity_path
    assert columns(on(chunks, "run"), "/this_step")["TextDocument:text"][2] == ["**Step 3**"]


def test_the_arm_stands_in_the_pose_of_its_step(chunks, kr500, scene):
    frames = rigid_frames(kr500.room, scene.q)
    at = columns(on(chunks, "run"), "/world/arm/link_6")["Transform3D:translation"]
    expected = frames.positions[:, body_names(kr500.room).index("link_6")]
    assert np.array(at)[:, 0] == pytest.approx(expected, abs=1e-6)  # kept in single precision
    assert not [c for c in chunks if "arm_deflected" in c.entity_path]


def test_lines_of_sight_go_from_the_tracker_to_every_marker(chunks, markers):
    strips = np.array(columns(chunks, "/world/sight")["LineStrips3D:strips"])
    assert strips.shape == (POSES, 3, 2, 3)
    # single precision at up to 5 m, and two readings of the MJCF
    assert strips[:, :, 0] == pytest.approx(np.broadcast_to(STATION, markers.shape), abs=1e-6)
    assert strips[:, :, 1] == pytest.approx(markers, abs=2e-6)
    nominal = columns(chunks, "/world/markers/nominal")["Points3D:positions"]
    assert np.array(nominal) == pytest.approx(markers, abs=2e-6)


def test_planned_positions_are_numbered_and_joined_in_the_order_of_measuring(chunks, kr500, scene):
    tools = chain(kr500.vjm, scene.q).position
    points = columns(chunks, "/world/plan/positions")
    assert points["Points3D:labels"] == [[str(k + 1) for k in range(POSES)]]
    assert np.array(points["Points3D:positions"][0]) == pytest.approx(tools, abs=2e-6)
    (path,) = columns(chunks, "/world/plan/path")["LineStrips3D:strips"]
    assert np.array(path[0]) == pytest.approx(tools, abs=2e-6)


def test_the_weight_of_every_step_hangs_below_the_load_point(chunks, kr500, scene):
    labels = columns(chunks, "/world/load/label")["Points3D:labels"]
    assert labels == [[f"{kg:.4g} kg"] for kg in scene.payload]
    data = columns(chunks, "/world/load/weight")
    half = np.array(data["Boxes3D:half_sizes"])[:, 0]
    assert 7850 * (2 * half).prod(axis=1) == pytest.approx(scene.payload, rel=1e-6)
    where = chain(kr500.vjm, scene.q)
    hook = where.position + where.rotation @ kr500.vjm.load
    hangs = np.array(data["Boxes3D:centers"])[:, 0] - hook
    assert hangs[:, :2] == pytest.approx(0, abs=2e-6)
    assert (hangs[:, 2] < 0).all()


def test_expected_deflection_and_error_are_plotted_over_the_run(chunks, scene):
    drawn = plotted(chunks, "/expected_mm")
    for name, mm in (("deflection", scene.deflection_mm), ("its error", scene.error_mm)):
        np.testing.assert_allclose(drawn[name][:, 0], mm, rtol=PLACED)
    cursor = np.array(columns(chunks, "/expected_mm/cursor")["LineStrips2D:strips"])[:, 0, :, 0]
    values = np.array(columns(chunks, "/expected_mm/value")["Points2D:positions"][0])[:, 0]
    np.testing.assert_allclose(cursor, np.repeat(values[:POSES, None], 2, axis=1))


def brightness(colours):
    return np.asarray(colours, dtype=float) @ [0.2126, 0.7152, 0.0722]


def drawn(chunks, path, kind, size):
    """Red, green and blue of every ball or cube, and its extent."""
    data = columns(chunks, path)
    packed = np.array(data[f"{kind}:colors"][0], dtype=np.uint32)
    colours = np.column_stack([packed >> shift & 255 for shift in (24, 16, 8)])
    return colours, np.array(data[f"{kind}:{size}"][0]).reshape(len(packed), -1)[:, 0]


def test_the_greater_the_error_the_brighter_and_the_larger_on_one_scale_for_all_maps(chunks, scene):
    assert (np.diff(brightness(shades(np.linspace(0, 1, 50)))) > 0).all()
    found, (_, at_tasks) = scene.map.found, scene.map.tasks[OURS]
    theirs, ours = found.errors(RIVAL), found.errors(OURS)
    scale = scale_of(theirs, ours, at_tasks)
    for path, kind, size, mm in (
        ("mls56/field", "Points3D", "radii", theirs[np.isfinite(theirs)]),
        ("all153_prior/field", "Points3D", "radii", ours),
        ("all153_prior/tasks", "Boxes3D", "half_sizes", at_tasks),
    ):
        colours, extent = drawn(chunks, f"/world/error_map/{path}", kind, size)
        assert np.array_equal(colours, shades(scale.shares(mm)))
        order = np.argsort(mm)
        assert (np.diff(brightness(colours[order])) > -1).all()  # 8-bit: each part rounds by a half
        assert (np.diff(extent[order]) >= 0).all()


def test_places_without_a_bound_are_rings_and_come_first(chunks, scene):
    found, rings = scene.map.found, columns(chunks, "/world/error_map/mls56/without_bound")
    at = np.array(found.position_m)
    assert np.array(rings["Ellipsoids3D:centers"][0]) == pytest.approx(at[:WITHOUT], abs=1e-6)
    assert "/world/error_map/all153_prior/without_bound" not in {c.entity_path for c in chunks}
    text = document(chunks, "/error_words")
    assert "Grey rings: no bound" in text
    sizes = found.typical_mm(RIVAL), found.worst[RIVAL].error_mm
    assert "| MLS56 | {:.3f} | {:.3f} | {} |".format(*sizes, WITHOUT) in text


def test_the_arm_goes_to_every_place_and_the_worst_is_named(chunks, kr500, scene):
    found = scene.map.found
    frames = rigid_frames(kr500.room, np.array(found.q))
    at = columns(on(chunks, "place"), "/world/arm/link_6")
    assert at["place"] == list(range(1, len(found.run) + 1))
    expected = frames.positions[:, body_names(kr500.room).index("link_6")]
    assert np.array(at["Transform3D:translation"])[:, 0] == pytest.approx(expected, abs=1e-6)
    for name, path in ((RIVAL, "mls56"), (OURS, "all153_prior")):
        worst = found.worst[name]
        label = columns(chunks, f"/world/error_map/{path}/worst")["Points3D:labels"]
        assert label == [[f"worst {worst.error_mm:.3f} mm, place {worst.place + 1}"]]
    said = columns(on(chunks, "place"), "/this_step")["TextDocument:text"]
    assert said[0][0].startswith(f"**Place 1 of 40: MLS56 no bound, {OURS} ")
    assert f"where {OURS} is worst" in said[found.worst[OURS].place][0]


def test_equal_errors_have_one_colour(kr500, tmp_path):
    same = shares(np.full(3, 0.1), (0.1, 0.1))
    assert len(np.unique(shades(same), axis=0)) == len(np.unique(sizes(same))) == 1
    q = np.random.default_rng(1).uniform(-1, 1, (9, 6))
    equal = map_of(kr500, q, np.full(9, 0.1), (q[:, :3], np.full(9, 0.1)))
    recorded(tmp_path / "x.rrd", plan(kr500, map=equal))


def test_the_key_has_the_ends_of_the_scale_with_their_unit(chunks, scene):
    found, (_, at_tasks) = scene.map.found, scene.map.tasks[OURS]
    scale = scale_of(found.errors(RIVAL), found.errors(OURS), at_tasks)
    numbers = columns(chunks, "/error_key_mm/number")["Points2D:labels"][0]
    assert (numbers[0], numbers[-1]) == tuple(f"{mm:.3f} mm" for mm in scale.ends)


def test_the_summary_is_the_callers_with_colours_and_scrubbing(chunks, scene):
    text = document(chunks, "/summary")
    assert text.startswith(scene.summary)
    assert "Vermillion: tracker" in text
    assert "`run` 1 to 5" in text
    assert document(chunks, "/tables") == "### Criteria compared\n\n| D | 0.1 |"


def test_of_many_candidates_some_are_drawn_evenly_and_the_legend_says_so(kr500, tmp_path):
    scene = plan(kr500, candidates=5000)
    chunks = recorded(tmp_path / "many.rrd", scene)
    (drawn,) = columns(chunks, "/world/candidates")["Points3D:positions"]
    assert len(drawn) == 2000
    ends = scene.candidates[[0, -1]]
    assert np.array(drawn)[[0, -1]] == pytest.approx(ends, abs=1e-6)
    assert "candidates, 2000 of 5000 drawn" in document(chunks, "/summary")


def test_errors_of_other_plans_stand_still_in_a_plot(chunks, scene):
    """A dot is where its error is on the logarithmic axis, its line has the name of its plan."""
    drawn = plotted(chunks, CHART)
    for name in ("plan", "random"):
        expected = [triple(p.y) for p in scene.sweep.line(name)]
        np.testing.assert_allclose(drawn[name], expected, rtol=PLACED)
    assert columns(chunks, f"{CHART}/ticks_x")["Points2D:labels"][0] == ["4", "8"]
    assert document(chunks, "/sweep_words") == scene.sweep_words


@pytest.mark.parametrize(
    ("without", "tabs"), [({"station": None}, 4), ({"sweep": None}, 3), ({"tables": "", "sweep": None}, 2)]
)
def test_a_plan_without_tracker_sweep_or_tables_is_drawn_too(without, tabs, kr500, tmp_path):
    path = tmp_path / "less.rrd"
    chunks = recorded(path, plan(kr500, **without))
    check_views(path, chunks)
    assert len(panes(path)) == tabs
    paths = {c.entity_path for c in chunks}
    assert ("/world/sight" in paths) == ("station" not in without)
    assert ("Vermillion" in document(chunks, "/summary")) == ("station" not in without)
    assert (f"{CHART}/value" in paths) == ("sweep" not in without)


def test_one_pose_without_candidates_is_a_plan(arm_6r, tmp_path):
    path = tmp_path / "one.rrd"
    check_views(path, recorded(path, plan(arm_6r, poses=1, candidates=0)))


def test_a_large_plan_stays_within_its_budget(kr500, tmp_path):
    path = tmp_path / "large.rrd"
    write_plan(path, HEADER, plan(kr500, poses=12, candidates=5000, field=200))
    assert path.stat().st_size < BUDGET
