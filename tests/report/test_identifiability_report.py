"""What is said and drawn of the worth of a prior is what its trials hold, of trials that are made up."""

import itertools

import numpy as np
import pytest
from checks import check_pivot, check_spread
from made_up import of_one_trial
from reports import check, check_cells, check_forest, table_of

from testbench.campaign.campaign import Scenario
from testbench.studies.identifiability.coverage import Covered
from testbench.studies.identifiability.study import STUDY, figures, report
from testbench.studies.identifiability.trial import MethodRow, Settings, TrialRow
from testbench.trials.spread import middle
from testbench.trials.spread import most as greatest
from testbench.views.colours import look

SEEDS = range(4, 7)
ASKED = Settings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=5), 4, 3, 3, 3, 3)
KINDS = {
    "Joints": ("Joints", "none", "none"),
    "MLS56": ("MLS56", "none", "none"),
    "MLS56, PSD of equal fit": ("MLS56", "free", "none"),
    "MGCO56": ("MGCO56", "psd", "none"),
    "MGCO68": ("MGCO68", "psd", "none"),
    "MGCO56, least trace": ("MGCO56", "psd", "least trace"),
    "MGCO56, LS + prior": ("MGCO56", "none", "prior"),
    "MGCO56, GCO + prior": ("MGCO56", "psd", "prior"),
    "MGCO68, GCO + prior": ("MGCO68", "psd", "prior"),
    "MGCO68, GCO + log-det": ("MGCO68", "psd", "log-det prior"),
}
"""Structure, constraint and filling by the model's name."""
VARIED = {
    "scale": ((0.2, 2.5), ("MGCO56, LS + prior", "MGCO56, GCO + prior")),
    "poses": ((5, 13), ("Joints", "MGCO56", "MGCO56, GCO + prior")),
}
COVERED = {"a": "linearised", "b": "posterior", "c": "set", "d": "learnt", "e": "believed"}


def fit(rng, name, part, errors, **more):
    structure, constraint, filling = KINDS[name]
    own = {"name": name, "structure": structure, "constraint": constraint, "filling": filling, "part": part}
    own |= {"prior": "prior" in filling, "parameters": 56, "rank": 27, "conservative": True}
    own |= {"scale": None, "poses": None}
    if name in errors:
        own["rms_um"] = (1.5 if part == "nonlinear" else 1.0) * errors[name]
    return TrialRow(fit=of_one_trial(MethodRow, rng, **own | more))


def rows(seed, errors):
    rng = np.random.default_rng(seed)
    yield from (fit(rng, name, part, errors) for part in ("linear", "nonlinear") for name in KINDS)
    for part, (at, names) in VARIED.items():
        yield from (fit(rng, name, part, {}, **{part: x}) for x in at for name in names)
    for name, kind in COVERED.items():
        inside = tuple(bool(own) for own in rng.integers(4, size=6))
        yield TrialRow(intervals=Covered(name, kind, inside, (*rng.uniform(10, 90, 5), np.inf)))


def made(errors=None, count=3):
    trials = table_of(SEEDS[:count], lambda seed: list(rows(seed, errors or {})))
    return report(ASKED, SEEDS[:count], trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def test_models_and_what_is_swept_are_those_of_their_trials(whole):
    found, trials = whole
    check(found, STUDY.printed)
    f, fits = found.numbers, trials.pick(trials["intervals.name"] == None).inside("fit")  # noqa: E711
    parts = {"models": "linear", "nonlinear": "nonlinear", "scales": "scale", "poses": "poses"}
    for key, part in parts.items():
        check_cells(f[key], fits.where(part=part), *({part} & {"scale", "poses"}))
    for m, key in itertools.product(f["models"], ("rms", "p95", "max")):
        check_spread(m.workspace[f"{key}_mm"], fits.where(part="linear", name=m.name)[f"{key}_um"] / 1e3)
    assert " um with one 5 times too stiff, " in found.claims[1]  # 0.2 times as soft
    assert found.claims[1].endswith(" um with one 2.5 times too soft.")
    check_pivot(found.tables["poses"], f["poses"], ("name", "poses", "rms_um"))


def test_shares_of_intervals_are_those_of_their_datasets(whole):
    found, trials = whole
    f, every = found.numbers, {}
    for row in [*f["coverage"].values(), *f["family_coverage"].values()]:
        own, every[row.interval] = trials.where(**{"intervals.name": row.interval}), row
        inside = np.array([*own["intervals.inside"]])
        assert row.covered_percent == pytest.approx(100 * inside.mean())
        assert row.all_covered == np.mean(inside.all(axis=1))
        error = 100 * inside.mean(axis=1).std(ddof=1) / np.sqrt(3)
        assert row.standard_error_percent == pytest.approx(error)
        assert row.width_um == pytest.approx(np.mean([own[:5] for own in own["intervals.width_um"]]))
        assert row.unbounded_percent == pytest.approx(100 / 6)
    assert (list(f["coverage"]), list(f["family_coverage"])) == (["a", "b", "c"], ["d", "e"])
    a, b, _, learnt, believed = (row.covered_percent for row in every.values())
    said = found.claims[-1]
    assert f"in {min(a, b):.1f} to {max(a, b):.1f} % of the cases" in said
    assert f"in {learnt:.1f} to {learnt:.1f} % with a learnt prior, in {believed:.1f} to" in said


@pytest.mark.parametrize("winner", KINDS)
def test_the_answer_is_the_gain_of_the_best_whichever_it_is(winner):
    found, _ = made({"MLS56": 7.0, winner: 2.0})
    rival = "" if winner == "MLS56" else ", least squares without prior 7 um; 3.5 times smaller"
    assert found.answer.startswith(f"Over the workspace: {winner} 2 um{rival}.")
    joints = found.numbers["models"][0].rms_um
    assert (f"Joint stiffness only {middle(joints):.0f} um" in found.answer) == (winner != "Joints")
    plain, size = (winner, 2) if KINDS[winner][2] in ("none", "least trace") else ("MLS56", 7)
    assert f"Without a prior {plain} errs least, {size} um." in found.claims[0]
    rival = rival.replace("7 um", "10 um")
    assert found.worst.startswith(f"With non-linear truth: {winner} 3 um{rival}.")
    most = next(m.max_um for m in found.numbers["nonlinear"] if m.name == winner)
    assert found.worst.endswith(
        f"{winner} errs {greatest(most):.0f} um at the worst place of the worst trial."
    )


def test_of_models_alike_that_by_gco_is_named():
    found, _ = made({"MGCO56, LS + prior": 2.0, "MGCO68, GCO + prior": 2.0}, count=1)
    check(found, STUDY.printed)  # one seed has no spread
    assert found.answer.startswith("Over the workspace: MGCO68, GCO + prior 2 um")
    assert found.numbers["best"] == ["MGCO68, GCO + prior", "MGCO56, LS + prior"]


def test_the_figure_draws_the_numbers_of_both_truths_in_the_colour_of_each_model(whole):
    found, _ = whole
    rows = found.tables["models"].rows
    assert rows[0].name == found.badge.winner
    looks = [look(m.structure, m.constraint, m.prior, m.filling) for m in rows]
    straight, bent = figures(found)["identifiability.png"].axes
    first = 0, bool(found.winner)
    check_forest(straight, [m.rms_um for m in rows], looks, "um", first)
    check_forest(bent, [m.nonlinear.rms_um for m in rows], looks, "um", first)
    assert bent.get_title() == "MuJoCo's non-linear truth"
