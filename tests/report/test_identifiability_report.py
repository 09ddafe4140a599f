"""What is said and drawn of the worth of a prior is what its trials hold, of trials that are made up."""

import functools

import numpy as np
import pytest
from checks import bands, check_spread, curves, tables_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.bench.campaign import Scenario
from testbench.bench.rows import ErrorRow
from testbench.studies.identifiability import report as told
from testbench.studies.identifiability.campaigns import TrialRow, Tried
from testbench.studies.identifiability.coverage import Covered
from testbench.studies.identifiability.methods import ModelRow
from testbench.studies.identifiability.report import BANDS, figures, report
from testbench.studies.identifiability.trial import Settings
from testbench.trials.spread import ends, middle
from testbench.views.colours import look
from testbench.views.markdown import grid
from testbench.views.schema import show

SEEDS = range(4, 7)
ASKED = Settings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=5), Tried(), 4, 3, 3, 3, 3)
KINDS = {
    "Joints": ("Joints", "none", "none", "least squares"),
    "MLS56": ("MLS56", "none", "none", "least squares"),
    "MLS56, PSD of equal fit": ("MLS56", "free", "none", "conservative least squares of equal fit"),
    "MGCO56": ("MGCO56", "psd", "none", "GCO"),
    "MGCO68": ("MGCO68", "psd", "none", "GCO"),
    "MGCO56, least trace": ("MGCO56", "psd", "least trace", "GCO of least trace"),
    "MGCO68, least trace": ("MGCO68", "psd", "least trace", "GCO of least trace"),
    "MGCO56, LS + prior": ("MGCO56", "none", "prior", "least squares with prior"),
    "MGCO56, GCO + prior": ("MGCO56", "psd", "prior", "GCO with prior"),
    "MGCO68, LS + prior": ("MGCO68", "none", "prior", "least squares with prior"),
    "MGCO68, GCO + prior": ("MGCO68", "psd", "prior", "GCO with prior"),
    "MGCO68, GCO + log-det": ("MGCO68", "psd", "log-det prior", "GCO with log-det prior"),
}
"""Structure, constraint, filling and the method in words, by the model's name."""
SCALED = ("MGCO56, LS + prior", "MGCO56, GCO + prior", "MGCO68, GCO + prior")
OVER_POSES = ("Joints", "MLS56", "MGCO56", "MGCO68", "MGCO56, GCO + prior")
CHOICE = ("Joints", "MGCO56", "MGCO68")
COVERED = {"a": "linearised", "b": "posterior", "c": "set", "d: learnt": "family", "d: believed": "family"}
FIRST = functools.cache(functools.partial(told._first_campaign, ASKED, 4))


def fit(rng, name, part, errors):
    structure, constraint, filling, _ = KINDS.get(name, (name, "psd", "prior", ""))
    own = {"structure": structure, "constraint": constraint, "filling": filling}
    if name in errors:
        mm = (1.5 if part == "nonlinear" else 1.0) * errors[name]
        own["workspace"] = of_one_trial(ErrorRow, rng, rms_mm=mm)
    ratio = rng.uniform(0.99, 1.02) if (constraint, filling) == ("none", "prior") else None
    prior = filling in ("prior", "log-det prior")
    known = {"name": name, "prior": prior, "parameters": 56, "gco_over_ls_at_this_strength": ratio}
    return of_one_trial(ModelRow, rng, advice=(), trace_bounds_rad_per_Nm=None, **known, **own)


def rows(seed, errors):
    rng = np.random.default_rng(seed)
    parts = ("linear", "nonlinear")
    yield from (TrialRow(part, fit(rng, name, part, errors)) for part in parts for name in KINDS)
    for part, at, names in (("scale", (0.2, 2.5), SCALED), ("poses", (5.0, 13.0, 40.0), OVER_POSES)):
        yield from (TrialRow(part, fit(rng, name, part, {}), x) for x in at for name in names)
    yield from (TrialRow("fixed scale", fit(rng, name, "", {})) for name in CHOICE[1:])
    best = CHOICE[1 + seed % 2]
    for name in CHOICE:
        held_out, chosen = float(rng.uniform(1, 9)), name == best
        yield TrialRow("choice", fit(rng, name, "", {}), f_m_held_out=held_out, is_recommended=chosen)
    for part in ("clean", "plain", "robust"):
        yield TrialRow(part, fit(rng, "MGCO68", part, {}), spoiled=3, rejected=4)
    for name, kind in COVERED.items():
        inside = tuple(bool(own) for own in rng.integers(4, size=6))
        yield TrialRow(intervals=Covered(name, kind, inside, (*rng.uniform(10, 90, 5), np.inf)))


def made(errors=None, count=3):
    trials = table_of(SEEDS[:count], lambda seed: list(rows(seed, errors or {})))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(told, "_first_campaign", lambda *_: FIRST())
        return report(ASKED, SEEDS[:count], trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def rms(trials, part, name, where="workspace", **more):
    return trials.where(part=part, **{"fit.name": name}, **more)[f"fit.{where}.rms_mm"]


def shown(table):
    [(head, cells)] = tables_of(grid(table))
    return {line[0]: dict(zip(head, line, strict=True)) for line in cells}


def test_models_pairs_and_what_is_swept_are_those_of_their_trials(whole):
    found, trials = whole
    check(found, ["short"])
    f = found.numbers
    for part, models, table in (
        ("linear", f["models"], "models"),
        ("nonlinear", f["nonlinear"], "nonlinear"),
    ):
        cells = shown(found.tables[table])
        assert list(cells) == [m.name for m in models] == list(KINDS)
        for m in models:
            check_spread(m.workspace.rms_mm, rms(trials, part, m.name))
            assert cells[m.name]["RMS workspace, true, mm"] == show(m.workspace.rms_mm)
            assert cells[m.name]["max workspace, true, mm"] == show(m.workspace.max_mm)
            assert cells[m.name]["RMS check, readings, mm"] == show(m.check.rms_mm)
            assert cells[m.name]["RMS check, true, mm"] == show(m.check_true.rms_mm)
            assert cells[m.name]["uncertainty of the prior, %"] == show(m.uncertainty_percent, ".0f")
    for m, other in zip(f["models"], f["nonlinear"], strict=True):
        if m.name in shown(found.tables["short"]):
            line = shown(found.tables["short"])[m.name]
            assert line["RMS workspace, true, mm"] == show(m.workspace.rms_mm)
            assert line["non-linear truth, mm"] == show(other.workspace.rms_mm)
    for duel in f["duels_nonlinear"]:
        a, b = (rms(trials, "nonlinear", name) for name in (duel.ours, duel.theirs))
        check_spread(duel.ratio, a / b)
        assert (duel.wins, duel.ties, duel.seeds) == (np.sum(a < b), 0, 3)
        a, b = (rms(trials, "nonlinear", name, where="check_true") for name in (duel.ours, duel.theirs))
        assert duel.check_wins == np.sum(a < b)
    for part, key, x in (("poses", "poses", "poses"), ("scale", "scales", "scale")):
        cells = shown(found.tables[key])
        for row in f[key]:
            check_spread(row.workspace.rms_mm, rms(trials, part, row.name, x=row[x]))
            assert cells[row.name][f"{row[x]:g}"] == show(row.workspace.rms_mm)
    for row in f["beaten"]:
        a, b = (rms(trials, "poses", name, x=row.poses) for name in ("MGCO56", "Joints"))
        assert row.wins == np.sum(a < b)


def test_choice_outliers_and_shares_of_intervals_are_those_of_their_trials(whole):
    found, trials = whole
    f, choice = found.numbers, shown(found.tables["choice"])
    assert f["choice"].recommended == ["MGCO56"]  # two of three seeds
    taken = [
        rms(trials, "choice", name, seed=seed)[0] for seed, name in zip(SEEDS, CHOICE[1:] * 2, strict=False)
    ]
    check_spread(f["choice"].chosen_workspace_mm, taken)
    errors = np.array([rms(trials, "choice", name) for name in CHOICE])
    check_spread(f["choice"].best_workspace_mm, errors.min(axis=0))
    assert [choice[name]["recommended"] for name in CHOICE] == ["no", "67 %", "33 %"]
    assert f["outliers"].robust_mm.median == np.median(rms(trials, "robust", "MGCO68"))
    cells = shown(found.tables["coverage"])
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
        assert line["standard error, %"] == f"{error:.1f}"
        assert (line["unbounded, %"], line["mean width, um"]) == ("17", f"{row.width_um:.0f}")
    ratios = trials.where(part="linear")["fit.gco_over_ls_at_this_strength"]
    worse = np.sum(ratios > 1.001)
    for name, row in f["never_worse"].items():  # of three seeds: more and less are never as many
        own = trials.where(part="linear", **{"fit.name": f"{name}, LS + prior"})
        assert row.seeds_worse == np.sum(own["fit.gco_over_ls_at_this_strength"] > 1.001)
    said = (
        f"GCO errs {np.nanmin(ratios):.3f} to {np.nanmax(ratios):.3f} times least squares, more in {worse} of"
    )
    assert said in found.claims[2]


@pytest.mark.parametrize("winner", KINDS)
def test_the_answer_is_the_gain_of_the_best_whichever_it_is(winner):
    structure, _, filling, method = KINDS[winner]
    found, _ = made({"MLS56": 7.0, winner: 2.0})
    name = f"{method} ({structure})"
    if winner == "MLS56":
        assert found.answer.startswith(f"Best over the workspace is {name}, 2.000 mm.")
    else:
        said = f"RMS workspace error: {winner} 2.000 mm, least squares 7.000 mm; 3.5 times less."
        assert found.answer.startswith(said)
    assert f"Joints alone {middle(found.numbers['joints'].workspace.rms_mm):.3f} mm" in found.answer
    plain = name if filling in ("none", "least trace") else "least squares (MLS56)"
    size = middle(2.0 if filling in ("none", "least trace") else 7.0)
    assert found.claims[0] == f"Without a prior the least error is that of {plain}: {size:.3f} mm."
    assert f"; without a prior {plain}, {1.5 * size:.3f} mm; joints alone" in "\n".join(found.claims)
    assert f"Worst with non-linear truth: {winner} 3.000 mm" in found.worst
    assert found.numbers["best"].methods == (name,)


def test_of_methods_alike_that_by_gco_is_named():
    found, _ = made({"MGCO56, LS + prior": 2.0, "MGCO68, GCO + prior": 2.0})
    assert found.answer.startswith("RMS workspace error: MGCO68, GCO + prior 2.000 mm")
    alike = ("least squares with prior (MGCO56)", "GCO with prior (MGCO68)")
    assert found.numbers["best"].methods == alike


def test_the_sentences_carry_the_numbers_of_their_models(whole):
    found, _ = whole
    f, text = found.numbers, "\n".join(found.claims)
    error = {m.name: middle(m.workspace.rms_mm) for m in f["models"]}
    for name in CHOICE[1:]:
        assert f"{name} {error[name]:.3f} mm without, {error[f'{name}, GCO + prior']:.3f} mm with it" in text
    other = {m.name: middle(m.workspace.rms_mm) for m in f["nonlinear"]}
    assert f"squares {other['MLS56']:.3f} mm, joints alone {other['Joints']:.3f} mm." in found.worst
    assert f"With 5, 13, 40 poses MGCO56 without a prior beats Joints in {f['beaten'][0].wins}, " in text
    assert f"believed, MGCO56 errs by {show(f['fixed_scale'].MGCO56)} mm." in text
    plain, robust, clean = (show(f["outliers"][f"{key}_mm"]) for key in ("plain", "robust", "clean"))
    assert f"MGCO68 errs by {plain} mm with the plain loss, {robust} mm with the robust one" in text
    assert f"without outliers by {clean} mm." in text
    a, b, c = (f["coverage"][key].covered_percent for key in "abc")
    assert f"in {min(a, b):.1f} to {max(a, b):.1f} % of the cases" in found.claims[4]
    assert f"deflection in at least {c:.1f} %." in text
    learnt, believed = (f["family_coverage"][f"d: {how}"].covered_percent for how in ("learnt", "believed"))
    assert f"holds it in {learnt:.1f} to {learnt:.1f} %; a prior believed" in text
    assert f"normal intervals in {believed:.1f} to" in text


def test_one_seed_has_no_spread_and_no_pairs():
    found, _ = made(count=1)
    check(found, ["short"])
    assert found.numbers["duels"] == []
    assert " (" not in grid(found.tables["models"])


def test_the_figures_draw_the_numbers_in_the_colour_of_each_model(whole):
    found, _ = whole
    f, drawn = found.numbers, figures(found)
    models = {m.name: m for m in f["models"]}
    shade = {m.name: look(m.structure, m.constraint, m.prior, m.filling).hex for m in models.values()}
    [axes] = drawn["identifiability.png"].axes
    assert unit_in(axes.get_xlabel()) == "mm"
    names = [t.get_text().rsplit("  ", 1)[0] for t in axes.get_yticklabels()]
    for y, name in enumerate(names):
        line, dot = [own for own in axes.get_lines() if np.ravel(own.get_ydata()).tolist() in ([y], [y, y])]
        assert tuple(line.get_xdata()) == ends(models[name].workspace.rms_mm)
        assert np.ravel(dot.get_xdata())[0] == middle(models[name].workspace.rms_mm)
        assert dot.get_color() == shade[name]
    gco = [name for name in SCALED if KINDS[name][1] == "psd"]
    for png, key, x, wanted, label in (
        ("poses.png", "poses", "poses", OVER_POSES, "poses"),
        ("prior_scale.png", "scales", "scale", gco, "prior softer than the truth, times"),
    ):
        [axes] = drawn[png].axes
        lines, banded = curves(axes), iter(bands(axes))
        assert (list(lines), axes.get_xlabel(), unit_in(axes.get_ylabel())) == ([*wanted], label, "mm")
        for name in wanted:
            own = [row for row in f[key] if row.name == name]
            assert lines[name][0].tolist() == [row[x] for row in own]
            assert lines[name][1].tolist() == [middle(row.workspace.rms_mm) for row in own]
            if name in BANDS:
                spread = [(row[x], *ends(row.workspace.rms_mm)) for row in own]
                np.testing.assert_allclose(next(banded), spread)
        assert next(banded, None) is None
