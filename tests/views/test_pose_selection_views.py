"""What people see of pose selection equals its report, and the report its rows, for rows that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import (
    check_pivot,
    check_report,
    check_table,
    check_words,
    curves,
    key_of,
    looks_differ,
    unit_in,
)
from made_up import around, fill, single

from testbench.bench.plan_report import Expected
from testbench.bench.truths import CALLED
from testbench.studies.pose_selection import summary
from testbench.studies.pose_selection.report import Level
from testbench.studies.pose_selection.rows import Certificate, Kept, Model, PlanRow, Row, Scene, Where
from testbench.studies.pose_selection.settings import (
    AWAY,
    BARE,
    FITS,
    HOME,
    INCUMBENT,
    ON_ARMS,
    PLANNED,
    WHOLE,
    Scope,
    Settings,
)
from testbench.studies.pose_selection.study import STUDY
from testbench.trials.spread import Spread, ends, middle
from testbench.views import markdown

CRITERIA, NAMES, POSES, SEEDS = ("test", "I", "D"), ("test", "I", "D", "random"), (8, 12), range(4, 7)
OTHERS = ("12 poses, one weight, three markers", "4 more poses", "a fourth marker")
ON_ARM = [("test", 8), ("test", 12), ("I", 12), ("D", 12), ("random", 8), ("random", 12)]
BY = {
    "poses by": "plan",
    "efficient, at least, %": "efficiency",
    "forecast tasks, mm": "expected_tasks_mm",
    "tasks, mm": "tasks_mm",
    "workspace, mm": "workspace_mm",
}
PLANS = {
    "criterion": "criterion",
    "poses": "poses",
    "efficient, at least, %": "efficiency",
    "directions seen": "directions_seen",
    "of": "directions_of_loads",
    "forecast tasks, mm": "expected_tasks_mm",
    "5 %, mm": "expected_tasks_p05_mm",
    "95 %, mm": "expected_tasks_p95_mm",
    "forecast workspace, mm": "expected_workspace_mm",
    **{f"O{k}": f"observability.o{k}" for k in range(1, 6)},
    "time, s": "seconds",
}
FORECASTS = {
    "poses by": "plan",
    "poses": "poses",
    "forecast, mm": "expected_mm",
    "simulated GCO, mm": "gco_mm",
    "simulated LS, mm": "ls_mm",
    "GCO over forecast": "gco_over_expected",
    "inside 90 % interval, %": "inside_90_percent",
}
KEPT = {
    "promises": "cases",
    "cases": "count",
    "inside 90 % interval, %": "inside_90",
    "below, %": "below",
    "above, %": "above",
    "deflections inside 95 % interval, %": "inside_95",
    "simulated over promised": "ratio",
}
GROUNDS = {
    "tasks": "ground",
    "planned for and identified by": "fit",
    "forecast tasks, mm": "expected_tasks_mm",
    "planned, tasks, mm": "tasks.planned_mm",
    "random, tasks, mm": "tasks.random_mm",
    "ratio, tasks": "tasks.ratio",
    "planned better, tasks": "tasks.wins",
    "planned, workspace, mm": "workspace.planned_mm",
    "random, workspace, mm": "workspace.random_mm",
    "ratio, workspace": "workspace.ratio",
    "planned better, workspace": "workspace.wins",
    "better than joints, workspace": "workspace.better_than_joints",
}
VARIANTS = {
    "measured": "variant",
    "poses": "poses",
    "directions": "directions",
    "runs under first load": "with_first_load",
    "efficient, at least, %": "efficiency",
    "forecast tasks, mm": "expected_tasks_mm",
    "simulated tasks, mm": "judged.tasks_mm",
    "simulated workspace, mm": "judged.workspace_mm",
}


@pytest.fixture
def asked(rng, kr500):
    """What was tried: plans and places drawn evenly over the joint limits."""

    def drawn(count):
        return tuple(map(tuple, rng.uniform(*kr500.arm.limits, (count, len(kr500.arm.joints))).tolist()))

    def plan(criterion, poses, variant="", fit=PLANNED, ground=HOME):
        fixed = {"q_rad": sum(drawn(poses), ()), "load": (0,) * poses, "seconds": rng.uniform(11, 99)}
        what = {"criterion": criterion, "variant": variant, "fit": fit.name, "ground": ground.name}
        return replace(
            single(fill(PlanRow, rng, poses=poses, **what, **fixed)), efficiency=rng.uniform(0.1, 1)
        )

    plans = [plan(name, n) for name in CRITERIA for n in POSES] + [plan("test", 12, way) for way in OTHERS]
    plans += [plan("test", 12, fit=fit) for fit in FITS[1:]]
    there = tuple(plan("test", 12, fit=fit, ground=AWAY) for fit in FITS)
    scene = Scene(drawn(30), 99, tuple(range(11)), drawn(4), drawn(5), tuple(plans))
    scope = Scope(
        poses=POSES, fewer=POSES, criteria=CRITERIA, candidates=30, tasks=4, workspace=5, variants=3
    )
    return Settings("kr500_l480", 4, scope, scene, replace(scene, plans=there))


def rows_of(rng, tasks=None, workspace=None):
    """Rows of one trial; errors of some plans or other ways are that many times the made-up ones."""
    tasks, workspace = tasks or {}, workspace or {}

    def row(part, plan, poses, fit, **more):
        errors = rng.uniform(20, 40) * tasks.get(plan, 1), rng.uniform(20, 40) * workspace.get(plan, 1)
        return Row(part, plan, poses, fit.name, *errors, **more)

    found = [row("measured", name, n, fit) for name in NAMES for n in POSES for fit in FITS]
    where = Where(tuple(rng.uniform(1, 9, 4)), tuple(rng.uniform(1, 9, 5)))
    for k, own in enumerate(found):
        if (own.poses, own.fit) == (12, PLANNED.name):
            model = single(fill(Model, rng, name=f"{own.plan}, {own.fit}"))
            found[k] = replace(own, model=model, where=where if own.plan == "test" else None)
    found += [row("noise-free", name, 12, PLANNED) for name in NAMES]
    found.append(row("planned anew", "test", 12, PLANNED, certificate=single(fill(Certificate, rng))))
    found.append(row("planned anew", "random", 12, PLANNED, expected=fill(Expected, rng)))
    for name, n in ON_ARM:
        middle_mm = rng.uniform(20, 40)
        forecast = Expected(middle_mm, 0.8 * middle_mm, 1.2 * middle_mm)
        found += [row("drawn arm", name, n, fit, expected=forecast) for fit in ON_ARMS]
    found += [
        row("ground", name, 12, fit, ground=ground.name)
        for ground in (HOME, AWAY)
        for fit in FITS
        for name in ("test", "random")
    ]
    on = rng.choice(["tubes", "cast"]), rng.choice(["right", "link"])
    found += [
        row(
            "promise",
            name,
            12,
            fit,
            ground=HOME.name,
            expected=Expected(30, 25, 36),
            kept=kept(rng, *on),
        )
        for fit in (WHOLE, INCUMBENT)
        for name in ("test", "random")
    ]
    return found + [row("variant", way, 12, PLANNED) for way in OTHERS]


def kept(rng, truth, prior):
    return Kept(str(truth), str(prior), rng.uniform(0.5, 1))


@pytest.fixture
def trials(rng):
    return [(seed, rows_of(rng)) for seed in SEEDS]


@pytest.fixture
def report(asked, trials):
    return summary.summary(asked, SEEDS, trials)


def pick(trials, key="tasks_mm", **wanted):
    """A number of the rows that are meant, one a trial."""
    return [
        getattr(row, key)
        for _, rows in trials
        for row in rows
        if all(getattr(row, name) == value for name, value in wanted.items())
    ]


def spread(values):
    p05, median, p95 = np.percentile(values, [5, 50, 95])
    return Spread(median, p05, p95, min(values), max(values), len(values))


def test_the_report_has_the_rows_numbers_each_in_its_place(report, trials, asked):
    for fit in FITS:
        for name in NAMES:
            for k, n in enumerate(POSES):
                level, own = report.errors[fit.name][name][k], {"plan": name, "poses": n, "fit": fit.name}
                errors = pick(trials, part="measured", **own)
                assert (level.plan, level.poses, level.tasks_mm) == (name, n, spread(errors))
                assert level.workspace_mm == spread(pick(trials, "workspace_mm", part="measured", **own))
                assert level.tasks_best_tenth_mm == np.percentile(errors, 10)
        planned, chance = (report.errors[fit.name][name][1] for name in ("test", "random"))
        own = report.featured[fit.name]
        assert (own.test_mm, own.random_mm) == (planned.tasks_mm, chance.tasks_mm)
        assert own.ratio_of_medians == planned.tasks_mm.median / chance.tasks_mm.median
    for plan in asked.scene.plans[:6]:
        level = report.errors[PLANNED.name][plan.criterion][POSES.index(plan.poses)]
        assert (level.efficiency, level.expected_tasks_mm) == (plan.efficiency, plan.expected_tasks_mm)
    for row, (name, n) in zip(report.promises, ON_ARM, strict=True):
        gco, ls = (
            pick(trials, part="drawn arm", plan=name, poses=n, fit=fit)
            for fit in ("MGCO68 + prior", "MLS68 + prior")
        )
        known = pick(trials, "expected", part="drawn arm", plan=name, poses=n, fit="MGCO68 + prior")
        assert (row.plan, row.poses, row.arms) == (name, n, 3)
        assert row.gco_mm == pytest.approx(np.sqrt(np.mean(np.square(gco))), rel=1e-12)
        assert row.ls_mm == pytest.approx(np.sqrt(np.mean(np.square(ls))), rel=1e-12)
        assert row.gco_over_expected == row.gco_mm / row.expected_mm
        inside = [0.8 * e.expected <= error <= 1.2 * e.expected for e, error in zip(known, gco, strict=True)]
        assert row.inside_90_percent == np.mean(inside)
    calm, anew = report.possible.noise_free_mm, report.replanned
    for name, errors in (("test", anew.test), ("random", anew.random)):
        assert calm[name] == spread(pick(trials, part="noise-free", plan=name))
        assert errors.tasks_mm == spread(pick(trials, part="planned anew", plan=name))
    ours, theirs = (pick(trials, part="planned anew", plan=name) for name in ("test", "random"))
    assert anew.wins == np.sum(np.less(ours, theirs))
    places = [(ground.name, fit.name) for ground in (HOME, AWAY) for fit in FITS]
    for row, (ground, fit) in zip(report.grounds, places, strict=True):
        assert (row.ground, row.fit) == (ground, fit)
        for where in ("tasks", "workspace"):
            own, wanted = getattr(row, where), {"part": "ground", "ground": ground}
            ours, chance, joints = (
                pick(trials, f"{where}_mm", plan=plan, fit=name, **wanted)
                for plan, name in (("test", fit), ("random", fit), ("test", "Joints"))
            )
            assert (own.planned_mm, own.random_mm) == (spread(ours), spread(chance))
            assert own.ratio == np.median(ours) / np.median(chance)
            assert (own.wins, own.seeds) == (np.sum(np.less(ours, chance)), 3)
            assert own.better_than_joints == np.sum(np.less(ours, joints))
    for row, plan in zip(report.worth, asked.scene.plans[6:9], strict=True):
        assert (row.variant, row.expected_tasks_mm) == (plan.variant, plan.expected_tasks_mm)
        assert row.judged.tasks_mm == spread(pick(trials, part="variant", plan=plan.variant))


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else single(report)
    tables = STUDY.tables(report)
    short = {title: BY[title] for title in ("poses by", "tasks, mm", "workspace, mm")}
    check_table(tables["criteria"], report.criteria, BY)
    check_table(tables["recorded"], report.criteria, short)
    check_table(tables["plans"], report.plans, PLANS)
    in_percent = [replace(row, inside_90_percent=100 * row.inside_90_percent) for row in report.promises]
    check_table(tables["forecasts"], in_percent, FORECASTS)
    check_table(tables["variants"], report.worth, VARIANTS)
    check_table(tables["grounds"], report.grounds, GROUNDS)
    text = check_report(STUDY, report)
    check_words(STUDY.words(report))
    for fit, levels in report.errors.items():
        every = [level for own in levels.values() for level in own]
        for what, title in (("tasks", "at the tasks"), ("workspace", "over the workspace")):
            table = tables[f"{what}, {fit}"]
            check_pivot(table, every, ("poses", "plan", f"{what}_mm"))
            assert f"## Error {title}, mm: {fit}\n\n{markdown.grid(table)}" in text
    every = [level for own in report.errors[PLANNED.name].values() for level in own]
    check_pivot(tables["medians"], every, ("poses", "plan", "tasks_mm"))
    assert report.criteria == [own[1] for own in report.errors[PLANNED.name].values()]


def test_promises_are_counted_case_by_case_and_the_least_kept_is_named(report, trials):
    rows = [row for _, own in trials for row in own if row.part == "promise" and row.fit == WHOLE.name]
    keys = {
        "poses": lambda row: {"test": "planned", "random": "random"}[row.plan],
        "tasks": lambda row: row.ground,
        "truth": lambda row: CALLED[row.kept.truth],
        "prior": lambda row: row.kept.prior,
    }
    first, *others = report.kept
    assert {own.cases for own in others} == {f"{k}: {key(row)}" for row in rows for k, key in keys.items()}
    for own in report.kept:
        what, _, name = own.cases.partition(": ")
        meant = [row for row in rows if what == "all" or keys[what](row) == name]
        errors = np.array([row.tasks_mm for row in meant])
        shares = np.mean(errors < 25), np.mean(errors > 36), np.mean((errors >= 25) & (errors <= 36))
        assert (own.count, own.below, own.above) == (len(meant), *shares[:2])
        assert own.inside_90 == pytest.approx(shares[2])
        assert own.inside_95 == pytest.approx(np.mean([row.kept.inside for row in meant]))
        assert own.ratio == spread(errors / 30)
    joints = pick(trials, part="promise", fit="Joints")
    assert (report.kept_joints.count, report.kept_joints.ratio) == (6, spread(np.array(joints) / 30))
    words = STUDY.words(report)
    least = min(others, key=lambda own: own.inside_95)
    assert f"holds in {100 * first.inside_90:.0f} % of 6 cases" in words.block("statements")
    said = f"Least often they hold with {least.cases}: {100 * least.inside_90:.0f} % and"
    assert said in words.block("more")
    check_table(STUDY.tables(report)["kept"], [*report.kept, report.kept_joints], KEPT)


def made(rng, asked, **factors):
    return summary.summary(asked, SEEDS, [(seed, rows_of(rng, **factors)) for seed in SEEDS])


def mm(value):
    return f"{middle(value):.3f} mm"


@pytest.mark.parametrize("winner", CRITERIA)
def test_the_best_criterion_is_named_whichever_it_is(rng, asked, winner):
    other = CRITERIA[CRITERIA.index(winner) - 1]
    report = made(rng, asked, tasks={winner: 0.1, "random": 0.3}, workspace={other: 0.1})
    text = STUDY.words(report).block("statements")
    best, wide = (next(c for c in report.criteria if c.plan == name) for name in (winner, other))
    assert (
        f"Least error at the tasks of all plans, random poses among them: {winner} {mm(best.tasks_mm)}."
        in text
    )
    assert f"Over the workspace: {other} {mm(wide.workspace_mm)}." in text
    losers = markdown.listed([name for name in CRITERIA if name != winner])
    assert f"No better than random poses at the tasks: {losers}." in STUDY.words(report).block("more")
    assert f"**{winner}**" in markdown.grid(STUDY.tables(report)["criteria"])


@pytest.mark.parametrize(("winner", "said"), [("test", "less"), ("random", "as much")])
def test_the_answer_says_what_planned_poses_gain_over_random_ones_and_joints_alone(rng, asked, winner, said):
    report = made(rng, asked, tasks={winner: 0.1})
    own, words, g = report.featured[PLANNED.name], STUDY.words(report), report.gains
    assert (g.random.ours_mm, g.random.theirs_mm) == (own.test_mm, own.random_mm)
    assert g.joints.theirs_mm == report.featured["Joints"].test_mm
    size = middle(g.random.times)
    ratio = f"{size if said == 'less' else 1 / size:.{0 if max(size, 1 / size) >= 9.95 else 1}f} times {said}"
    assert words.block("answer").startswith(
        f"12 planned poses leave {mm(own.test_mm)} at the tasks, random ones {mm(own.random_mm)}: {ratio} ("
    )
    assert f"Joints alone leave {mm(g.joints.theirs_mm)} there from planned poses, " in words.block("answer")
    assert ("no worse than the best tenth" in words.block("more")) == (winner == "test")
    assert f"{own.ratio_of_medians:.2f} of the random median" in words.block("more")


def test_random_poses_that_err_least_are_said_to_err_least(report):
    """The best of the criteria is not the best where random poses beat it."""
    assert report.criteria[3].plan == "random"
    least = replace(report.criteria[3], tasks_mm=around(0.070), workspace_mm=around(0.060))
    levels = [*report.criteria[:3], least]
    judged = summary.verdict(levels, [], report.promises, report.worth, report.grounds)
    text = STUDY.words(replace(report, criteria=levels, verdict=judged)).block("statements")
    assert "random poses among them: random 0.070 mm. Over the workspace: random 0.060 mm." in text


def test_what_is_the_same_is_alike(report):
    same = replace(report.criteria[0], plan="I")
    far = replace(report.criteria[3], tasks_mm=around(900.0), workspace_mm=around(900.0))
    levels = [report.criteria[0], same, far]
    judged = summary.verdict(levels, [], report.promises, report.worth, report.grounds)
    assert set(judged.tasks) == set(judged.workspace) == {"test", "I"}
    equal = dict.fromkeys(NAMES, report.errors[PLANNED.name]["test"])
    own = summary.featured(equal, 12)
    alike = replace(report, verdict=judged, featured=report.featured | {PLANNED.name: own})
    words = STUDY.words(alike)
    assert words.block("statements").count("(alike)") >= 2
    assert "**" not in markdown.grid(STUDY.tables(alike)["criteria"])


@pytest.mark.parametrize("winner", [*OTHERS[1:], None])
def test_the_other_way_that_helps_most_is_named_with_both_errors(rng, asked, winner):
    report = made(rng, asked, tasks={winner or OTHERS[0]: 0.1})
    text = STUDY.words(report).block("statements")
    if winner is None:
        assert "None of the other ways to measure leaves less error at the tasks." in text
        return
    errors = {row.variant: mm(row.judged.tasks_mm) for row in report.worth}
    said = f"help most: {winner}, {errors[winner]} at the tasks in place of {errors[OTHERS[0]]}."
    assert said in text


def test_statements_carry_the_reports_numbers(report):
    text, anew = STUDY.words(report).block("more"), report.replanned
    assert f"have a forecast below {mm(report.possible.least_promise_mm)}" in text
    calm = report.possible.noise_free_mm
    assert (
        f"noise {markdown.show(calm['test'])} mm stay, with random poses {markdown.show(calm['random'])}"
        in text
    )
    for fit in FITS[1:]:
        own = report.featured[fit.name]
        said = f"{fit.name} {middle(own.test_mm):.3f} against {mm(own.random_mm)}"
        assert said in text
        assert (f"{said} (planning loses)" in text) == (own.ratio_of_medians >= 1)
    assert f"{markdown.show(anew.test.tasks_mm)} mm, random {markdown.show(anew.random.tasks_mm)} mm" in text
    assert f"better in {anew.wins} of 3. Every plan is at least {100 * anew.least_efficiency:.1f} %" in text
    ratios = [row.gco_over_expected for row in report.promises]
    shares = [100 * row.inside_90_percent for row in report.promises]
    assert f"forecast error is {min(ratios):.2f} to {max(ratios):.2f}." in text
    assert f"interval holds {min(shares):.0f} % to {max(shares):.0f} % of them" in text
    for level, plan in zip(report.errors[PLANNED.name]["test"], report.plans[:2], strict=True):
        assert f"{level.tasks_mm.median / plan.expected_tasks_mm:.2f} ({level.poses} poses)" in text


def test_every_case_in_which_planning_loses_is_said_with_its_ratio_and_seeds(rng, asked):
    report = made(rng, asked)
    cases = [(row, where) for row in report.grounds for where in ("tasks", "workspace")]
    assert {getattr(row, where).ratio >= 1 for row, where in cases} == {True, False}
    text = STUDY.words(report).block("more")
    worst = max((getattr(row, where).ratio for row, where in cases))
    assert f"Planning loses most with {report.worst.case}: {worst:.2f} times" in STUDY.words(report).block(
        "worst"
    )
    for row, where in cases:
        own = getattr(row, where)
        place = (
            f"at the tasks, {row.ground}" if where == "tasks" else f"over the workspace, planned {row.ground}"
        )
        said = f"{row.fit} {place} ({own.ratio:.2f}, {own.wins} of 3)"
        assert (said in text.split("Planning loses to random poses")[1]) == (own.ratio >= 1), said
    ahead = [replace(row, tasks=replace(row.tasks, ratio=0.9)) for row in report.grounds]
    ahead = [replace(row, workspace=replace(row.workspace, ratio=0.99)) for row in ahead]
    assert summary.losing(ahead) == ()


def test_joints_alone_stand_beside_every_fit_on_both_grounds(report):
    text = STUDY.words(report).block("more")
    for row in report.grounds:
        said = f"{row.fit} {middle(row.tasks.planned_mm):.3f} mm at the tasks, "
        assert f"{said}{middle(row.workspace.planned_mm):.3f} over the workspace" in text
        if row.fit != INCUMBENT.name:
            assert f"{row.fit} in {row.workspace.better_than_joints}" in text


def levels(**errors):
    """Errors at 4, 8 and 12 poses, their 95th percentile a tenth higher."""
    return {
        name: [
            Level(Spread(v, 0.9 * v, 1.1 * v), 1.0, name, n, v, None, None)
            for n, v in zip((4, 8, 12), own, strict=True)
        ]
        for name, own in errors.items()
    }


def test_the_number_of_poses_that_is_enough_is_that_of_95_percent_of_trials(report):
    few = summary.recommend(levels(test=(0.2, 0.095, 0.09), random=(0.3, 0.2, 0.09)))
    assert few.fewest == {"test": 12, "random": 12}
    assert few.little_more_beyond == 8
    few = summary.recommend(levels(test=(0.09, 0.08, 0.07), random=(0.3, 0.2, 0.1)))
    assert (few.fewest, few.little_more_beyond) == ({"test": 4, "random": None}, None)
    text = STUDY.words(replace(report, recommendation=few)).block("statements")
    assert "4 planned poses keep the tasks within 0.1 mm in all 3 trials; random ones: more than" in text
    assert "Every step tried still pays" in text


def test_curves_are_the_reports_errors_over_the_number_of_poses(report):
    figure = STUDY.figures["curves.png"](report)
    fits, keys = (PLANNED, PLANNED, BARE, INCUMBENT), ("tasks_mm", "workspace_mm", "tasks_mm", "tasks_mm")
    for axes, fit, key in zip(figure.axes, fits, keys, strict=True):
        assert unit_in(axes.get_ylabel()) == "mm"
        assert axes.get_xlabel() == "poses measured"
        assert [t.get_text() for t in axes.get_xticklabels()] == ["8", "12"]
        drawn = curves(axes)
        assert list(drawn) == list(NAMES)
        for name, (x, y) in drawn.items():
            own = report.errors[fit.name][name]
            assert x.tolist() == [8, 12]
            assert y.tolist() == [getattr(level, key).median for level in own]
        shaded = [band.get_paths()[0].vertices[:, 1] for band in axes.collections]
        for corners, name in zip(shaded, ("test", "random"), strict=True):
            edges = {e for level in report.errors[fit.name][name] for e in ends(getattr(level, key))}
            assert edges <= set(corners)
    looks_differ(key_of(figure))
    enough = report.recommendation.within_mm
    assert enough in [line.get_ydata()[0] for line in figure.axes[0].get_lines()]
    assert f"{enough:g} mm" in [text.get_text() for text in figure.axes[0].texts]


def test_dots_of_the_featured_poses_are_the_reports(report):
    left, centre, right, last = STUDY.figures["featured.png"](report).axes
    panels = (
        (left, report.criteria, "plan", lambda row: row.tasks_mm),
        (centre, report.criteria, "plan", lambda row: row.workspace_mm),
        (right, report.worth, "variant", lambda row: row.judged.tasks_mm),
    )
    for axes, rows, name, value in panels:
        assert unit_in(axes.get_xlabel()) == "mm"
        shown = [t.get_text().rsplit("  ", 1) for t in axes.get_yticklabels()]
        assert shown == [[getattr(row, name), f"{value(row).median:.3f}"] for row in rows]
        for k, row in enumerate(rows):
            bar, dot = axes.get_lines()[2 * k : 2 * k + 2]
            assert tuple(bar.get_xdata()) == ends(value(row))
            assert (np.ravel(dot.get_xdata())[0], np.ravel(dot.get_ydata())[0]) == (value(row).median, k)
    x, y = curves(right)["forecast"]
    assert x.tolist() == [row.expected_tasks_mm for row in report.worth]
    assert y.tolist() == [0, 1, 2]
    assert [t.get_text() for t in last.get_yticklabels()] == [f"{r.fit}, {r.ground}" for r in report.grounds]
    for where, (x, y) in zip(("tasks", "workspace"), list(curves(last).values())[:2], strict=True):
        assert x.tolist() == [getattr(row, where).ratio for row in report.grounds]
        assert y.tolist() == list(range(12))
