"""What is said and drawn of planned poses is what their trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, bands, check_pivot, curves, key_of, looks_differ, tables_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.bench.plan_promise import Expected
from testbench.bench.truths import CALLED
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.measure import Model, Where
from testbench.studies.pose_selection.report import LOOKS, figures, report
from testbench.studies.pose_selection.settings import BARE, FITS, INCUMBENT, ON_ARMS, PLANNED, WHOLE
from testbench.studies.pose_selection.trial import Row
from testbench.trials.spread import ends, middle, spread
from testbench.views.gains import ratio
from testbench.views.markdown import grid

CRITERIA, POSES, SEEDS = ("test", "I", "D"), (8, 12), range(4, 7)
NAMES = (*CRITERIA, "random")
OTHERS = ("12 poses, one weight, three markers", "4 more poses", "a fourth marker")
SCOPE = s.Scope(poses=POSES, fewer=POSES, criteria=CRITERIA, candidates=30, tasks=4, workspace=5, variants=3)


def plan(criterion="test", poses=12, variant="", fit=PLANNED, ground=s.HOME):
    rng = np.random.default_rng([poses, len(variant), *map(ord, criterion + fit.name + ground.name)])
    own = {"criterion": criterion, "variant": variant, "fit": fit.name, "ground": ground.name}
    return of_one_trial(s.PlanRow, rng, poses=poses, load=(0,) * poses, q_rad=(), **own)


HERE = s.Scene(
    drawn=99,
    rejected=tuple(range(11)),
    plans=(
        *(plan(name, n) for name in CRITERIA for n in POSES),
        *(plan(variant=way) for way in OTHERS),
        *(plan(fit=fit) for fit in FITS[1:]),
    ),
)
ASKED = s.Settings(
    "kr500_l480", 4, SCOPE, HERE, s.Scene(plans=tuple(plan(fit=f, ground=s.AWAY) for f in FITS))
)


def rows(seed, factors):
    """Rows of a trial; errors of a plan, or of what else it is named by, are that many times made-up ones."""
    rng = np.random.default_rng(seed)

    def row(part, name, poses, fit, **more):
        tasks, workspace = factors.get((part, name), factors.get(name, (1, 1)))
        return Row(part, name, poses, fit.name, *rng.uniform((20, 20), (40, 40)) * (tasks, workspace), **more)

    def featured(name):
        where = Where(tuple(rng.uniform(1, 9, 4)), tuple(rng.uniform(1, 9, 5)))
        model = of_one_trial(Model, rng, name=f"{name}, {PLANNED.name}", advice=(), parameters=68)
        return {"model": model, "where": where if name == "test" else None}

    for name, n, fit in [(name, n, fit) for fit in FITS for name in NAMES for n in POSES]:
        yield row("measured", name, n, fit, **featured(name) if (n, fit) == (12, PLANNED) else {})
    for name in ("test", "random"):
        yield row("noise-free", name, 12, PLANNED)
        yield row("planned anew", name, 12, PLANNED, efficiency_percent=rng.uniform(80, 99))
    for name, n, fit in [(name, n, fit) for name in ("test", "random") for n in POSES for fit in ON_ARMS]:
        yield row("drawn arm", name, n, fit, expected=Expected(30, 25, 36))
    yield from (row("variant", way, 12, PLANNED) for way in OTHERS)
    for ground in (s.HOME, s.AWAY):
        on = {"ground": ground.name}
        yield from (row("ground", name, 12, fit, **on) for fit in FITS for name in ("test", "random"))
        on |= {"truth": str(rng.choice(["tubes", "cast"])), "prior": str(rng.choice(["right", "link"]))}
        for fit, name in [(fit, name) for fit in (WHOLE, INCUMBENT) for name in ("test", "random")]:
            inside = rng.uniform(0.5, 1)
            yield row("promise", name, 12, fit, expected=Expected(30, 25, 36), inside=inside, **on)


def made(factors=None, scope=SCOPE):
    trials = table_of(SEEDS, lambda seed: list(rows(seed, factors or {})))
    return report(replace(ASKED, scope=scope), SEEDS, trials), trials


@pytest.fixture(scope="module")
def both():
    return made()


def pick(trials, part, plan, fit, poses=12, key="tasks_mm", **more):
    """A number of the rows that are meant, one a trial."""
    return trials.where(part=part, plan=plan, fit=fit, poses=poses, **more)[key]


def mm(value):
    return f"{middle(value):.3f} mm"


def test_errors_and_forecasts_are_those_of_the_rows_that_are_meant(both):
    found, trials = both
    f, best = found.numbers, HERE.plans[1]
    check(found, ["criteria"])
    assert [model["parameters"] for model in f["models"]] == 4 * [68]
    for fit, name, k in [(fit.name, name, k) for fit in FITS for name in NAMES for k in (0, 1)]:
        level, n = f["errors"][fit][name][k], POSES[k]
        tasks, area = (pick(trials, "measured", name, fit, n, f"{x}_mm") for x in ("tasks", "workspace"))
        assert (level.tasks_mm, level.workspace_mm) == (spread(tasks), spread(area))
        assert level.tasks_best_tenth_mm == np.percentile(tasks, 10)
        forecast = None if name == "random" else HERE.plan(name, n, PLANNED.name).expected_tasks_mm
        assert level.expected_tasks_mm == forecast
    for row in f["promises"]:
        gco, ls = (pick(trials, "drawn arm", row.plan, fit.name, row.poses) for fit in ON_ARMS)
        assert (row.gco_mm, row.ls_mm) == pytest.approx([np.sqrt(np.mean(x**2)) for x in (gco, ls)])
        assert row.gco_over_expected == pytest.approx(row.gco_mm / 30)
        assert row.inside_90 == np.mean((gco >= 25) & (gco <= 36))
    least = best.expected_tasks_mm * (best.efficiency_percent / 100) ** 0.5
    assert f["possible"].least_promise_mm == pytest.approx(least)
    calm = {name: spread(pick(trials, "noise-free", name, PLANNED.name)) for name in ("test", "random")}
    assert f["possible"].noise_free_mm == calm
    ours, theirs = (pick(trials, "planned anew", name, PLANNED.name) for name in ("test", "random"))
    assert (f["replanned"].test.tasks_mm, f["replanned"].wins) == (spread(ours), sum(ours < theirs))


def test_plans_for_each_fit_are_judged_on_both_grounds_beside_random_poses_and_joints(both):
    found, trials = both
    cases = []
    for row in found.numbers["grounds"]:
        for where in ("tasks", "workspace"):
            ours, chance, joints = (
                pick(trials, "ground", plan, fit, key=f"{where}_mm", ground=row.ground)
                for plan, fit in (("test", row.fit), ("random", row.fit), ("test", "Joints"))
            )
            assert (row[where].planned_mm, row[where].random_mm) == (spread(ours), spread(chance))
            assert row[where].ratio == np.median(ours) / np.median(chance)
            wins = sum(ours < chance), sum(ours < joints)
            assert (row[where].wins, row[where].better_than_joints) == wins
            cases.append(row[where].ratio)
    losing = sum(ratio >= 1 for ratio in cases)
    assert (len(cases), 0 < losing < 24) == (24, True)
    assert f"Planning loses to random poses in {losing} of 24 cases" in "".join(found.claims)
    assert f"Planning loses most with {found.numbers['worst'].case}: {max(cases):.2f} times" in found.worst
    ahead, _ = made({("ground", "test"): (0.1, 0.1)})
    assert "Planning gains least with" in ahead.worst
    assert "On both grounds every plan has a smaller median error" in "".join(ahead.claims)


def test_promises_are_counted_case_by_case_and_the_least_kept_is_named(both):
    found, trials = both
    whole, kept = trials.where(part="promise", fit=WHOLE.name), found.numbers["kept"]
    labels = {
        "all": ["" for _ in whole["plan"]],
        "poses": [{"test": "planned"}.get(name, name) for name in whole["plan"]],
        "tasks": whole["ground"].tolist(),
        "truth": [CALLED[name] for name in whole["truth"]],
        "prior": whole["prior"].tolist(),
    }
    wanted = {f"{key}: {name}".removesuffix(": ") for key, own in labels.items() for name in own}
    assert {row.promised for row in kept} == wanted
    for row in kept:
        what, _, name = row.promised.partition(": ")
        own = whole.pick(np.array(labels[what]) == name)
        error = own["tasks_mm"]
        assert (row.count, row.below, row.above) == (len(own), np.mean(error < 25), np.mean(error > 36))
        shares = np.mean((error >= 25) & (error <= 36)), np.mean(own["inside"])
        assert (row.inside_90, row.inside_95) == pytest.approx(shares)
        assert row.over_promised == spread(error / 30)
    joints = trials.where(part="promise", fit="Joints")["tasks_mm"]
    assert found.numbers["kept_joints"].over_promised == spread(joints / 30)
    least, text = min(kept[1:], key=lambda row: row.inside_95), "".join(found.claims)
    assert f"holds in {kept[0].inside_90:.0%} of 12 cases".replace("%", " %") in text
    said = f"least often with {least.promised}: {least.inside_90:.0%} and {least.inside_95:.0%}."
    assert said.replace("%", " %") in text


@pytest.mark.parametrize("winner", CRITERIA)
def test_the_best_criterion_is_named_whichever_it_is_and_those_that_lose(winner):
    other = CRITERIA[CRITERIA.index(winner) - 1]
    found, _ = made({winner: (0.1, 1), other: (1, 0.1), "random": (0.3, 1)})
    errors = {row.plan: row for row in found.numbers["criteria"]}
    best, wide = mm(errors[winner].tasks_mm), mm(errors[other].workspace_mm)
    assert f"among them: {winner} {best}. Over the workspace: {other} {wide}." in found.claims[0]
    losers = " and ".join(name for name in CRITERIA if name != winner)
    assert f"No better than random poses at the tasks: {losers}." in found.claims
    assert f"**{winner}**" in grid(found.tables["criteria"])


@pytest.mark.parametrize(("winner", "word"), [("test", "less"), ("random", "as much")])
def test_the_answer_holds_planned_and_random_poses_and_joints_alone(winner, word):
    found, trials = made({winner: (0.1, 0.1)})
    kinds = (("test", PLANNED), ("random", PLANNED), ("test", INCUMBENT))
    planned, chance, joints = (pick(trials, "measured", name, fit.name) for name, fit in kinds)
    ours, theirs, alone = (mm(np.median(x)) for x in (planned, chance, joints))
    size = np.median(chance / planned)
    assert found.answer.startswith(f"12 planned poses leave {ours} at the tasks, random ones {theirs}: ")
    assert f"{ratio(size if word == 'less' else 1 / size)} times {word} (" in found.answer
    assert f"Joints alone leave {alone} there from planned poses, " in found.answer
    tenth = f"{'no worse' if word == 'less' else 'worse'} than the best tenth of random poses"
    said = f"is {np.median(planned) / np.median(chance):.2f} of the random median, and {tenth}"
    assert f"{said} ({mm(np.percentile(chance, 10))})" in "".join(found.claims)


@pytest.mark.parametrize("winner", [*OTHERS[1:], None])
def test_the_other_way_that_helps_most_is_named_with_both_errors(winner):
    found, _ = made({winner or OTHERS[0]: (0.1, 0.1)})
    errors = {row.variant: mm(row.tasks_mm) for row in found.numbers["worth"]}
    said = f"help most: {winner}, {errors.get(winner)} at the tasks in place of {errors[OTHERS[0]]}."
    assert (said if winner else "None of the other ways to measure leaves less error") in found.claims[4]


@pytest.mark.parametrize(
    ("planned", "chance", "said"),
    [
        (
            (9e-4, 1e-3),
            (1, 2e-3),
            "8 planned poses keep the tasks within 0.1 mm in all 3 trials; random ones: 12.",
        ),
        (
            (1, 2e-3),
            (1, 1),
            "12 planned poses keep the tasks within 0.1 mm in all 3 trials; random ones: more",
        ),
        ((1, 1), (1, 1), "No number of planned poses tried keeps the tasks within 0.1 mm"),
    ],
)
def test_the_number_of_poses_is_the_least_that_is_enough_in_all_trials(both, planned, chance, said):
    trials = both[1]
    for name, n, factor in zip(
        ("test", "test", "random", "random"), 2 * POSES, planned + chance, strict=True
    ):
        meant, own = (trials["plan"] == name) & (trials["poses"] == n), trials["tasks_mm"]
        trials = trials.add(tasks_mm=np.where(meant, factor * own, own))
    found = report(ASKED, SEEDS, trials)
    few, many = (np.median(pick(trials, "measured", "test", PLANNED.name, n)) for n in POSES)
    assert found.claims[1].startswith(said)
    assert ("Beyond 8 poses 4 more take less than 10 %" in found.claims[1]) == (many > 0.9 * few)
    assert ("Every step tried still pays." in found.claims[1]) == (many <= 0.9 * few)


def test_tables_show_errors_by_number_of_poses_and_efficiency_in_percent(both):
    found, _ = both
    for fit, own in found.numbers["errors"].items():
        levels = [level for rows in own.values() for level in rows]
        for where in ("tasks", "workspace"):
            check_pivot(found.tables[f"{where}, {fit}"], levels, ("poses", "plan", f"{where}_mm"))
    [(head, cells)] = tables_of(grid(found.tables["criteria"]))
    assert [title.rpartition(", ")[2] for title in head[1:]] == ["%", "mm", "mm", "mm"]
    assert cells[0][1] == f"{HERE.plans[1].efficiency_percent:.1f}"


def test_figures_draw_the_reports_numbers_in_the_look_of_each_criterion(both):
    drawn, f = figures(both[0]), both[0].numbers
    fits, keys = (PLANNED, PLANNED, BARE, INCUMBENT), ("tasks_mm", "workspace_mm", "tasks_mm", "tasks_mm")
    looks_differ(key_of(drawn["curves.png"]))
    for axes, fit, key in zip(drawn["curves.png"].axes, fits, keys, strict=True):
        assert unit_in(axes.get_ylabel()) == "mm"
        for name, (x, y) in curves(axes).items():
            own = f["errors"][fit.name][name]
            assert (x.tolist(), y.tolist()) == ([8, 12], [level[key].median for level in own])
        for name, shade in zip(("test", "random"), bands(axes), strict=True):
            assert [row[1:] for row in shade] == [ends(level[key]) for level in f["errors"][fit.name][name]]
    for name, rows_, keys in (
        ("featured.png", f["criteria"], ("tasks_mm", "workspace_mm")),
        ("grounds.png", f["grounds"], ("tasks.ratio", "workspace.ratio")),
        ("variants.png", f["worth"], ("expected_tasks_mm", "tasks_mm")),
    ):
        for axes, key in zip(drawn[name].axes, keys, strict=True):
            assert key.endswith("ratio") or unit_in(axes.get_xlabel()) == "mm"
            for y, row in enumerate(rows_):
                bar, dot = (x for x in axes.get_lines() if set(np.ravel(x.get_ydata())) == {y})
                assert tuple(bar.get_xdata()) == ends(at(row, key))
                shade = LOOKS[row.get("plan", "test")].hex
                assert (np.ravel(dot.get_xdata())[0], dot.get_color()) == (middle(at(row, key)), shade)
    quick, _ = made(scope=replace(SCOPE, poses=(12,), fewer=(12,)))
    assert "curves.png" not in figures(quick)
