"""What is said and drawn of planned poses is what their trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, bands, check_pivot, curves, key_of, looks_differ, tables_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.bench.plan_report import Expected
from testbench.bench.truths import CALLED
from testbench.studies.pose_selection.measure import Model, Where
from testbench.studies.pose_selection.report import LOOKS, figures, report
from testbench.studies.pose_selection.settings import (
    AWAY,
    BARE,
    FITS,
    HOME,
    INCUMBENT,
    ON_ARMS,
    PLANNED,
    WHOLE,
    PlanRow,
    Scene,
    Scope,
    Settings,
)
from testbench.studies.pose_selection.trial import Row
from testbench.trials.spread import ends, middle, spread
from testbench.views.gains import ratio
from testbench.views.markdown import grid

CRITERIA, POSES, SEEDS = ("test", "I", "D"), (8, 12), range(4, 7)
NAMES = (*CRITERIA, "random")
OTHERS = ("12 poses, one weight, three markers", "4 more poses", "a fourth marker")
SCOPE = Scope(poses=POSES, fewer=POSES, criteria=CRITERIA, candidates=30, tasks=4, workspace=5, variants=3)


def plan(criterion="test", poses=12, variant="", fit=PLANNED, ground=HOME):
    rng = np.random.default_rng([poses, len(variant), *map(ord, criterion + fit.name + ground.name)])
    own = {"criterion": criterion, "variant": variant, "fit": fit.name, "ground": ground.name}
    return of_one_trial(PlanRow, rng, poses=poses, load=(0,) * poses, q_rad=(), **own)


HERE = Scene(
    drawn=99,
    rejected=tuple(range(11)),
    plans=(
        *(plan(name, n) for name in CRITERIA for n in POSES),
        *(plan(variant=way) for way in OTHERS),
        *(plan(fit=fit) for fit in FITS[1:]),
    ),
)
ASKED = Settings("kr500_l480", 4, SCOPE, HERE, Scene(plans=tuple(plan(fit=f, ground=AWAY) for f in FITS)))


def rows(seed, factors):
    """Rows of a trial; errors of a plan, or of what else it is named by, are that many times made-up ones."""
    rng = np.random.default_rng(seed)

    def row(part, name, poses, fit, **more):
        tasks, workspace = factors.get((part, name), factors.get(name, (1, 1)))
        return Row(part, name, poses, fit.name, *rng.uniform((20, 20), (40, 40)) * (tasks, workspace), **more)

    def featured(name):
        where = Where(tuple(rng.uniform(1, 9, 4)), tuple(rng.uniform(1, 9, 5)))
        model = of_one_trial(Model, rng, name=f"{name}, {PLANNED.name}", advice=())
        return {"model": model, "where": where if name == "test" else None}

    for name, n, fit in [(name, n, fit) for fit in FITS for name in NAMES for n in POSES]:
        yield row("measured", name, n, fit, **featured(name) if (n, fit) == (12, PLANNED) else {})
    for name in ("test", "random"):
        yield row("noise-free", name, 12, PLANNED)
        yield row("planned anew", name, 12, PLANNED, efficiency_percent=rng.uniform(80, 99))
    for name, n, fit in [(name, n, fit) for name in ("test", "random") for n in POSES for fit in ON_ARMS]:
        yield row("drawn arm", name, n, fit, expected=Expected(30, 25, 36))
    yield from (row("variant", way, 12, PLANNED) for way in OTHERS)
    for ground in (HOME, AWAY):
        on = {"ground": ground.name}
        yield from (row("ground", name, 12, fit, **on) for fit in FITS for name in ("test", "random"))
        on |= {"truth": str(rng.choice(["tubes", "cast"])), "prior": str(rng.choice(["right", "link"]))}
        for fit, name in [(fit, name) for fit in (WHOLE, INCUMBENT) for name in ("test", "random")]:
            yield row(
                "promise", name, 12, fit, expected=Expected(30, 25, 36), inside=rng.uniform(0.5, 1), **on
            )


def made(factors=None, scope=SCOPE):
    trials = table_of(SEEDS, lambda seed: list(rows(seed, factors or {})))
    return report(replace(ASKED, scope=scope), SEEDS, trials), trials


@pytest.fixture(scope="module")
def both():
    return made()


def mm(value):
    return f"{middle(value):.3f} mm"


def test_errors_and_forecasts_are_those_of_the_rows_that_are_meant(both):
    found, trials = both
    text, f = check(found, ["criteria"]), found.numbers
    assert "## More" in text
    for fit, name, k in [(fit.name, name, k) for fit in FITS for name in NAMES for k in (0, 1)]:
        level = f["errors"][fit][name][k]
        own = trials.where(part="measured", plan=name, poses=POSES[k], fit=fit)
        assert (level.tasks_mm, level.workspace_mm) == (spread(own["tasks_mm"]), spread(own["workspace_mm"]))
        assert level.tasks_best_tenth_mm == np.percentile(own["tasks_mm"], 10)
        forecast = None if name == "random" else HERE.plan(name, POSES[k], PLANNED.name).expected_tasks_mm
        assert level.expected_tasks_mm == forecast
    for row in f["promises"]:
        gco, ls = (
            trials.where(part="drawn arm", plan=row.plan, poses=row.poses, fit=fit.name)["tasks_mm"]
            for fit in ON_ARMS
        )
        assert (row.gco_mm, row.ls_mm) == pytest.approx([np.sqrt(np.mean(x**2)) for x in (gco, ls)])
        assert row.gco_over_expected == pytest.approx(row.gco_mm / 30)
        assert row.inside_90 == np.mean((gco >= 25) & (gco <= 36))
    assert f["possible"].least_promise_mm == pytest.approx(
        HERE.plans[1].expected_tasks_mm * (HERE.plans[1].efficiency_percent / 100) ** 0.5
    )


def test_plans_for_each_fit_are_judged_on_both_grounds_beside_random_poses_and_joints(both):
    found, trials = both
    cases = []
    for row, (ground, fit) in zip(
        found.numbers["grounds"], [(g.name, fit.name) for g in (HOME, AWAY) for fit in FITS], strict=True
    ):
        assert (row.ground, row.fit) == (ground, fit)
        for where in ("tasks", "workspace"):
            ours, chance, joints = (
                trials.where(part="ground", ground=ground, plan=plan, fit=name)[f"{where}_mm"]
                for plan, name in (("test", fit), ("random", fit), ("test", "Joints"))
            )
            assert (row[where].planned_mm, row[where].random_mm) == (spread(ours), spread(chance))
            assert row[where].ratio == np.median(ours) / np.median(chance)
            assert (row[where].wins, row[where].better_than_joints) == (
                sum(ours < chance),
                sum(ours < joints),
            )
            cases.append(row[where].ratio)
    losing = sum(ratio >= 1 for ratio in cases)
    assert 0 < losing < 24
    assert any(f"Planning loses to random poses in {losing} of 24 cases" in claim for claim in found.claims)
    assert f"Planning loses most with {found.numbers['worst'].case}: {max(cases):.2f} times" in found.worst
    ahead, _ = made({("ground", "test"): (0.1, 0.1)})
    assert ahead.numbers["verdict"].loses == []
    assert "Planning gains least with" in ahead.worst
    assert any("On both grounds every plan has a smaller median error" in claim for claim in ahead.claims)


def test_promises_are_counted_case_by_case_and_the_least_kept_is_named(both):
    found, trials = both
    whole = trials.where(part="promise", fit=WHOLE.name)
    labels = {
        "all": ["" for _ in whole["plan"]],
        "poses": [{"test": "planned"}.get(name, name) for name in whole["plan"]],
        "tasks": whole["ground"].tolist(),
        "truth": [CALLED[name] for name in whole["truth"]],
        "prior": whole["prior"].tolist(),
    }
    kept = found.numbers["kept"]
    wanted = {f"{key}: {name}".removesuffix(": ") for key, own in labels.items() for name in own}
    assert {row.cases for row in kept} == wanted
    for row in kept:
        what, _, name = row.cases.partition(": ")
        own = whole.pick(np.array(labels[what]) == name)
        error = own["tasks_mm"]
        assert (row.count, row.below, row.above) == (len(own), np.mean(error < 25), np.mean(error > 36))
        assert row.inside_90 == pytest.approx(np.mean((error >= 25) & (error <= 36)))
        assert row.inside_95 == pytest.approx(np.mean(own["inside"]))
        assert row.ratio == spread(error / 30)
    joints = trials.where(part="promise", fit="Joints")["tasks_mm"]
    assert found.numbers["kept_joints"].ratio == spread(joints / 30)
    least = min(kept[1:], key=lambda row: row.inside_95)
    text = "\n".join(found.claims)
    assert f"holds in {100 * kept[0].inside_90:.0f} % of 12 cases" in text
    assert (
        f"least often with {least.cases}: {100 * least.inside_90:.0f} % and {100 * least.inside_95:.0f} %"
        in text
    )


@pytest.mark.parametrize("winner", CRITERIA)
def test_the_best_criterion_is_named_whichever_it_is_and_those_that_lose(winner):
    other = CRITERIA[CRITERIA.index(winner) - 1]
    found, _ = made({winner: (0.1, 1), other: (1, 0.1), "random": (0.3, 1)})
    errors = {row.plan: row for row in found.numbers["criteria"]}
    best, wide = mm(errors[winner].tasks_mm), mm(errors[other].workspace_mm)
    said = f"random poses among them: {winner} {best}. Over the workspace: {other} {wide}."
    assert said in found.claims[0]
    losers = " and ".join(name for name in CRITERIA if name != winner)
    assert f"No better than random poses at the tasks: {losers}." in found.claims
    assert f"**{winner}**" in grid(found.tables["criteria"])


@pytest.mark.parametrize(("winner", "word"), [("test", "less"), ("random", "as much")])
def test_the_answer_holds_planned_and_random_poses_and_joints_alone(winner, word):
    found, trials = made({winner: (0.1, 0.1)})
    planned, chance, joints = (
        trials.where(part="measured", plan=name, poses=12, fit=fit.name)["tasks_mm"]
        for name, fit in (("test", PLANNED), ("random", PLANNED), ("test", INCUMBENT))
    )
    ours, theirs, alone = (f"{np.median(x):.3f} mm" for x in (planned, chance, joints))
    size = np.median(chance / planned)
    assert found.answer.startswith(f"12 planned poses leave {ours} at the tasks, random ones {theirs}: ")
    assert f"{ratio(size if word == 'less' else 1 / size)} times {word} (" in found.answer
    assert f"Joints alone leave {alone} there from planned poses, " in found.answer
    text, over = "\n".join(found.claims), np.median(planned) / np.median(chance)
    tenth = f"{'no worse' if word == 'less' else 'worse'} than the best tenth of random poses"
    assert f"{over:.2f} of the random median, and {tenth} ({np.percentile(chance, 10):.3f} mm)" in text


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
def test_the_number_of_poses_is_the_least_that_is_enough_in_all_trials(planned, chance, said):
    _, trials = made()
    for name, factors in (("test", planned), ("random", chance)):
        for poses, factor in zip(POSES, factors, strict=True):
            meant = (trials["plan"] == name) & (trials["poses"] == poses)
            trials = trials.add(tasks_mm=np.where(meant, factor * trials["tasks_mm"], trials["tasks_mm"]))
    found = report(ASKED, SEEDS, trials)
    assert found.claims[1].startswith(said)
    mid = [
        np.median(trials.where(part="measured", plan="test", poses=n, fit=PLANNED.name)["tasks_mm"])
        for n in POSES
    ]
    assert ("Beyond 8 poses 4 more take less than 10 %" in found.claims[1]) == (mid[1] > 0.9 * mid[0])


def test_tables_show_errors_by_number_of_poses_and_what_is_a_share(both):
    found, _ = both
    for fit, own in found.numbers["errors"].items():
        levels = [level for rows in own.values() for level in rows]
        for where in ("tasks", "workspace"):
            check_pivot(found.tables[f"{where}, {fit}"], levels, ("poses", "plan", f"{where}_mm"))
    [(head, cells)] = tables_of(grid(found.tables["criteria"]))
    assert [title.rpartition(", ")[2] for title in head[1:]] == ["%", "mm", "mm", "mm"]
    assert cells[0][1] == f"{HERE.plans[1].efficiency_percent:.1f}"


def test_figures_draw_the_reports_numbers_in_the_look_of_each_criterion(both):
    found, _ = both
    made_, f = figures(found), found.numbers
    fits, keys = (PLANNED, PLANNED, BARE, INCUMBENT), ("tasks_mm", "workspace_mm", "tasks_mm", "tasks_mm")
    looks_differ(key_of(made_["curves.png"]))
    for axes, fit, key in zip(made_["curves.png"].axes, fits, keys, strict=True):
        assert unit_in(axes.get_ylabel()) == "mm"
        for name, (x, y) in curves(axes).items():
            own = f["errors"][fit.name][name]
            assert (x.tolist(), y.tolist()) == ([8, 12], [level[key].median for level in own])
        for name, shade in zip(("test", "random"), bands(axes), strict=True):
            assert [row[1:] for row in shade] == [ends(level[key]) for level in f["errors"][fit.name][name]]
    panels = [
        ("featured.png", f["criteria"], ("tasks_mm", "workspace_mm"), lambda row: LOOKS[row.plan]),
        ("grounds.png", f["grounds"], ("tasks.ratio", "workspace.ratio"), lambda _: LOOKS["test"]),
        ("variants.png", f["worth"], ("expected_tasks_mm", "tasks_mm"), lambda _: LOOKS["test"]),
    ]
    for name, drawn, keys, look in panels:
        for axes, key in zip(made_[name].axes, keys, strict=True):
            assert key.endswith("ratio") or unit_in(axes.get_xlabel()) == "mm"
            for y, row in enumerate(drawn):
                bar, dot = [
                    line for line in axes.get_lines() if np.ravel(line.get_ydata()).tolist() in ([y, y], [y])
                ]
                assert tuple(bar.get_xdata()) == ends(at(row, key))
                assert (np.ravel(dot.get_xdata())[0], dot.get_color()) == (
                    middle(at(row, key)),
                    look(row).hex,
                )
    quick, _ = made(scope=replace(SCOPE, poses=(12,), fewer=(12,)))
    assert set(figures(quick)) == {"featured.png", "grounds.png", "variants.png"}
