"""The report of every campaign is what its trials hold, by brute force, of trials that are made up."""

from importlib import import_module

import numpy as np
import pytest
from campaign_rows import COVERED, EXPECTED, GRIDS, MODELS, TRIALS
from checks import check_spread, curves
from legible import check_legible
from read_back import sound, views
from reports import check, check_drawn_alike, table_of

from testbench.plant.true_arms import HELD_OUT_TRUE_ARMS
from testbench.report.badge import LEAST_SQUARES
from testbench.report.recording.run import write_run
from testbench.report.recording.stream import RecordingHeader
from testbench.report.scene import PageContent
from testbench.report.schema import KNOWN, TRUE_ARM_LABELS
from testbench.report.table import SHARED
from testbench.runs.spread import Spread, middle
from testbench.studies.campaign import regimes, which_model
from testbench.studies.campaign.regimes import FREE, KINDS, pays
from testbench.studies.campaign.report import RIVALS
from testbench.studies.run import headed_figures
from testbench.workflows.models import PRIORS

SEEDS = range(1, 7)
SCORES = {"rms_mm", "p95_mm", "max_mm"}


class Whole:
    """A preset, its report and its trials, as they were and with what it derives."""

    def __init__(self, name):
        self.name, (self.asked, rows) = name, TRIALS[name]
        module = import_module(f"testbench.studies.campaign.{name}")
        self.study, self.preset = module.STUDY, module.PRESET
        self.trials = table_of(SEEDS, lambda seed: [*rows(seed)])
        self.own = self.preset.derived(self.asked, self.trials)
        self.found = self.study.report(self.asked, SEEDS, self.trials)

    @property
    def numbers(self):
        return self.found.numbers


MADE = {}


def of(name):
    if name not in MADE:
        MADE[name] = Whole(name)
    return MADE[name]


LARGE = {"which_model", "regimes", "identifiability"}
"""Presets whose reports take longest: `make studies` reads them too."""


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=[pytest.mark.study] * (name in LARGE)) for name in TRIALS],
)
def whole(request):
    return of(request.param)


def test_all_views_show_the_tables_and_what_is_read_back_is_the_same(whole):
    text = check(whole.found, whole.study.printed)
    assert f"docs/studies/{whole.name}.md" in text
    assert whole.found.answer == whole.found.worst == ""  # the badge is all that is made of numbers


def test_every_cell_is_the_median_of_its_own_trials(whole):
    for name, grid in whole.preset.tables(whole.asked).items():
        if grid.rows:
            continue
        by = {key for key in ("name", grid.down, grid.across, *grid.by.split()) if key}
        cells, own = whole.numbers["cells"][name], whole.own.where(**grid.where)
        met = set(zip(*(own[key].tolist() for key in sorted(by)), strict=True))
        assert {tuple(cell[key] for key in sorted(by)) for cell in cells} <= met
        assert len(cells) >= len(met) - sum("equal fit" in str(key) for key in met)
        for cell in cells:
            values = own.where(**{key: cell[key] for key in by})[grid.value]
            check_spread(cell[grid.value], values)


def test_pairs_are_compared_trial_by_trial(whole):
    f, value = whole.numbers, whole.preset.value
    at = whole.own.where(**f["at"])
    assert [row.theirs for row in f["rivals"]]
    for row in f["rivals"]:
        ours, theirs = (
            dict(zip(own["seed"].tolist(), own[value], strict=True))
            for own in (at.where(name=row.ours), at.where(name=row.theirs))
        )
        ratio = np.array([ours[seed] / theirs[seed] for seed in ours])
        check_spread(row.error_ratio, ratio)
        check_spread(row.ours_error, [*ours.values()])
        check_spread(row.theirs_error, [theirs[seed] for seed in ours])
        assert (row.won, row.trials) == (np.mean(ratio < 1), len(ratio))
        assert row.worst_ratio == ratio.max()
        worst = [*ours][int(ratio.argmax())]
        assert str(worst).split(" ")[0] == str(row.worst_seed)
    shown = whole.found.tables[RIVALS].rows
    assert [(r.ours, r.theirs) for r in shown] == [(r.ours, r.theirs) for r in f["rivals"]]


def test_the_headline_is_the_verdict_beside_the_strongest_rival_of_its_class(whole):
    f, badge, value = whole.numbers, whole.found.badge, whole.preset.value
    at = whole.own.where(**f["at"])
    median = {
        name: np.median(own[value])
        for (name,), own in at.groups("name")
        if own["constraint"][0] in LEAST_SQUARES or own["structure"][0] == "Joints"
    }
    prior = dict(zip(at["name"], at["prior"], strict=True))
    rivals = whole.preset.rivals or [n for n in median if n != f["ours"] and prior[n] <= prior[f["ours"]]]
    strongest = min(rivals, key=median.get)
    assert {badge.winner, badge.rival} == {f["ours"], strongest}
    assert badge.n == len(at.where(name=f["ours"]))
    if badge.verdict == "tie":
        assert strongest in badge.ties
        assert badge.interval[0] <= 1.02
        assert badge.interval[1] >= 0.98


def test_models_of_the_headline_keep_the_contract(whole):
    f = whole.numbers
    own = whole.own.where(**f["at"])
    models = {m.name: m for m in f["models"]}
    where = next(iter(whole.preset.cells(whole.asked, whole.own)))
    for name in own.values("name"):
        model = models.get(f"{name}, {where}" if where else name)
        if model is None:
            assert "equal fit" in name
            continue
        assert {"method", "parameters", "rank", "conservative", "paper", "f_m", "check"} <= model.keys()
        assert model.workspace.keys() >= SCORES
        scale = 1.0 if whole.preset.value.endswith("_mm") else 1e-3
        check_spread(model.workspace.rms_mm, scale * own.where(name=name)[whole.preset.value])
    assert (f["seed"], f["trials"]) == ([*SEEDS], len(SEEDS))


def test_figures_are_drawn_alike_from_the_report_and_from_what_is_read_back(whole):
    check_drawn_alike(whole.study.figures, whole.found)
    for figure in headed_figures(whole.study, whole.found).values():
        figure.draw_without_rendering()
        check_legible(figure)


def test_a_recording_opens_on_the_panes_of_the_figures_and_no_view_is_an_image(whole, tmp_path):
    figures = whole.study.figures(whole.found)
    tables = [whole.found.tables[name] for name in whole.study.printed]
    file = tmp_path / "recording.rrd"
    write_run(file, RecordingHeader(whole.name, "{}", 1), whole.found, PageContent(tables=tables), figures)
    sound(file, whole.found.block("question"))
    titles = [" ".join(own.get_title().split()) for figure in figures.values() for own in figure.axes]
    kinds = [(kind, name) for _, kind, name in views(file)]
    assert {kind for kind, _ in kinds} == {"2D", "TextDocument"}
    shown = [name for kind, name in kinds if kind == "2D"]
    assert shown
    assert set(shown) <= set(titles)


def test_noise_costs_what_it_adds_in_quadrature_and_the_figure_shows_both_arms():
    whole = of("noise_sensitivity")
    for table, part in (("gravity", "gravity"), ("six_dof", "six_dof")):
        for row in whole.numbers["cells"][table]:
            own = whole.trials.where(part=part, name=row.name)
            calm, noisy = (own.where(sigma_um=x)["rms_um"] for x in (0.0, 200.0))
            check_spread(row.um_per_um, np.sqrt(np.maximum(0, noisy**2 - calm**2)) / 200)
    drawn = whole.study.figures(whole.found)["noise_sensitivity.png"]
    x, y = curves(drawn.axes[0])["GCO of all links and joints with prior (ALL153)"]
    own = whole.trials.where(part="gravity", name="ALL153 + prior")
    assert list(x) == [25.0, 50.0, 200.0]
    assert list(y) == [np.median(own.where(sigma_um=sigma)["rms_um"]) for sigma in x]
    for axes in drawn.axes:
        [guide] = [line for line in axes.get_lines() if line.get_label() == "proportional to the noise"]
        assert np.ptp(guide.get_ydata() / guide.get_xdata()) == pytest.approx(0)


def test_weighted_readings_are_compared_with_flat_ones_in_the_same_readings():
    whole = of("noise_sensitivity")
    read_ = whole.trials.where(part="instrument")
    rows = whole.numbers["cells"]["weights"]
    assert len(rows) == 4
    for row in rows:
        at = read_.where(name=row.name, truth=row.truth, distance_m=row.distance_m)
        ours, theirs = (at.where(instrument=way)["rms_um"] for way in ("weighted", "flat weights"))
        check_spread(row.error_ratio, ours / theirs)


def test_disturbances_are_ranked_by_what_they_add_and_the_papers_claim_is_counted():
    whole = of("model_error")
    family_ = whole.trials.where(part="family")

    def error(case, name, sigma):
        return family_.where(case=case, name=name, sigma_um=sigma)["rms_um"]

    ranking = whole.numbers["cells"]["ranking"]
    added = [middle(row.added_um) for row in ranking]
    assert added == sorted(added, reverse=True)
    for row in ranking:
        own, none = (error(case, "ALL153 + prior", 0.0) for case in (row.case, "none"))
        check_spread(row.added_um, own - none)
    for row in whole.numbers["cells"]["claim"]:  # two readings of three axes
        own, none = (error(case, row.name, 40.0) for case in (row.case, "none"))
        read_ = np.sqrt(own**2 + 6 * 40.0**2) / np.sqrt(none**2 + 6 * 40.0**2) - 1
        for key, change in (("true", own / none - 1), ("read", read_)):
            check_spread(row[f"{key}_change_percent"], 100 * change)
            assert row[f"{key}_within"] == np.mean(np.abs(change) <= 0.048)


def test_kinds_of_arms_hold_their_own_trials_coverage_and_rivals():
    whole = of("model_error")
    noisy = whole.trials.where(sigma_um=40.0)
    rows = {row.kind: row for row in whole.numbers["cells"]["kinds"]}
    family_ = noisy.where(part="family", case="all together")
    parts = {"the family": family_, "undisturbed family": noisy.where(part="family", case="none")}
    parts |= {TRUE_ARM_LABELS[arm]: noisy.where(part="beside", true_arm=arm) for arm in HELD_OUT_TRUE_ARMS}
    parts |= {f"disturbances times {x:g}": noisy.where(part="beside", size=x) for x in (0.5, 2.0)}
    for kind, part in parts.items():
        default, joints, same = (
            part.where(name=name) for name in ("ALL153 + prior", "Joints", "MLS56 + prior")
        )
        row = rows[kind]
        check_spread(row.default_um, default["rms_um"])
        check_spread(row.Joints_um, joints["rms_um"])
        assert row.beats_same_prior == np.mean(default["rms_um"] < same["rms_um"])
        covered = default["cover.covered_percent"]
        assert row.covered_percent == pytest.approx(covered.mean())
        assert row.worst_tenth_percent == covered.min()  # of six


@pytest.mark.study
def test_promises_of_the_default_are_counted_over_all_cases_and_over_parts():
    whole = of("which_model")
    default = [r for seed in SEEDS for r in TRIALS["which_model"][1](seed) if r.name == which_model.CHOSEN]
    linked = [row for row in default if row.prior_error == "link"]
    parts = {"all": default, "12 poses": [row for row in default if row.poses == 12]}
    called = KNOWN["prior_error"].called
    parts |= {f"prior {called[name]}": [row for row in default if row.prior_error == name] for name in PRIORS}
    parts["a link off, more than 5 % of the deflection"] = [r for r in linked if r.link_share > 0.05]
    promises = {row["where"]: row for row in whole.numbers["cells"]["promises"]}
    for where, own in parts.items():
        row, covers = promises[where], [one.cover for one in own]
        assert row.cases == len(own)
        assert row.covered_percent == pytest.approx(np.mean([c.covered_percent for c in covers]))
        check_spread(row.over_ideal, [c.half_mm / c.ideal_mm for c in covers])
        assert row.doubted == pytest.approx(np.mean([len(one.doubted.contradicted) > 0 for one in own]))
        told = [one.wrong in one.doubted.contradicted for one in own if one.wrong]
        assert row.told == (pytest.approx(np.mean(told)) if told else None)
        link = [one for one in own if one.prior_error == "link"]
        both = [one.wrong in (*one.doubted.unchecked, *one.doubted.contradicted) for one in link]
        assert row.either == (pytest.approx(np.mean(both)) if link else None)
        others = [
            np.mean([one.wrong in o.doubted.unchecked for o in linked if o.wrong != one.wrong])
            for one in link
        ]
        assert row.otherwise == (pytest.approx(np.mean(others)) if link else None)


@pytest.mark.study
def test_losses_are_errors_more_than_five_per_cent_above_joint_stiffness_only():
    whole = of("which_model")
    for row in whole.numbers["cells"]["losses"]:
        at = whole.trials.where(poses=row.poses)
        over = at.where(name=row.name)["rms_um"] / at.where(name="Joints")["rms_um"]
        assert row.loses == pytest.approx(np.mean(over > 1.05))


@pytest.mark.study
def test_fits_are_sorted_by_what_is_expected_where_the_cone_binds():
    whole = of("regimes")
    for part, words in KINDS.items():
        every = whole.trials.where(part=part)
        levels = [
            r for r in whole.numbers["cells"]["levels"] if (r.part, r.theirs) == (part, regimes.SQUARES)
        ]
        assert [row.level for row in levels] == [f"{words}: {name}" for name in (*EXPECTED, FREE)]
        for row in levels:
            name = row.level.partition(": ")[2]
            binds = name != FREE
            at = every.where(binds=binds, **({"expected": EXPECTED[name]} if binds else {}))
            ours, theirs = (at.where(name=own)["rms_um"] for own in (regimes.GCO, regimes.SQUARES))
            check_spread(row.ratio, ours / theirs)
            assert row.fits_share == len(ours) / len(every.where(name=regimes.GCO))


@pytest.mark.study
def test_the_cone_pays_where_it_wins_in_nearly_all_fits_and_by_enough():
    gains = {Spread(0.5, 0.1, 0.99): True, Spread(0.5, 0.1, 1.01): False, Spread(0.96, 0.95, 0.97): False}
    assert {ratio: pays(ratio) for ratio in gains} == gains
    whole = of("regimes")
    for row in whole.numbers["cells"]["pays"]:
        [part] = [key for key, words in KINDS.items() if words == row.way]
        cells = GRIDS.grids[part].cells
        assert row.cells == 2 * len(cells)
        count = 0
        for structure in ("MGCO56", "ALL153"):
            for poses, sigma in cells:
                at = whole.trials.where(part=part, structure=structure, poses=poses)
                at = at.pick(np.isclose(at["sigma_um"], 1e6 * sigma))
                ratio = at.where(name=regimes.GCO)["rms_um"] / at.where(name=regimes.LENT)["rms_um"]
                high = ratio.max() if len(SEEDS) < 20 else np.quantile(ratio, 0.95)
                count += high < 1 and np.median(ratio) <= 0.95
        assert row.cone_pays == count


def test_shares_of_intervals_are_those_of_their_datasets():
    whole = of("identifiability")
    rows = {row.interval: row for row in whole.numbers["cells"]["coverage"]}
    assert {name: row.kind for name, row in rows.items()} == COVERED
    for name, row in rows.items():
        own = whole.trials.where(**{"intervals.name": name})
        inside = np.array([*own["intervals.inside"]])
        assert row.covered_percent == pytest.approx(100 * inside.mean())
        error = 100 * inside.mean(axis=1).std(ddof=1) / np.sqrt(len(SEEDS))
        assert row.standard_error_percent == pytest.approx(error)
        assert row.width_um == pytest.approx(np.mean([w[:5] for w in own["intervals.width_um"]]))
        assert row.unbounded_percent == pytest.approx(100 / 6)


def test_of_one_seed_the_calibration_has_no_spread_and_warns_of_what_nothing_limits():
    whole = of("gravity_calibration")
    one = whole.study.report(whole.asked, SEEDS[:1], whole.trials.where(seed=1))
    check(one, whole.study.printed)
    assert not any(isinstance(m.workspace.rms_mm, Spread) for m in one.numbers["models"])
    [claim] = one.claims
    assert "trace weight" in claim
    assert claim.endswith(" limits MGCO56.")
    assert {row.name for row in one.tables["worst"].rows} >= {"ALL153 + prior", "Joints"}
    for row in one.tables["worst"].rows:
        mm = one.numbers["map"].error_mm[row.name]
        assert row.place_error_mm == max(mm)
    assert set(MODELS) >= {m.name for m in one.numbers["models"]}


@pytest.mark.study
def test_cases_share_their_trial():
    for name in ("which_model", "regimes"):
        assert {*of(name).own[SHARED].tolist()} == set(SEEDS)
