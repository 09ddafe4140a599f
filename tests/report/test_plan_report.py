"""What people see of a plan is what it promises: sentences, tables, files and drawing of a small real one."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reports import check
from rich.console import Console

from testbench.arm.folder import Joint
from testbench.campaign.open_laws import OpenLaw
from testbench.campaign.plan import Planned, plan_for
from testbench.campaign.plan_input import FORCE, read_loads, read_tasks
from testbench.campaign.plan_settings import PlanSettings
from testbench.campaign.predicted_error import Expected, Unshown
from testbench.commands.plan import WORST, printed, report
from testbench.commands.plan_drawn import OURS, WORK, plan_columns, seen, write_poses, write_tasks
from testbench.commands.plan_numbers import numbers
from testbench.model.load import weight
from testbench.model.vjm import chain, tool_points
from testbench.report.table import Row
from testbench.views import terminal
from testbench.views.colours import look

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
    return replace(found, plan=replace(found.plan, load=np.array([0, 2, 1, 2, 0])))


@pytest.fixture(scope="module")
def f(made):
    return numbers(made)


def mm(metres):
    return [pytest.approx(x) for x in (1e3 * np.asarray(metres)).tolist()]


def test_a_row_of_the_plan_is_its_pose_load_error_and_way(made, f, kr500):
    plan = made.plan
    assert [row.q for row in f.plan] == plan.q.tolist()
    np.testing.assert_allclose([row.q_shown for row in f.plan], np.rad2deg(plan.q))
    np.testing.assert_allclose([row.tool_m for row in f.plan], chain(kr500.vjm, plan.q).position)
    for rows, forecast in ((f.plan, made.poses), (f.tasks, made.forecast)):
        for end, own in (("", forecast.error), ("_p05", forecast.low), ("_p95", forecast.high)):
            assert [row[f"expected_error{end}_mm"] for row in rows] == mm(own)
    assert f.error_mm == Expected(
        *mm([made.forecast.overall, made.forecast.overall_low, made.forecast.overall_high])
    )
    loads = {0: "460 kg", 1: "150.5 kg", 2: "pull -500, 3000, 0 N"}
    assert [row.load for row in f.plan] == [loads[k] for k in plan.load]
    assert [row.pull_N for row in f.plan] == [list(PULL) if k == 2 else None for k in plan.load]
    assert [row.load_kg for row in f.plan] == [(460.0, 150.5, 0.0)[k] for k in plan.load]
    turned = np.rad2deg(np.abs(np.diff(plan.q, axis=0)).max(axis=1))
    np.testing.assert_allclose([row.travel_deg for row in f.plan], [0, *turned])
    half = 1.96 * 1.2 * np.median(made.forecast.deviation)  # 1.2: how much wider plans are, see BROAD
    assert f.half_width_95_mm == pytest.approx(1e3 * half, rel=1e-4)
    [level] = [row for row in f.curve if row.poses == POSES]
    assert level.random_p10_mm == f.random_plans.best_tenth_mm < level.random_p90_mm
    assert level.greedy_mm == f.greedy_mm[POSES - 1]
    lower, upper = kr500.arm.limits
    margins = np.rad2deg(np.minimum(plan.q.min(axis=0) - lower, upper - plan.q.max(axis=0)))
    np.testing.assert_allclose(f.margins, margins)


def test_a_report_says_all_of_it_and_the_terminal_has_room(f, kr500):
    said = report(f, kr500.arm)
    page = check(said, [])
    assert page.startswith(
        "# Plan\n\nCalibration plan: kr500_l480, MGCO56, 460 kg or 150.5 kg or pull -500, 3000, 0 N\n\n"
    )
    console = Console(width=80)
    free = console.options.update(width=800)  # else the console's width is the most it measures
    assert console.measure(terminal.grid(printed(said)), options=free).maximum <= 80
    weights = [Row(row, load="460 kg") for row in f.plan]
    hung_ = printed(report(changed(f, pulls_n=(), plan=weights), kr500.arm))
    assert console.measure(terminal.grid(hung_), options=free).maximum <= 80
    assert [c.key in [own.key for own in printed(said).columns] for c in hung_.columns].count(False) == 1
    worst = sorted(f.tasks, key=lambda row: -row.expected_error_mm)[:WORST]
    assert [row.task for row in said.tables["tasks"].rows] == [row.task for row in worst]
    for name, rows in (("poses", f.plan), ("tasks", worst)):
        for shown, row in zip(said.tables[name].rows, rows, strict=True):
            low, high = row.expected_error_p05_mm, row.expected_error_p95_mm
            own = shown.error_there_mm
            assert (own.median, own.p05, own.p95) == (row.expected_error_mm, low, high)
    assert f"Worst in task {worst[0].task}, tool at x {worst[0].tool_m[0]:.2f}" in said.worst
    long = report(changed(f, plan=9 * f.plan), kr500.arm)
    assert len(long.tables["poses"].rows) == 40
    assert "the first 40, all are in plan.csv" in long.whole()


def changed(f, **parts):
    """The numbers with others; of a part that is a row some of its own."""
    return Row(f, **{key: Row(f[key], **own) if isinstance(own, Row) else own for key, own in parts.items()})


def test_the_answer_has_error_interval_rivals_and_efficiency(f, kr500):
    f = changed(
        f,
        error_mm=Expected(0.234, 0.123, 0.345),
        joints_alone_mm=0.789,
        random_plans=Row(planned_mm=0.111, median_mm=0.456),
        certificate=Row(efficiency=0.8999),  # never rounded up
    )
    first = (
        "5 poses leave an expected error of 0.234 mm at the tasks (90 %: 0.123 to 0.345); joint stiffness "
        "only leaves 0.789 mm. "
    )
    chance = "the median of 200 random plans 0.456 mm; this plan is at least 89 % efficient."
    assert report(f, kr500.arm).answer == f"{first}Were the arm MGCO56 alone: 0.111 mm, {chance}"
    chance = "The median of 200 random plans leaves 0.456 mm; this plan is at least 89 % efficient"
    alike = changed(f, random_plans=Row(planned_mm=0.2341), criterion="D")
    assert report(alike, kr500.arm).answer == f"{first}{chance} by criterion D."
    assert "random plans no bound;" in report(changed(f, random_plans=Row(median_mm=None)), kr500.arm).answer


KNOWN = {"error_mm": Expected(0.234, 0.1, 0.3), "joints_alone_mm": 0.5, "unshown": None, "open_laws": []}
ADVICE = {"target_mm": 0.1, "examined_up_to": 40, "more": 4, "little_percent": 10.0}
SAID = [
    ({"tracker_m": None}, "**Visibility was NOT checked**", "NOT"),
    ({"blocked": [2, 4]}, "collides** before runs 2 and 4: go", "collides**"),
    ({"blocked": [2]}, "collides** before run 2: go", "collides**"),
    ({"surrounded": False}, "`--floor-z METRES` adds one", "floor-z"),
    ({"joints_alone_mm": 0.233}, "Joint stiffness only is no worse here", "no worse"),
    (
        {"directions": Row(hidden_mm=0.118)},
        "**0.118 mm of the error rest on the prior alone**",
        "prior alone",
    ),
    (
        {"directions": Row(hidden_mm=0.2), "unshown": Unshown(["swing"], ["swing"], [0, 4e3, 0])},
        "**No load turns swing**, the tasks do: of 0.234 mm expected there 0.200 mm stay open, whatever is "
        "measured. `--pull 0,4000,0` would turn swing.",
        "No load turns",
    ),
    (
        {"unshown": Unshown(["bend", "turn"], [], None)},
        "**No load turns bend and turn**, the tasks do: of 0.234 mm expected there 0.116 mm stay open, "
        "whatever is measured. No force at the load point does.",
        "No load turns",
    ),
    ({"pulls_n": (PULL,)}, "**No rope was checked**", "rope"),
    (
        {"open_laws": [OpenLaw("friction", list("abcdef"), "the same again", ["c"], ["a", "b"])]},
        "**Friction of all joints stays mostly open.** One more reading in every pose tells that of c: the "
        "same again. No reading examined tells that of a and b.",
        "mostly open",
    ),
    (
        {"open_laws": [OpenLaw("backlash", ["b"], None, [], ["b"])]},
        "**Backlash of b stays mostly open.** No reading examined tells it.",
        "mostly open",
    ),
    (
        {"advice": Row(ADVICE, fewest=1, enough=17)},
        "1 pose reaches 0.1 mm at the tasks. From 17 on, 4 more",
        "",
    ),
    (
        {"advice": Row(ADVICE, fewest=None, enough=None)},
        "No plan of up to 40 poses reaches 0.1 mm at the tasks. Up to 40 poses, 4 more always bring 10 %",
        "",
    ),
    ({"half_width_95_mm": 0.678}, "along an axis at the tasks is known to +- 0.678 mm (95 %, median)", ""),
]


@pytest.mark.parametrize(("parts", "words", "else_not"), SAID)
def test_what_must_not_be_overlooked_is_said_where_it_holds_only(f, kr500, parts, words, else_not):
    quiet = changed(f, **KNOWN, directions=Row(hidden_mm=0.116), surrounded=True, blocked=[], pulls_n=())
    assert words in " ".join(report(changed(quiet, **parts), kr500.arm).claims)
    if else_not:
        assert else_not not in " ".join(report(quiet, kr500.arm).claims)


def test_what_it_rests_on_is_told_with_and_without_a_prior(f, kr500):
    known = Row(unknowns=68, shown=49, seen=36, outweighed=15, prior_share_percent=24.4)
    counts = {"found": 40, "drawn": 5132, "rejected": {"too far": 12, "too near": 0, "it hits": 2080}}
    f = changed(
        f,
        directions=known,
        error_if_prior_twice_as_uncertain_mm=Expected(0.456, 0.4, 0.5),
        error_mm=Expected(0.234, 0.1, 0.3),
        margins=[1.25, 20.0, 30.0, 40.0, 50.0, 60.0],
        candidates=Row(counts),
        candidates_wanted=50,
        certificate=Row(efficiency=0.5, examined=5132),
    )
    text = report(f, kr500.arm).whole()
    for words in (
        "68 unknowns: these loads can show 49 directions, the plan sees 36; in 15 of them the readings say",
        "Were it twice as uncertain: 0.456 mm in place of 0.234.",
        "The prior leaves 24 % of the mean square error",
        "within 30 % of the folder. Intervals were tried for all links and joints with the prior; what",
        "White noise of 50 um",
        "No choice of 5 among the 5,132 examined can be better than 2.000 times this plan by criterion test.",
        "at least joint_1 1.2 deg, joint_2 20.0 deg",
        "40 feasible poses of 50 wanted of 5,132 drawn evenly over the joint limits. Refused: it hits 2,080, "
        "too far 12.",
    ):
        assert words in text
    bare = report(changed(f, prior=None, uncertainty_percent=None), kr500.arm).whole()
    assert "No prior: what these loads do not show stays unknown" in bare
    assert "Intervals were tried on arms that bend" in report(changed(f, whole_arm=True), kr500.arm).whole()


@pytest.mark.parametrize("sliding", [None, "joint_2"])
def test_the_files_hold_the_numbers_of_the_report(f, tmp_path, sliding):
    joints = [Joint(name, -99, 99, 1e-6, name == sliding) for name in f.joints]
    plan, tasks = tmp_path / "plan.csv", tmp_path / "tasks.csv"
    write_poses(f, joints, plan)
    write_tasks(f, joints, tasks)
    runs, work = ([*csv.DictReader(path.read_text().splitlines())] for path in (plan, tasks))
    assert list(runs[0]) == plan_columns(joints, pulls=True)
    expected = [name for name in runs[0] if name.startswith("expected_")]
    assert list(work[0]) == ["task", *(joint.shown_column for joint in joints), *expected]
    for cells, row in zip(runs + work, f.plan + f.tasks, strict=True):
        shown = [float(cells[joint.shown_column]) for joint in joints]
        assert shown == pytest.approx(row.q_shown, abs=5e-5)
        for key in (*expected, *(key for key in ("travel_deg", "travel_mm") if key in cells)):
            assert float(cells[key]) == pytest.approx(row[key], abs=5e-3)
    assert [[float(cells[joint.column]) for joint in joints] for cells in runs] == [row.q for row in f.plan]
    np.testing.assert_array_equal(read_loads(plan)[0], [row.load_kg for row in f.plan])
    np.testing.assert_array_equal(read_loads(plan)[1], [row.pull_N or [0, 0, 0] for row in f.plan])
    assert {cells[FORCE[0]] for cells in runs} <= {"", "-500.0"}
    write_poses(changed(f, pulls_n=()), joints, plan)
    assert not {*FORCE} & {*plan.read_text().splitlines()[0].split(",")}


def test_what_is_drawn_of_a_plan_are_its_poses_loads_and_errors(made, f, kr500):
    drawn = seen(made, report(f, kr500.arm))
    order, work, places = drawn.scene.groups
    layers, q = {layer.name: layer for layer in order.layers}, made.plan.q
    np.testing.assert_allclose(layers["planned, in order"].at[0], [row.tool_m for row in f.plan])
    np.testing.assert_allclose(layers["tasks"].at[0], [row.tool_m for row in f.tasks])
    np.testing.assert_allclose(layers["tracker"].at[0, 0], f.tracker_m)
    sights = layers["lines of sight"]
    np.testing.assert_allclose(sights.at, np.broadcast_to(f.tracker_m, sights.at.shape))
    np.testing.assert_allclose(sights.to, tool_points(kr500.vjm, q, kr500.vjm.markers))
    load = layers["load"]
    np.testing.assert_allclose(load.at, tool_points(kr500.vjm, q, kr500.vjm.load[None]))
    ways = np.array([row.pull_N or [0, 0, -1] for row in f.plan], dtype=float)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    np.testing.assert_allclose((load.to - load.at)[:, 0], 0.2 * kr500.vjm.reach * ways, atol=1e-12)
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
        np.testing.assert_allclose(line.values, f.map.errors(line.name))
    assert drawn.map.lines[-1].look == OURS


def test_the_default_has_the_colour_that_it_has_in_a_fit_and_not_nearly_that_of_joints_alone():
    assert look("ALL153", "psd", prior=True) == OURS
    assert np.abs(np.subtract(OURS.colour, look("Joints", "none").colour)).max() > 80


def test_without_a_tracker_nothing_is_drawn_of_it(made, f, kr500):
    own = changed(f, tracker_m=None)
    alone = seen(
        Planned(**vars(made) | {"settings": replace(made.settings, tracker_m=None)}), report(own, kr500.arm)
    )
    assert not {"tracker", "lines of sight"} & {layer.name for layer in alone.scene.groups[0].layers}
