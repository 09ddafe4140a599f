"""What is said and drawn of the worth of a prior is what its trials hold, of trials that are made up."""

import numpy as np
import pytest
from checks import check_spread, tables_of
from made_up import of_one_trial
from reports import check, check_forest, table_of

from testbench.campaign.campaign import Scenario
from testbench.campaign.campaign_row import Measured
from testbench.campaign.rows import ErrorRow
from testbench.studies.identifiability.coverage import Covered
from testbench.studies.identifiability.fits import ModelRow, TrialRow, Tried
from testbench.studies.identifiability.report import figures, report
from testbench.studies.identifiability.trial import Settings
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.markdown import grid
from testbench.views.schema import show

SEEDS = range(4, 7)
ASKED = Settings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=5), Tried(), 4, 3, 3, 3, 3)
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
    "poses": ((5.0, 13.0), ("Joints", "MGCO56", "MGCO56, GCO + prior")),
}
COVERED = {"a": "linearised", "b": "posterior", "c": "set", "d: learnt": "family", "d: believed": "family"}


def fit(rng, name, part, errors):
    structure, constraint, filling = KINDS[name]
    own = {"structure": structure, "constraint": constraint, "filling": filling}
    if name in errors:
        mm = (1.5 if part == "nonlinear" else 1.0) * errors[name]
        own["workspace"] = of_one_trial(ErrorRow, rng, rms_mm=mm)
    prior = filling in ("prior", "log-det prior")
    known = {"name": name, "prior": prior, "parameters": 56, "rank": 27}
    return of_one_trial(ModelRow, rng, advice=(), trace_bounds_rad_per_Nm=None, **known, **own)


def rows(seed, errors):
    rng = np.random.default_rng(seed)
    if seed == SEEDS[0]:
        yield TrialRow(measured=of_one_trial(Measured, rng))
    parts = ("linear", "nonlinear")
    yield from (TrialRow(part, fit(rng, name, part, errors)) for part in parts for name in KINDS)
    for part, (at, names) in VARIED.items():
        yield from (TrialRow(part, fit(rng, name, part, {}), x) for x in at for name in names)
    for name, kind in COVERED.items():
        inside = tuple(bool(own) for own in rng.integers(4, size=6))
        yield TrialRow(intervals=Covered(name, kind, inside, (*rng.uniform(10, 90, 5), np.inf)))


def made(errors=None, count=3):
    trials = table_of(SEEDS[:count], lambda seed: list(rows(seed, errors or {})))
    return report(ASKED, SEEDS[:count], trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def rms(trials, part, name, **more):
    return trials.where(part=part, **{"fit.name": name}, **more)["fit.workspace.rms_mm"]


def shown(table):
    [(head, cells)] = tables_of(grid(table))
    return {line[0]: dict(zip(head, line, strict=True)) for line in cells}


def test_models_pairs_and_what_is_swept_are_those_of_their_trials(whole):
    found, trials = whole
    check(found, ["short"])
    f, cells = found.numbers, shown(found.tables["models"])
    assert list(cells) == [m.name for m in f["models"]] == list(KINDS)
    for m, other in zip(f["models"], f["nonlinear"], strict=True):
        check_spread(m.workspace.rms_mm, rms(trials, "linear", m.name))
        check_spread(other.workspace.rms_mm, rms(trials, "nonlinear", m.name))
        line = cells[m.name]
        assert line["RMS workspace, true, mm"] == show(m.workspace.rms_mm)
        assert line["non-linear truth, mm"] == show(other.workspace.rms_mm)
        assert line["RMS check, readings, mm"] == show(m.check.rms_mm)
        assert line["RMS check, true, mm"] == show(m.check_true.rms_mm)
        assert line["uncertainty of the prior, %"] == show(m.uncertainty_percent, ".0f")
    for part, key, x in (("poses", "poses", "poses"), ("scale", "scales", "scale")):
        for row in f[key]:
            check_spread(row.workspace.rms_mm, rms(trials, part, row.name, x=row[x]))
    assert shown(found.tables["poses"])["Joints"]["13"] == show(f["poses"][3].workspace.rms_mm)


def test_shares_of_intervals_are_those_of_their_datasets(whole):
    found, trials = whole
    f, cells = found.numbers, shown(found.tables["coverage"])
    for row in [*f["coverage"].values(), *f["family_coverage"].values()]:
        own = trials.where(**{"intervals.name": row.interval})
        inside = np.array([*own["intervals.inside"]])
        assert row.covered_percent == pytest.approx(100 * inside.mean())
        assert row.all_covered == np.mean(inside.all(axis=1))
        error = 100 * inside.mean(axis=1).std(ddof=1) / np.sqrt(3)
        assert row.standard_error_percent == pytest.approx(error)
        assert row.width_um == pytest.approx(np.mean([own[:5] for own in own["intervals.width_um"]]))
        line = cells[row.interval]
        assert line["covered, %"] == f"{row.covered_percent:.1f}"
        assert (line["unbounded, %"], line["mean width, um"]) == ("17", f"{row.width_um:.0f}")
    a, b = (f["coverage"][key].covered_percent for key in "ab")
    learnt, believed = (f["family_coverage"][f"d: {how}"].covered_percent for how in ("learnt", "believed"))
    said = found.claims[-1]
    assert f"in {min(a, b):.1f} to {max(a, b):.1f} % of the cases" in said
    assert f"in {learnt:.1f} to {learnt:.1f} % with a learnt prior, in {believed:.1f} to" in said


@pytest.mark.parametrize("winner", KINDS)
def test_the_answer_is_the_gain_of_the_best_whichever_it_is(winner):
    found, _ = made({"MLS56": 7.0, winner: 2.0})
    if winner == "MLS56":
        assert found.answer.startswith("Best over the workspace is MLS56.")
    else:
        said = f"RMS workspace error: {winner} 2.000 mm, least squares 7.000 mm; 3.5 times smaller."
        assert found.answer.startswith(said)
    assert f"Joint stiffness only {middle(found.numbers['joints'].workspace.rms_mm):.3f} mm" in found.answer
    plain, size = (winner, 2.0) if KINDS[winner][2] in ("none", "least trace") else ("MLS56", 7.0)
    assert f"Without a prior {plain} errs least, {size:.3f} mm." in found.claims[0]
    assert f"Worst with non-linear truth: {winner} 3.000 mm" in found.worst


def test_of_models_alike_that_by_gco_is_named():
    found, _ = made({"MGCO56, LS + prior": 2.0, "MGCO68, GCO + prior": 2.0})
    assert found.answer.startswith("RMS workspace error: MGCO68, GCO + prior 2.000 mm")
    assert found.numbers["best"] == ["MGCO68, GCO + prior", "MGCO56, LS + prior"]


def test_one_seed_has_no_spread():
    found, _ = made(count=1)
    check(found, ["short"])
    assert " (" not in grid(found.tables["models"])


def test_the_figure_draws_the_numbers_of_both_truths_in_the_colour_of_each_model(whole):
    found, _ = whole
    rows = found.tables["short"].rows
    looks = [look(m.structure, m.constraint, m.prior, m.filling) for m in rows]
    straight, bent = figures(found)["identifiability.png"].axes
    check_forest(straight, [m.workspace.rms_mm for m in rows], looks)
    others = {m.name: m.workspace.rms_mm for m in found.numbers["nonlinear"]}
    check_forest(bent, [others[m.name] for m in rows], looks)
