"""What people see of a plan equals its report, for reports that are made up."""

import csv
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from checks import bands, check_report, check_table, curves, tables_of, unit_in
from made_up import fill, filled

from testbench.arm.folder import Joint
from testbench.bench.error_places import Places, error_places
from testbench.bench.plan import Planned
from testbench.bench.plan_input import FORCE, read_payload, read_pulls
from testbench.bench.plan_report import CurveRow, Expected, PlanReport, PoseRow, TaskRow
from testbench.bench.plan_unshown import Unshown
from testbench.data.posefile import plan_columns
from testbench.model.vjm import tool_points
from testbench.views.plan.figure import overview
from testbench.views.plan.files import write_poses, write_tasks
from testbench.views.plan.page import seen
from testbench.views.plan.tables import tables, words

sys.path.append(str(Path(__file__).parents[1] / "recordings"))

JOINTS = ["swing", "boom", "arm", "roll", "bend", "turn"]
POSES, TASKS, MOST = 4, 7, 9
BEHIND = {
    "load, kg": "load_kg",
    "deflection, mm": "expected_deflection_mm",
    "error there, mm": "error_mm",
    "travel, deg": "travel_deg",
    "way": "way",
}
CURVE = {
    "poses": "poses",
    "best next pose, mm": "greedy_mm",
    "random median, mm": "random_median_mm",
    "random 10 %, mm": "random_p10_mm",
    "random 90 %, mm": "random_p90_mm",
}


def angles(rng):
    return rng.uniform(20, 90, len(JOINTS)).tolist()


@pytest.fixture
def report(rng):
    """Numbers distinct, errors in another order than the tasks."""
    poses = [{"run": k + 1, "q_shown": angles(rng), "q": angles(rng)} for k in range(POSES)]
    tasks = [{"task": k + 1, "q_shown": angles(rng)} for k in range(TASKS)]
    error = sorted(rng.uniform(0.02, 0.9, MOST), reverse=True)
    counts = [{"poses": n, "greedy_mm": error[n - 1]} for n in (2, 4, MOST)]
    return fill(
        PlanReport,
        rng,
        arm="heavy",
        joints=JOINTS,
        units=["deg"] * len(JOINTS),
        margins=[1.25, 20.0, 30.0, 40.0, 50.0, 60.0],
        surrounded=True,
        poses=POSES,
        criterion="test",
        plan=filled(PoseRow, rng, poses, way="clear", pull_N=None),
        tasks=filled(TaskRow, rng, tasks),
        greedy_mm=error,
        curve=[fill(CurveRow, rng, **row) for row in counts],
        error_mm=Expected(0.234, 0.123, 0.345),
        map=places_of(rng),
        loads_kg=(460.0, 150.5),
        pulls_n=(),
        unshown=None,
        acceptance_deg=None,
        box_m=None,
        workspace_error_mm=Expected(0.71, 0.61, 0.81),
    )


def test_a_slides_coordinate_is_told_in_millimetres(report):
    sliding = replace(report, units=["deg", "mm", "deg", "deg", "deg", "deg"])
    [row] = report.plan[1:2]
    assert f"boom {row.q_shown[1]:.2f} mm, arm {row.q_shown[2]:.2f} deg" in words(sliding).block(
        "step", row=row
    )
    joints = {
        f"{name}, {unit}": f"q_shown.{k}"
        for k, (name, unit) in enumerate(zip(JOINTS, sliding.units, strict=True))
    }
    behind = {key: path for key, path in BEHIND.items() if key != "way"} | {
        "travel, mm": "travel_mm",
        "way": "way",
    }
    check_table(tables(sliding)["poses"], sliding.plan, {"run": "run", **joints, **behind})


def part(report, key, **changes):
    """The report with changes in one of its parts."""
    return replace(report, **{key: replace(getattr(report, key), **changes)})


def said(report, block="statements"):
    blocks = [block, "more"] if block == "statements" else [block]
    return " ".join(" ".join(words(report).block(name) for name in blocks).split())


def test_tables_show_the_numbers_of_plan_json(report):
    found = tables(report)
    joints = {f"{name}, deg": f"q_shown.{k}" for k, name in enumerate(JOINTS)}
    check_table(found["poses"], report.plan, {"run": "run", **joints, **BEHIND})
    short = {"error, mm" if path == "error_mm" else title: path for title, path in BEHIND.items()}
    del short["deflection, mm"]
    check_table(found["short"], report.plan, {"run": "run", **joints, **short})
    worst = sorted(report.tasks, key=lambda row: -row.expected_error_mm)[:5]
    check_table(found["tasks"], worst, {"task": "task", **dict(list(BEHIND.items())[1:3])})
    check_table(found["curve"], report.curve, CURVE)


def test_the_error_of_a_row_is_its_own_with_its_interval(report):
    for row in report.plan + report.tasks:
        assert row.error_mm.median == row.expected_error_mm
        assert (row.error_mm.p05, row.error_mm.p95) == (row.expected_error_p05_mm, row.expected_error_p95_mm)


def test_the_page_shows_declared_tables_and_the_terminal_has_room(report):
    study = SimpleNamespace(tables=tables, words=words, printed=("short",))
    page = check_report(study, report)
    assert page.startswith(
        f"# Calibration plan: heavy, {report.model}, 460 or 150.5 kg\n\n**4 poses: expected"
    )
    assert len(tables_of(page)) == 4
    [_, _, (head, rows), _] = tables_of(page)
    assert (head[0], [row[0] for row in rows]) == ("model", ["MLS56", "ALL153 + prior"])
    assert f"Criterion test: mean square error at the tasks. Seed {report.seed}." in page


def test_long_plans_are_cut_and_the_page_says_where_the_rest_is(report):
    assert "all are in plan.csv" not in words(report).whole()
    long = replace(report, plan=report.plan * 11)
    assert len(tables(long)["poses"].rows) == 40
    assert "The first 40; all are in plan.csv." in words(long).whole()


def test_the_answer_has_error_interval_rivals_and_efficiency(report):
    report = part(report, "random_plans", planned_mm=0.111, median_mm=0.456, best_tenth_mm=0.321)
    report = part(report, "certificate", efficiency=0.8999)  # never rounded up
    report = replace(report, model="MGCO56", half_width_95_mm=0.678, joints_alone_mm=0.789)
    assert words(report).block("answer") == (
        "4 poses: expected error at the tasks 0.234 mm (90 %: 0.123 to 0.345), joints alone 0.789 mm; "
        "3.4 times less. Were the arm MGCO56 and nothing else: 0.111 mm, random poses 0.456 mm, "
        "4.1 times as much; at least 89 % efficient."
    )
    assert "along an axis at the tasks is known to +- 0.678 mm (95 %, median)." in said(report)
    assert "The best tenth of random poses leave 0.321 mm." in said(report)
    assert words(replace(report, criterion="D")).block("answer").endswith("89 % efficient by criterion D.")
    open_ = part(report, "random_plans", median_mm=None, best_tenth_mm=None)
    assert "nothing else: 0.111 mm, random poses no bound; at" in words(open_).block("answer")


@pytest.mark.parametrize(("joints", "worse"), [(0.235, True), (0.233, False)])
def test_joints_alone_stand_beside_the_model_on_an_arm_that_leaves_nothing_out(report, joints, worse):
    text = said(replace(report, within_percent=30.0, joints_alone_mm=joints))
    assert "of which every link and joint gives, within 30 % of the folder" in text
    assert ("Joints alone are no worse here" in text) != worse


def test_the_certificate_is_told_in_millimetres_or_as_a_factor(report):
    known = {
        "efficiency": 0.81,
        "excess_percent": 11.01,
        "examined": 5132,
        "reached_mm": 0.0543,
        "least_mm": 0.0432,
    }
    report = part(report, "certificate", **known, poses_and_loads=False)
    assert (
        "No choice of 4 among the 5,132 poses examined can reach less than 0.0432 mm. This plan reaches "
        "0.0543 mm, at most 11.1 % more." in said(report)
    )
    assert "bound may be what is loose" not in said(report)
    assert "bound may be what is loose" in said(part(report, "certificate", efficiency=0.79))
    assert "the 5,132 poses and loads examined" in said(part(report, "certificate", poses_and_loads=True))
    other = part(
        replace(report, criterion="E"), "certificate", least_mm=None, reached_mm=None, efficiency=0.5
    )
    assert (
        "can be better than 2.000 times this plan by criterion E, the variance of the least known direction. "
        "Its standard deviations are at most 11.1 % above the least possible." in said(other)
    )


def test_the_advice_names_the_fewest_and_the_enough(report):
    known = {"target_mm": 0.1, "examined_up_to": 40, "more": 4, "little_percent": 10.0}
    report = part(report, "advice", fewest=6, enough=17, **known)
    assert "- 6 poses reach 0.1 mm at the tasks. From 17 on, 4 more bring less than 10 %." in said(report)
    assert "- 1 pose reaches 0.1 mm" in said(part(report, "advice", fewest=1))
    none = said(part(report, "advice", fewest=None, enough=None))
    assert "No plan of up to 40 poses was found that reaches 0.1 mm at the tasks." in none
    assert "Up to 40 poses, 4 more always bring 10 % or more." in none


def test_what_must_not_be_overlooked_is_said_where_it_holds_only(report):
    quiet = part(report, "directions", hidden_mm=0.116)  # less than half of 0.234
    assert "NOT checked" not in said(quiet)
    assert "prior alone" not in said(quiet)
    assert "collides before" not in said(quiet)
    assert "No floor" not in said(quiet)
    assert "poses below the mount are not refused. `--floor-z" in said(replace(quiet, surrounded=False))
    assert "**Visibility was NOT checked**" in said(replace(quiet, tracker_m=None))
    assert "**0.118 mm of the error rest on the prior alone**" in said(
        part(report, "directions", hidden_mm=0.118)
    )
    ways = [replace(row, way="via" if row.run in (2, 4) else "clear") for row in report.plan]
    assert "collides** before runs 2 and 4:" in said(replace(quiet, plan=ways))
    assert "collides** before run 2:" in said(replace(quiet, plan=ways[:3]))


def test_joints_that_no_load_turns_are_named_with_the_pull_that_would(report):
    open_ = replace(
        part(report, "directions", hidden_mm=0.2), unshown=Unshown(["swing"], ["swing"], [0, 4e3, 0])
    )
    expected = (
        "of 0.234 mm expected there 0.200 mm stay open, whatever is measured. `--pull 0,4000,0` would turn"
    )
    assert f"**No load turns swing**, the tasks do: {expected} swing." in said(open_)
    assert "prior alone" not in said(open_)
    alone = replace(open_, unshown=Unshown(["bend", "turn"], [], None))
    assert "**No load turns bend and turn**" in said(alone)
    assert "No force at the load point does." in said(alone)


@pytest.fixture
def pulled(report):
    """The third of the runs is pulled."""
    rows = [
        replace(row, load_kg=0.0, pull_N=[-500.0, 3e3, 0.0]) if row.run == 3 else row for row in report.plan
    ]
    return replace(report, pulls_n=((-500.0, 3e3, 0.0),), plan=rows)


def test_a_pull_is_told_run_by_run(pulled, tmp_path):
    text, pull = words(pulled), "pull -500, 3000, 0 N"
    assert text.whole().startswith(f"# Calibration plan: heavy, {pulled.model}, 460 or 150.5 kg or {pull}\n")
    for name in ("poses", "short"):
        loads = [column for column in tables(pulled)[name].columns if column.heading == "load"]
        assert [loads[0].cell(row) == pull for row in pulled.plan] == [False, False, True, False]
    assert f"**Run 3**: {pull}. Expected" in text.block("step", row=pulled.plan[2])
    assert "hang the weight or pull, read again" in text.whole()
    assert "**No rope was checked**" in said(pulled)
    lines = curves(figure(pulled)[0].axes[1])
    np.testing.assert_array_equal(np.transpose(lines["plan, pulled"]), [pulled.plan[2].tool_m[:2]])
    joints = [Joint(name, -99, 99, 1e-6) for name in JOINTS]
    write_poses(pulled, joints, tmp_path / "plan.csv")
    rows = [*csv.DictReader((tmp_path / "plan.csv").read_text().splitlines())]
    assert list(rows[0]) == plan_columns(joints, pulls=True)
    assert [rows[2][key] for key in ("load_kg", *FORCE)] == ["", "-500.0", "3000.0", "0.0"]
    assert [rows[0][key] for key in FORCE] == ["", "", ""]
    np.testing.assert_array_equal(read_pulls(tmp_path / "plan.csv")[2], [-500, 3000, 0])
    masses = [row.load_kg for row in pulled.plan]
    np.testing.assert_array_equal(read_payload(tmp_path / "plan.csv"), masses)


def test_the_distance_to_the_limits_is_told_joint_by_joint(report):
    assert "From their limits the joints stay at least swing 1.2, boom 20.0, arm 30.0," in said(report)


def test_refusals_come_with_the_most_frequent_first(report):
    known = {"found": 40, "drawn": 5132, "rejected": {"too far": 12, "too near": 0, "it hits": 2080}}
    report = part(report, "candidates", **known)
    fewer = "40 feasible poses of 50 wanted of 5,132 drawn evenly over the joint limits."
    assert f"{fewer} Refused: it hits 2,080, too far 12." in said(replace(report, candidates_wanted=50))
    assert "40 feasible poses of 5,132 drawn" in said(replace(report, candidates_wanted=40))
    assert "Refused: none." in said(part(report, "candidates", rejected={"too near": 0}))


def test_what_it_rests_on_is_told_with_and_without_a_prior(report):
    report = replace(report, error_if_prior_twice_as_uncertain_mm=Expected(0.456, 0.4, 0.5), sigma_um=43.0)
    known = {"unknowns": 68, "shown": 49, "seen": 36, "outweighed": 15, "prior_share_percent": 24.4}
    report = part(report, "directions", **known)
    text = said(report, "assumptions")
    assert "68 unknowns. Hung loads can show 49 directions of them, the plan sees 36. In 15 of them" in text
    assert "twice as uncertain, the error would be 0.456 mm instead of 0.234." in text
    assert "24 % is what the prior leaves open" in text
    assert "White noise of 43 um" in text
    bare = replace(report, prior=None, uncertainty_percent=None, error_if_prior_twice_as_uncertain_mm=None)
    assert "No prior: the other 19 stay unknown" in said(bare, "assumptions")
    assert "--model MGCO56 --no-prior`" in said(replace(bare, model="MGCO56"), "afterwards")
    assert "--model MGCO56`" in said(replace(report, model="MGCO56"), "afterwards")


def test_where_intervals_were_tried_is_said_and_where_not(report):
    whole = replace(report, model="ALL175", whole_arm=True)
    assert "intervals were tried on arms that bend" in said(whole)
    for other in (replace(whole, whole_arm=False), replace(whole, prior=None)):
        assert "intervals were tried for all links and joints with the prior." in said(other)


def test_where_it_was_judged_and_what_it_observes(report):
    report = replace(report, tracker_m=(4.5, -2.5, 1.6), box_m=((1.0, -1.5, 0.5), (3.0, 1.5, 2.5)))
    report = part(report, "observability", seen=49, of=49, o1=0.463, o2=3.84e-5)
    text = said(report, "judged")
    assert "Tracker at 4.5, -2.5, 1.6 m, tool between 1, -1.5, 0.5 and 3, 1.5, 2.5 m." in text
    assert "O1 0.463, O2 3.84 x 10^-5" in text
    assert "it leaves 13 of 49" in said(part(report, "observability", seen=36), "judged").replace(
        "the plan", "it"
    )


def figure(report):
    candidates = np.array([[2.0, 3.0, 9.0], [-1.0, 0.5, 9.0]])
    return overview(report, candidates), candidates


def test_the_curve_of_the_figure_is_that_of_the_report(report):
    report = part(report, "advice", target_mm=0.15)
    shown, _ = figure(report)
    axes = shown.axes[0]
    lines = curves(axes)
    for label, x, y in (
        ("each pose the best next one", range(1, MOST + 1), report.greedy_mm),
        (
            "random poses: median, 10 to 90 %",
            *zip(*((r.poses, r.random_median_mm) for r in report.curve), strict=True),
        ),
        ("this plan on the whole arm, with its 90 % interval", [POSES], [0.234]),
    ):
        np.testing.assert_array_equal(lines[label], [list(x), list(y)])
    [band] = bands(axes)
    ends = [(r.poses, *sorted((r.random_p10_mm, r.random_p90_mm))) for r in report.curve]
    np.testing.assert_allclose(band, ends)
    drawn = [np.array(line.get_ydata(), float).tolist() for line in axes.get_lines()]
    assert [0.123, 0.345] in drawn
    assert [0.15, 0.15] in drawn
    assert "0.15 mm" in [text.get_text().strip() for text in axes.texts]
    assert unit_in(axes.get_ylabel()) == "mm"
    assert axes.get_xlabel() == "poses"
    assert axes.get_yscale() == "log"


def test_every_task_of_the_figure_has_its_error(report):
    axes = figure(report)[0].axes[2]
    order = sorted(report.tasks, key=lambda row: -row.expected_error_mm)
    assert [t.get_text() for t in axes.get_xticklabels()] == [str(row.task) for row in order]
    np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), [row.expected_error_mm for row in order])
    segments = np.array(axes.collections[0].get_segments())[:, :, 1]
    ends = [[row.expected_error_p05_mm, row.expected_error_p95_mm] for row in order]
    np.testing.assert_array_equal(segments, ends)
    assert axes.get_lines()[1].get_ydata()[0] == 0.234
    assert unit_in(axes.get_ylabel()) == "mm"


def test_the_top_view_shows_x_and_y_of_everything(report):
    report = replace(report, tracker_m=(4.5, -2.5, 1.6), base_m=[0.25, -0.75, 0.0])
    shown, candidates = figure(report)
    axes = shown.axes[1]
    lines = curves(axes)
    for label, places in (
        ("2 feasible poses", candidates),
        ("tasks", [row.tool_m for row in report.tasks]),
        ("plan, numbered", [row.tool_m for row in report.plan]),
        ("base", [report.base_m]),
        ("tracker", [report.tracker_m]),
    ):
        np.testing.assert_array_equal(np.transpose(lines[label]), np.array(places)[:, :2], err_msg=label)
        assert (np.array(places)[:, 0] < axes.get_xlim()[1]).all()
    numbers = {text.get_text(): text.xy for text in axes.texts}
    for row in report.plan:
        np.testing.assert_array_equal(numbers[str(row.run)], row.tool_m[:2])
    assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("m", "m")
    assert axes.get_title() == "Tool from above"
    alone = figure(replace(report, tracker_m=None))[0].axes[1]
    assert "NOT checked" in alone.get_title()
    assert "tracker" not in curves(alone)


@pytest.mark.parametrize("sliding", [None, "boom"])
def test_the_files_hold_the_numbers_of_the_report(report, tmp_path, sliding):
    joints = [Joint(name, -99, 99, 1e-6, name == sliding) for name in JOINTS]
    write_poses(report, joints, tmp_path / "plan.csv")
    write_tasks(report, joints, tmp_path / "tasks.csv")
    texts = [(tmp_path / name).read_text().splitlines() for name in ("plan.csv", "tasks.csv")]
    plan, tasks = ([*csv.DictReader(lines)] for lines in texts)
    assert list(plan[0]) == plan_columns(joints)
    assert ("travel_mm" in plan[0]) == (sliding is not None)
    assert list(tasks[0]) == ["task", *(j.shown_column for j in joints), *list(plan[0])[14:18]]
    units = dict.fromkeys(("rad", "m"), "q") | dict.fromkeys(("deg", "mm"), "q_shown")
    for own, row in zip(plan + tasks, report.plan + report.tasks, strict=True):
        for key, text in own.items():
            joint, _, unit = key.rpartition("_")
            value = getattr(row, units[unit])[JOINTS.index(joint)] if joint in JOINTS else getattr(row, key)
            assert (
                text == value if isinstance(value, str) else float(text) == pytest.approx(value, abs=0.0051)
            )
    for own, row in zip(plan, report.plan, strict=True):  # read back bit by bit
        assert [float(own[j.column]) for j in joints] == row.q


def places_of(rng):
    """Errors of two models at five places, at one without a bound."""
    x, y, z, moved = rng.uniform(-2, 2, (4, 5)).round(4).tolist()
    q = tuple(rng.uniform(-1, 1, 30).tolist())
    joints = tuple(f"[{k}, 2, 3] deg" for k in range(5))
    at = Places((1, 2, 3, 4, 5), q, joints, tuple(x), tuple(y), tuple(z), tuple(moved))
    errors = {"MLS56": [0.4, 0.9, None, 0.8, 0.7], "ALL153 + prior": [0.1, 0.3, 0.2, 0.2, 0.5]}
    return error_places(at, errors, list(errors))


def test_what_is_drawn_of_a_plan_are_its_poses_and_errors(report, rng, kr500):
    q, tasks = rng.uniform(-1, 1, (POSES, 6)), rng.uniform(-1, 1, (len(report.tasks), 6))
    plan = SimpleNamespace(q=q, specification=SimpleNamespace(tasks=SimpleNamespace(q=tasks)))
    drawn = seen(kr500, Planned(None, plan, None, report), rng.uniform(-3, 3, (30, 3)))
    order, work, _ = drawn.scene.groups
    layers = {layer.name: layer for layer in order.layers}
    np.testing.assert_allclose(layers["planned, in order"].at[0], [row.tool_m for row in report.plan])
    np.testing.assert_allclose(layers["tasks"].at[0], [row.tool_m for row in report.tasks])
    np.testing.assert_allclose(layers["tracker"].at[0, 0], report.tracker_m)
    sights = layers["lines of sight"]
    np.testing.assert_allclose(sights.at, np.broadcast_to(report.tracker_m, sights.at.shape))
    np.testing.assert_allclose(sights.to, tool_points(kr500.vjm, q, kr500.vjm.markers))
    load = layers["load"]
    np.testing.assert_allclose(load.at[:, 0], tool_points(kr500.vjm, q, kr500.vjm.load[None])[:, 0])
    assert ((load.to - load.at)[..., 2] < 0).all()
    for k, row in enumerate(report.plan):
        assert order.names[k] == f"Run {row.run}"
        assert f"Expected deflection {row.expected_deflection_mm:.2f} mm" in order.words[k]
    at_tasks, at_poses = drawn.runs
    for chart, rows in ((at_tasks, report.tasks), (at_poses, report.plan)):
        [line] = chart.lines
        np.testing.assert_allclose(line.values, [row.expected_error_mm for row in rows])
        np.testing.assert_allclose(line.ends[0], [row.expected_error_p05_mm for row in rows])
        np.testing.assert_allclose(line.ends[1], [row.expected_error_p95_mm for row in rows])
    shown = {line.name: line.values for line in drawn.map.lines}
    for name in report.map.compared:
        np.testing.assert_allclose(shown[name], report.map.errors(name))
    assert work.first == int(np.argmax([row.expected_error_mm for row in report.tasks]))


def test_a_curve_without_a_bound_says_so_and_is_left_out_of_figure_and_chart(report):
    open_ = replace(report.curve[0], random_median_mm=None)
    report = replace(report, curve=[open_, *report.curve[1:]])
    assert re.search(r"- has no bound:$", said(report, "curve").split(" |")[0])
    x, _ = curves(figure(report)[0].axes[0])["random poses: median, 10 to 90 %"]
    assert x.tolist() == [row.poses for row in report.curve[1:]]
