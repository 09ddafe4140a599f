"""The report of planned poses holds and draws what their trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import bands, curves, key_of, looks_differ, unit_in
from made_up import of_one_trial
from reports import campaign_row, check, check_forest, place_of, read_back, table_of

from testbench.report.markdown import grid
from testbench.report.schema import TRUE_ARM_LABELS
from testbench.runs.spread import ends, spread
from testbench.studies.campaigns import CampaignRow
from testbench.studies.planning import (
    AWAY,
    BARE,
    FITS,
    HOME,
    INCUMBENT,
    LOOKS,
    PLAN_LABELS,
    PLANNED,
    STUDY,
    WHOLE,
    PlanErrorRow,
    PlannedRow,
    PlanningScene,
    PlanningSettings,
    Scope,
)
from testbench.workflows.predicted_error import Expected

CRITERIA, POSES, SEEDS = ("test", "I", "D"), (8, 12), range(4, 7)
NAMES = (*CRITERIA, "random")
SCOPE = Scope(poses=POSES, fewer=POSES, criteria=CRITERIA, candidates=30, tasks=4, workspace=5)


def plan(criterion="test", poses=12, fit=PLANNED, ground=HOME):
    rng = np.random.default_rng([poses, *map(ord, criterion + fit + ground.name)])
    own = {"criterion": criterion, "fit": fit, "ground": ground.name}
    return of_one_trial(PlannedRow, rng, poses=poses, q_rad=(), **own)


HERE = PlanningScene(
    plans=(*(plan(name, n) for name in CRITERIA for n in POSES), *(plan(fit=fit) for fit in FITS[1:])),
)
ELSEWHERE = PlanningScene(plans=tuple(plan(fit=fit, ground=AWAY) for fit in FITS))
ASKED = PlanningSettings("kr500_l480", 4, SCOPE, HERE, ELSEWHERE)


def rows(seed, factors):
    """Rows of a trial; errors of a plan, or of what else it is named by, are that many times made-up ones."""
    rng = np.random.default_rng(seed)

    def row(part, name, poses, fit, **more):
        tasks, workspace = factors.get(name, (1, 1))
        errors = rng.uniform((20, 20), (40, 40)) * (tasks, workspace)
        return PlanErrorRow(part, name, poses, fit, *errors, **{"status": "solved", **more})

    def featured(name):
        model = campaign_row(CampaignRow, rng, f"{name}, {PLANNED}", parameters=68)
        if name != "test":
            return {"model": model}
        return {"model": model, "each_place_mm": tuple(rng.uniform(1, 9, 5))}

    for name, n, fit in [(name, n, fit) for fit in FITS for name in NAMES for n in POSES]:
        yield row("measured", name, n, fit, **featured(name) if (n, fit) == (12, PLANNED) else {})
    for ground in (HOME, AWAY):
        on = {"ground": ground.name}
        yield from (row("ground", name, 12, fit, **on) for fit in FITS for name in ("test", "random"))
        on |= {"truth": str(rng.choice(["tubes", "cast"])), "prior": str(rng.choice(["right", "link"]))}
        for fit, name in [(fit, name) for fit in (WHOLE, INCUMBENT) for name in ("test", "random")]:
            inside = rng.uniform(0.5, 1)
            yield row("promise", name, 12, fit, expected=Expected(30, 25, 36), inside=inside, **on)


def made(factors=None, scope=SCOPE):
    trials = table_of(SEEDS, lambda seed: list(rows(seed, factors or {})))
    return STUDY.report(replace(ASKED, scope=scope), SEEDS, trials), trials


@pytest.fixture(scope="module")
def both():
    return made()


def pick(trials, part, plan, fit, poses=12, key="tasks_mm", **more):
    """A number of the rows that are meant, one a trial."""
    return trials.where(part=part, plan=plan, fit=fit, poses=poses, **more)[key]


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


def test_promises_are_counted_case_by_case(both):
    found, trials = both
    whole, kept = trials.where(part="promise", fit=WHOLE), found.numbers["kept"]
    labels = {
        "all": ["" for _ in whole["plan"]],
        "poses": [{"test": "planned"}.get(name, name) for name in whole["plan"]],
        "tasks": whole["ground"].tolist(),
        "truth": [TRUE_ARM_LABELS[name] for name in whole["truth"]],
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
    assert kept[0].independent <= kept[0].count == 12


@pytest.mark.parametrize("winner", ["test", "I"])
def test_plans_are_judged_beside_the_strongest_of_the_others_at_the_tasks(winner):
    found, trials = made({winner: (0.1, 0.1)})
    words = PLAN_LABELS[winner]
    assert (f"**{words}**" in grid(found.tables["criteria"])) == (found.winner == words)
    assert (found.badge.what, found.badge.verdict) == ("task error", "undecided")
    assert words in (found.badge.winner, found.badge.rival)
    medians = {name: np.median(pick(trials, "measured", name, PLANNED)) for name in NAMES if name != "test"}
    assert PLAN_LABELS[min(medians, key=medians.get)] in (found.badge.winner, found.badge.rival)


def test_every_table_names_plans_in_words_and_its_rows_keep_the_keys(both):
    found, _ = both
    for name in ("criteria", "enough", "poses"):
        shown = read_back(found).tables[name]
        assert {shown.columns[0].cell(row) for row in shown.rows} == {PLAN_LABELS[key] for key in NAMES}
    assert [row.plan for row in found.numbers["criteria"]] == list(NAMES)
    assert {row.criterion for row in found.numbers["plans"]} == {*CRITERIA}
    named = {found.badge.winner, found.badge.rival}
    assert named < {*PLAN_LABELS.values()}
    assert all(words in found.answer for words in named)


@pytest.mark.parametrize(
    ("planned", "chance", "fewest"),
    [((9e-4, 1e-3), (1, 2e-3), (8, 12)), ((1, 2e-3), (1, 1), (12, None)), ((1, 1), (1, 1), (None, None))],
)
def test_the_number_of_poses_is_the_least_that_is_enough_in_all_trials(both, planned, chance, fewest):
    trials = both[1]
    for name, n, factor in zip(
        ("test", "test", "random", "random"), 2 * POSES, planned + chance, strict=True
    ):
        meant, own = (trials["plan"] == name) & (trials["poses"] == n), trials["tasks_mm"]
        trials = trials.add(tasks_mm=np.where(meant, factor * own, own))
    found = STUDY.report(ASKED, SEEDS, trials).numbers["recommendation"].fewest
    assert (found["test"], found["random"]) == fewest


def test_the_figure_draws_the_reports_numbers_in_the_look_of_each_criterion(both):
    drawn, f = STUDY.figures(both[0]), both[0].numbers
    fits, keys = (PLANNED, PLANNED, BARE, INCUMBENT), ("tasks_mm", "workspace_mm", "tasks_mm", "tasks_mm")
    looks_differ(key_of(drawn["pose_selection.png"]))
    for axes, fit, key in zip(drawn["pose_selection.png"].axes, fits, keys, strict=True):
        assert unit_in(axes.get_ylabel()) == "mm"
        levels = {name: [r for r in f["errors"] if (r.fit, r.plan) == (fit, name)] for name in NAMES}
        assert axes.get_ylim() == drawn["pose_selection.png"].axes[0].get_ylim()  # one quantity, one scale
        in_words = {words: name for name, words in PLAN_LABELS.items()}
        for words, (x, y) in curves(axes).items():
            name = in_words[words]
            assert (x.tolist(), y.tolist()) == ([8, 12], [level[key].median for level in levels[name]])
        for name, shade in zip(("test", "random"), bands(axes), strict=True):
            assert [row[1:] for row in shade] == [ends(level[key]) for level in levels[name]]
    quick, _ = made(scope=replace(SCOPE, poses=(12,), fewer=(12,)))
    rows = quick.numbers["criteria"]
    assert STUDY.figures(read_back(quick)).keys() == {"pose_selection.png"}
    for axes, key in zip(STUDY.figures(quick)["pose_selection.png"].axes, keys[:2], strict=True):
        first = place_of(quick, [PLAN_LABELS[row.plan] for row in rows])
        check_forest(
            axes, [row[key] for row in rows], [LOOKS[PLAN_LABELS[row.plan]] for row in rows], first=first
        )
