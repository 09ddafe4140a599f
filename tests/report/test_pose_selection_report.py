"""What is said and drawn of planned poses is what their trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import bands, curves, key_of, looks_differ, unit_in
from made_up import of_one_trial
from reports import campaign_row, check, check_forest, place_of, table_of

from testbench.campaign.evaluation import CampaignRow
from testbench.campaign.predicted_error import Expected
from testbench.campaign.true_arms import CALLED
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.settings import BARE, FITS, INCUMBENT, PLANNED, WHOLE
from testbench.studies.pose_selection.study import LOOKS, figures, report
from testbench.studies.pose_selection.trial import Row
from testbench.trials.spread import ends, middle, spread
from testbench.views.gains import ratio, share
from testbench.views.markdown import grid

CRITERIA, POSES, SEEDS = ("test", "I", "D"), (8, 12), range(4, 7)
NAMES = (*CRITERIA, "random")
SCOPE = s.Scope(poses=POSES, fewer=POSES, criteria=CRITERIA, candidates=30, tasks=4, workspace=5)


def plan(criterion="test", poses=12, fit=PLANNED, ground=s.HOME):
    rng = np.random.default_rng([poses, *map(ord, criterion + fit + ground.name)])
    own = {"criterion": criterion, "fit": fit, "ground": ground.name}
    return of_one_trial(s.PlanRow, rng, poses=poses, q_rad=(), **own)


HERE = s.Scene(
    plans=(*(plan(name, n) for name in CRITERIA for n in POSES), *(plan(fit=fit) for fit in FITS[1:])),
)
AWAY = s.Scene(plans=tuple(plan(fit=fit, ground=s.AWAY) for fit in FITS))
ASKED = s.Settings("kr500_l480", 4, SCOPE, HERE, AWAY)


def rows(seed, factors):
    """Rows of a trial; errors of a plan, or of what else it is named by, are that many times made-up ones."""
    rng = np.random.default_rng(seed)

    def row(part, name, poses, fit, **more):
        tasks, workspace = factors.get((part, name), factors.get(name, (1, 1)))
        return Row(part, name, poses, fit, *rng.uniform((20, 20), (40, 40)) * (tasks, workspace), **more)

    def featured(name):
        model = campaign_row(CampaignRow, rng, f"{name}, {PLANNED}", parameters=68)
        if name != "test":
            return {"model": model}
        each = [tuple(rng.uniform(1, 9, n)) for n in (4, 5)]
        return {"model": model, "each_task_mm": each[0], "each_place_mm": each[1]}

    for name, n, fit in [(name, n, fit) for fit in FITS for name in NAMES for n in POSES]:
        yield row("measured", name, n, fit, **featured(name) if (n, fit) == (12, PLANNED) else {})
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
    f = found.numbers
    check(found, ["criteria"])
    assert [model["parameters"] for model in f["models"]] == 4 * [68]
    levels = {(row.fit, row.plan, row.poses): row for row in f["errors"]}
    assert levels.keys() == {(fit, name, n) for fit in FITS for name in NAMES for n in POSES}
    for (fit, name, n), level in levels.items():
        tasks, area = (pick(trials, "measured", name, fit, n, f"{x}_mm") for x in ("tasks", "workspace"))
        assert (level.tasks_mm, level.workspace_mm) == (spread(tasks), spread(area))
        own = None if name == "random" else HERE.plan(name, n, PLANNED)
        assert level.expected_tasks_mm == (own and own.expected_tasks_mm)
        assert level.efficiency_percent == (own and own.efficiency_percent)
    errors = [
        np.array(trials.where(plan="test", fit=PLANNED, poses=12, part="measured")[key].tolist())
        for key in ("each_task_mm", "each_place_mm")
    ]
    task, place = (own.max() for own in errors)
    assert (
        f"Worst trial: worst task {task:.3f} mm, worst place of the workspace {place:.3f} mm" in found.worst
    )


def test_plans_for_each_fit_are_judged_on_both_grounds_beside_random_poses_and_joints(both):
    found, trials = both
    for row in found.numbers["grounds"]:
        key = {"at the tasks": "tasks_mm", "over the workspace": "workspace_mm"}[row.judged]
        ours, chance, joints = (
            pick(trials, "ground", plan, fit, key=key, ground=row.ground)
            for plan, fit in (("test", row.fit), ("random", row.fit), ("test", "Joints"))
        )
        assert (row.planned_mm, row.random_mm) == (spread(ours), spread(chance))
        assert row.over_random == np.median(ours) / np.median(chance)
        assert (row.planned_better, row.better_than_joints) == (sum(ours < chance), sum(ours < joints))
    cases = [row.over_random for row in found.numbers["grounds"]]
    losing = sum(ratio >= 1 for ratio in cases)
    assert (len(cases), 0 < losing < 24) == (24, True)
    assert f"Planning loses to random poses in {losing} of 24 cases" in "".join(found.claims)
    worst = found.numbers["worst"]
    told = f"Medians: planning loses most with {worst.fit} {worst.ground}, judged {worst.judged}: "
    assert f"{told}{max(cases):.2f} times" in found.worst
    ahead, _ = made({("ground", "test"): (0.1, 0.1)})
    assert "planning gains least with" in ahead.worst
    assert "On both grounds every plan has a smaller median error" in "".join(ahead.claims)


def test_promises_are_counted_case_by_case(both):
    found, trials = both
    whole, kept = trials.where(part="promise", fit=WHOLE), found.numbers["kept"]
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
    assert f"holds in {share(kept[0].inside_90, '12')} of 12 cases" in found.claims[2]


@pytest.mark.parametrize(("winner", "word"), [("test", "smaller"), ("random", "larger"), ("I", "")])
def test_the_answer_holds_planned_and_random_poses_and_joints_alone(winner, word):
    found, trials = made({winner: (0.1, 0.1)})
    kinds = (("test", PLANNED), ("random", PLANNED), ("test", INCUMBENT))
    planned, chance, joints = (pick(trials, "measured", name, fit) for name, fit in kinds)
    ours, theirs, alone = (mm(np.median(x)) for x in (planned, chance, joints))
    size = np.median(chance / planned)
    assert found.answer.startswith(f"12 planned poses leave {ours} at the tasks, random ones {theirs}: ")
    if word:
        assert f"{ratio(size if word == 'smaller' else 1 / size)} times {word} (" in found.answer
    assert (f"**{winner}**" in grid(found.tables["criteria"])) == (found.winner == winner)
    assert found.badge.what == "task error"
    assert f"Joint stiffness only leaves {alone} there from planned poses, " in found.answer


ENOUGH = "planned poses keep the tasks within 0.1 mm in all 3 trials; random ones:"


@pytest.mark.parametrize(
    ("planned", "chance", "said"),
    [
        ((9e-4, 1e-3), (1, 2e-3), f"8 {ENOUGH} 12."),
        ((1, 2e-3), (1, 1), f"12 {ENOUGH} more"),
        ((1, 1), (1, 1), "No number of planned poses tried keeps the tasks within 0.1 mm"),
    ],
)
def test_the_number_of_poses_is_the_least_that_is_enough_in_all_trials(both, planned, chance, said):
    trials = both[1]
    kinds = zip(("test", "test", "random", "random"), 2 * POSES, planned + chance, strict=True)
    for name, n, factor in kinds:
        meant, own = (trials["plan"] == name) & (trials["poses"] == n), trials["tasks_mm"]
        trials = trials.add(tasks_mm=np.where(meant, factor * own, own))
    found = report(ASKED, SEEDS, trials)
    few, many = (np.median(pick(trials, "measured", "test", PLANNED, n)) for n in POSES)
    assert found.claims[0].startswith(said)
    assert ("Beyond 8 poses 4 more take less than 10 %" in found.claims[0]) == (many > 0.9 * few)
    assert ("Every step tried still pays." in found.claims[0]) == (many <= 0.9 * few)


def test_the_figure_draws_the_reports_numbers_in_the_look_of_each_criterion(both):
    drawn, f = figures(both[0]), both[0].numbers
    fits, keys = (PLANNED, PLANNED, BARE, INCUMBENT), ("tasks_mm", "workspace_mm", "tasks_mm", "tasks_mm")
    looks_differ(key_of(drawn["pose_selection.png"]))
    for axes, fit, key in zip(drawn["pose_selection.png"].axes, fits, keys, strict=True):
        assert unit_in(axes.get_ylabel()) == "mm"
        levels = {name: [r for r in f["errors"] if (r.fit, r.plan) == (fit, name)] for name in NAMES}
        for name, (x, y) in curves(axes).items():
            assert (x.tolist(), y.tolist()) == ([8, 12], [level[key].median for level in levels[name]])
        for name, shade in zip(("test", "random"), bands(axes), strict=True):
            assert [row[1:] for row in shade] == [ends(level[key]) for level in levels[name]]
    quick, _ = made(scope=replace(SCOPE, poses=(12,), fewer=(12,)))
    rows = quick.numbers["criteria"]
    for axes, key in zip(figures(quick)["pose_selection.png"].axes, keys[:2], strict=True):
        first = place_of(quick, [row.plan for row in rows])
        check_forest(axes, [row[key] for row in rows], [LOOKS[row.plan] for row in rows], first=first)
