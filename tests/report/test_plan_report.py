"""What people see of a plan is what it promises: sentences, tables, files and drawing of a small real one."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reports import check
from rich.console import Console

from testbench.arm.folder import ArmJoint
from testbench.cli.plan import WORST_TASKS, report
from testbench.model.load import weight
from testbench.model.vjm import evaluate_chain, tool_points
from testbench.report import terminal
from testbench.report.planned_poses import OURS, WORK, poses_for_terminal, seen
from testbench.report.table import Row
from testbench.workflows.plan import Planned, plan_for
from testbench.workflows.plan_input import FORCE_COLUMNS, read_loads, read_tasks
from testbench.workflows.plan_numbers import _listed, numbers, write_poses, write_tasks
from testbench.workflows.plan_settings import PlanSettings
from testbench.workflows.predicted_error import Expected

TASKS = Path(__file__).resolve().parents[2] / "docs" / "tasks.csv"
POSES, PULL = 5, (-500.0, 3000.0, 0.0)


@pytest.fixture(scope="module")
def made(kr500):
    asked = PlanSettings(
        loads_kg=(460.0, 150.5),
        pulls_n=(PULL,),
        poses=POSES,
        candidates_wanted=40,
        model="MGCO56",
        tracker_m=(4.5, -2.5, 1.6),
    )
    found = plan_for(kr500, asked, read_tasks(TASKS, kr500, weight(kr500.vjm, 460.0)))
    return replace(found, plan=replace(found.plan, load_index=np.array([0, 2, 1, 2, 0])))


@pytest.fixture(scope="module")
def f(made):
    return numbers(made)


def mm(metres):
    return [pytest.approx(x) for x in (1e3 * np.asarray(metres)).tolist()]


def test_a_row_of_the_plan_is_its_pose_load_error_and_way(made, f, kr500):
    plan = made.plan
    assert [row.q for row in f.plan] == plan.q.tolist()
    np.testing.assert_allclose([row.q_shown for row in f.plan], np.rad2deg(plan.q))
    np.testing.assert_allclose(
        [row.tool_m for row in f.plan], evaluate_chain(kr500.vjm, plan.q).tool_position
    )
    for rows, forecast in ((f.plan, made.poses), (f.tasks, made.forecast)):
        ends = {"": forecast.rms_error, "_p05": forecast.percentile_5, "_p95": forecast.percentile_95}
        for end, own in ends.items():
            assert [row[f"expected_error{end}_mm"] for row in rows] == mm(own)
    assert f.error_mm == Expected(
        *mm(
            [
                made.forecast.overall_rms_error,
                made.forecast.overall_percentile_5,
                made.forecast.overall_percentile_95,
            ]
        )
    )
    loads = {0: "460 kg", 1: "150.5 kg", 2: "pull -500, 3000, 0 N"}
    assert [row.load for row in f.plan] == [loads[k] for k in plan.load_index]
    assert [row.pull_N for row in f.plan] == [list(PULL) if k == 2 else None for k in plan.load_index]
    assert [row.load_kg for row in f.plan] == [(460.0, 150.5, 0.0)[k] for k in plan.load_index]
    turned = np.rad2deg(np.abs(np.diff(plan.q, axis=0)).max(axis=1))
    np.testing.assert_allclose([row.travel_deg for row in f.plan], [0, *turned])
    half = 1.96 * 1.2 * np.median(made.forecast.axis_deviation)  # 1.2: how much wider plans are, see BROAD
    assert f.half_width_95_mm == pytest.approx(1e3 * half, rel=1e-4)
    [level] = [row for row in f.curve if row.poses == POSES]
    assert level.random_p10_mm == f.random_plans.best_tenth_mm < level.random_p90_mm
    assert level.greedy_mm == f.greedy_mm[POSES - 1]
    lower, upper = kr500.arm.limits
    margins = np.rad2deg(np.minimum(plan.q.min(axis=0) - lower, upper - plan.q.max(axis=0)))
    np.testing.assert_allclose(f.margins, margins)


def test_a_report_says_all_of_it_and_the_terminal_has_room(f):
    said = report(f)
    page = check(said, ["beside"])
    loads = "460 kg or 150.5 kg or pull -500, 3000, 0 N"
    assert f"Calibration plan: kr500_l480, GCO of beam links (MGCO56), {loads}\n\n" in page
    console = Console(width=80)
    free = console.options.update(width=800)  # else the console's width is the most it measures
    six = "P1:x P2:y P3:z P1:z P2:z P3:y"
    read = changed(f, gauges=6, gauge_um=5.0, plan=[Row(row, gauges=six) for row in f.plan])
    for own in (f, read):
        hung = changed(own, pulls_n=(), plan=[Row(row, load="460 kg") for row in own.plan])
        tables = [poses_for_terminal(report(each)) for each in (own, hung)]
        for table in tables:
            assert console.measure(terminal.grid(table), options=free).maximum <= 80
            assert own is f or table.columns[-1].cell(table.rows[0]).split() == six.split()
    worst = sorted(f.tasks, key=lambda row: -row.expected_error_mm)[:WORST_TASKS]
    assert [row.task for row in said.tables["tasks"].rows] == [row.task for row in worst]
    for name, rows in (("poses", f.plan), ("tasks", worst)):
        for shown, row in zip(said.tables[name].rows, rows, strict=True):
            own = shown.error_there_mm
            low, high = row.expected_error_p05_mm, row.expected_error_p95_mm
            assert (own.median, own.p05, own.p95) == (row.expected_error_mm, low, high)
    long = report(changed(f, plan=9 * f.plan))
    assert (len(long.tables["poses"].rows), len(long.tables["tasks"].rows)) == (40, WORST_TASKS)


def changed(f, **parts):
    """The numbers with others; of a part that is a row some of its own."""
    return Row(
        f, **{key: Row(f[key] or {}, **own) if isinstance(own, Row) else own for key, own in parts.items()}
    )


@pytest.mark.parametrize(
    ("random", "said"),
    [
        (0.468, "2.0x lower than with random poses (median of 200 plans: 0.468 mm)"),
        (0.117, "2.0x higher than with random poses (median of 200 plans: 0.117 mm)"),
        (None, "where random poses give no bound (median of 200 plans)"),
    ],
)
def test_the_answer_says_by_how_much_the_plan_beats_random_poses(f, random, said):
    own = changed(f, error_mm=Expected(0.234, 0.1, 0.3), random_plans=Row(plans=200, median_mm=random))
    answer = f"Expected error at the tasks: 0.234 mm, {said}. 90 % interval: 0.100 to 0.300 mm."
    assert report(own).answer == answer


def listed(f, **parts):
    """The numbers with others, and the rows that follow from them."""
    own = changed(f, **parts)
    return Row(own, **_listed(own))


KNOWN = {"error_mm": Expected(0.234, 0.1, 0.3), "joints_alone_mm": 0.5, "unshown": None, "open_laws": []}
QUIET = {**KNOWN, "directions": Row(hidden_mm=0.116), "unloaded": None, "surrounded": True, "blocked": []}
SAID = [
    ({"tracker_m": None}, "Visibility"),
    ({"blocked": [2, 4]}, "collides** on the way to run 2 and 4"),
    ({"surrounded": False}, "floor-z"),
    ({"joints_alone_mm": 0.233}, "no larger"),
    ({"directions": Row(hidden_mm=0.118)}, "0.118 mm"),
    ({"unloaded": Row(joints=["swing"], force_N=[0.0, 900.0, 0.0], error_mm=1.25)}, "1.250 mm"),
    ({"unshown": Row(joints=["swing"], turned_by_pull=["swing"], pull_N=[0, 4e3, 0])}, "--pull 0,4000,0"),
    ({"unshown": Row(joints=["bend", "turn"], turned_by_pull=[], pull_N=None)}, "bend and turn"),
    ({"pulls_n": (PULL,)}, "rope"),
    (
        {"open_laws": [Row(kind="friction", joints=["a", "c"], by="the same readings again", told=["c"])]},
        "The same readings again in each pose would determine it for c",
    ),
    ({"open_laws": [Row(kind="backlash", joints=["b"], by=None, told=[])]}, "Backlash"),
]


@pytest.mark.parametrize(("parts", "words"), SAID)
def test_what_must_not_be_overlooked_is_a_warning_where_it_holds_only(f, parts, words):
    quiet = changed(f, **QUIET, pulls_n=())
    assert words in " ".join(report(changed(quiet, **parts)).claims)
    assert report(quiet).claims == []


def test_what_it_rests_on_is_in_tables_with_and_without_a_prior(f):
    known = Row(unknowns=68, shown=49, seen=36, outweighed=15, prior_share_percent=24.4)
    own = listed(
        f,
        directions=known,
        error_if_prior_twice_as_uncertain_mm=Expected(0.456, 0.4, 0.5),
        joints_alone_mm=0.789,
        margins=[1.25, 20.0, 30.0, 40.0, 50.0, 60.0],
        candidates=Row(found=40, drawn=5132, rejected={"too far": 12, "it hits": 2080}),
        certificate=Row(efficiency=0.5, examined=5132),
    )
    page = check(report(own), [])
    for row in (
        "| this plan, with a prior twice as uncertain | 0.456 |",
        "| this plan, with Joints-only | 0.789 |",
        "| directions in which readings outweigh the prior | 15 |",
        "| lower bound of the plan's efficiency (criterion test), % | 50 |",
        "| joint_1 | 1.2 | deg |",
        "| it hits | 2,080 |",
    ):
        assert row in page, row
    bare = listed(own, prior=None, uncertainty_percent=None, error_if_prior_twice_as_uncertain_mm=None)
    assert "prior twice" not in report(bare).whole()


@pytest.mark.parametrize("sliding", [None, "joint_2"])
def test_the_files_hold_the_numbers_of_the_report(f, tmp_path, sliding):
    joints = [ArmJoint(name, -99, 99, 1e-6, name == sliding) for name in f.joints]
    plan, tasks = tmp_path / "plan.csv", tmp_path / "tasks.csv"
    write_poses(f, joints, plan)
    write_tasks(f, joints, tasks)
    runs, work = ([*csv.DictReader(path.read_text().splitlines())] for path in (plan, tasks))
    angles = [*(j.file_column for j in joints), *(j.display_column for j in joints)]
    assert list(runs[0])[: len(angles) + 2] == ["run", *angles, "load_kg"]
    assert list(runs[0])[-1] == "way"
    expected = [name for name in runs[0] if name.startswith("expected_")]
    assert list(work[0]) == ["task", *(joint.display_column for joint in joints), *expected]
    for cells, row in zip(runs + work, f.plan + f.tasks, strict=True):
        shown = [float(cells[joint.display_column]) for joint in joints]
        assert shown == pytest.approx(row.q_shown, abs=5e-5)
        for key in (*expected, *(key for key in ("travel_deg", "travel_mm") if key in cells)):
            assert float(cells[key]) == pytest.approx(row[key], abs=5e-3)
    assert [[float(cells[joint.file_column]) for joint in joints] for cells in runs] == [
        row.q for row in f.plan
    ]
    np.testing.assert_array_equal(read_loads(plan)[0], [row.load_kg for row in f.plan])
    np.testing.assert_array_equal(read_loads(plan)[1], [row.pull_N or [0, 0, 0] for row in f.plan])
    assert {cells[FORCE_COLUMNS[0]] for cells in runs} <= {"", "-500.0"}
    write_poses(changed(f, pulls_n=()), joints, plan)
    assert not {*FORCE_COLUMNS} & {*plan.read_text().splitlines()[0].split(",")}


def test_what_is_drawn_of_a_plan_are_its_poses_loads_and_errors(made, f, kr500):
    drawn = seen(made, f)
    order, work, places = drawn.scene.groups
    layers, q = {layer.name: layer for layer in order.layers}, made.plan.q
    np.testing.assert_allclose(layers["planned poses"].at[0], [row.tool_m for row in f.plan])
    np.testing.assert_allclose(layers["tasks"].at[0], [row.tool_m for row in f.tasks])
    np.testing.assert_allclose(layers["tracker"].at[0, 0], f.tracker_m)
    sights = layers["lines of sight"]
    np.testing.assert_allclose(sights.at, np.broadcast_to(f.tracker_m, sights.at.shape))
    np.testing.assert_allclose(sights.to, tool_points(kr500.vjm, q, kr500.vjm.markers))
    hook = tool_points(kr500.vjm, q, kr500.vjm.load_point[None])
    hangs = np.array([not row.pull_N for row in f.plan])
    ways = np.array([row.pull_N or [0, 0, -1] for row in f.plan], dtype=float)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    there = np.zeros(len(f.plan), dtype=int)
    for load in (own for own in order.layers if own.name.startswith(("load", "force"))):
        here = np.isfinite(load.at[:, 0, 0])
        there += here
        assert (hangs[here] == (load.kind == "weights")).all()
        way = (load.to - load.at)[here, 0]
        np.testing.assert_allclose(way / np.linalg.norm(way, axis=1)[:, None], ways[here], atol=1e-9)
        assert (np.isclose(load.at[here], hook[here]) | np.isclose(load.to[here], hook[here])).all()
    assert (there == 1).all()  # each pose has its own load
    at_tasks, at_poses = drawn.runs
    assert [chart.group for chart in drawn.runs] == [1, 0]
    for chart, rows, own in ((at_tasks, f.tasks, WORK), (at_poses, f.plan, OURS)):
        [line] = chart.lines
        keys = [f"expected_error{end}_mm" for end in ("", "_p05", "_p95")]
        wanted = np.transpose([[row[key] for key in keys] for row in rows])
        np.testing.assert_allclose([line.values, *line.ends], wanted)
        assert line.look == own
        assert "(mm)" in chart.title
    for group, rows, name in ((order, f.plan, "Run"), (work, f.tasks, "Task")):
        assert list(group.names) == [f"{name} {k}" for k in range(1, len(rows) + 1)]
        for words, row in zip(group.words, rows, strict=True):
            assert (
                f"deflection {row.expected_deflection_mm:.2f} mm, error {row.expected_error_mm:.3f} mm"
                in words
            )
    assert work.first == int(np.argmax([row.expected_error_mm for row in f.tasks]))
    assert (len(places.names), drawn.map.group) == (len(f.map.run), 2)
    np.testing.assert_allclose(drawn.map.at, f.map.position_m)
    for line in drawn.map.lines:
        np.testing.assert_allclose(line.values, f.map.error_mm[line.name])
    assert drawn.map.lines[-1].look == OURS


def test_without_a_tracker_nothing_is_drawn_of_it(made, f):
    own = changed(f, tracker_m=None)
    alone = seen(Planned(**vars(made) | {"settings": replace(made.settings, tracker_m=None)}), own)
    assert not {"tracker", "lines of sight"} & {layer.name for layer in alone.scene.groups[0].layers}
