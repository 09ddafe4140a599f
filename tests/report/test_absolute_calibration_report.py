"""Reports of absolute calibrations hold and draw what their trials hold, of trials that are made up."""

import numpy as np
import pytest
from checks import check_spread, curves
from made_up import of_one_trial
from reports import check, check_forest, place_of, read_back, table_of

from testbench.report.colours import GCO, LEAST_SQUARES
from testbench.report.table import find
from testbench.studies.absolute import simulated as s
from testbench.studies.absolute.simulated import BY, LOOKS, OPTIMUM, STUDY, Held
from testbench.workflows.model_names import row_words

SEEDS, NUMBERS = range(300, 306), (50, 200)
ALONE = (s.REAL, s.ABSOLUTE)
OWN = [(*ALONE, n, name) for n in NUMBERS for name in s.BY_POSES] + [(*ALONE, 200, s.WITH_LINKS)]
OWN += [(true, s.ABSOLUTE, 200, name) for true in [*s.TRUE_ARMS][1:] for name in s.HIDING]
OWN += [(s.REAL, campaign, 100, name) for campaign in [*s.CAMPAIGNS][1:] for name in s.COMPARED]


def row(rng, seed, key, kept):
    true_arm, campaign, poses, name = key
    optimum = rng.uniform(0.1, 0.2)
    return of_one_trial(
        s.AbsoluteFitRow,
        rng,
        **{"arm": s.ARMS[seed % 2], "true_arm": true_arm, "campaign": campaign, "poses": poses, "name": name},
        readings=poses if campaign == s.ABSOLUTE else 200,
        kept=("joint springs", *kept) if name == s.CHOSEN else (),
        error_mm=1.1 * optimum if name == s.CHOSEN else rng.uniform(0.3, 0.4),
        optimum_mm=optimum if (true_arm, campaign) == ALONE else None,
        geometry=Held(30, 28 if seed % 3 else 30),
        joint_errors=None if true_arm == s.NO_GEARS else Held(360, 342),
        **{"positions": Held(100, 95), "joints": Held(6, 3), "entries": Held(100, 80)},
        compliance_off=tuple(rng.normal(0, 0.2, 6)),
    )


def made(kept=(), numbers=NUMBERS):
    """Three seeds an arm."""
    rng, own = np.random.default_rng(1), [key for key in OWN if key[2] != 50 or 50 in numbers]
    trials = table_of(SEEDS, lambda seed: [row(rng, seed, key, kept) for key in own])
    return STUDY.report(s.AbsoluteSettings(s.ARMS, numbers, 0, 200, SEEDS[0]), SEEDS, trials), trials


def test_every_row_is_of_its_own_trials_and_shares_are_over_all_numbers():
    found, trials = made()
    check(found, ["short"])
    assert (found.badge.n, found.badge.each) == (6, f"trial of {s.ARMS[0]} and {s.ARMS[1]}")
    f = found.numbers
    assert len(f["models"]) == len(s.ARMS) * len(OWN)
    for own in f["models"]:
        mine = trials.where(**{name: own[name] for name in BY})
        check_spread(own.error_mm, mine["error_mm"])
        check_spread(own.loaded_mm, mine["loaded_mm"])
        over = mine["error_mm"] / mine["optimum_mm"]
        known = np.sqrt(np.mean(over**2)) if (own.true_arm, own.campaign) == ALONE else None
        assert own.over_optimum == (known and pytest.approx(known))
        assert own.inside.geometry_percent == pytest.approx(100 * (28 + 30 + 28) / 90)
        assert (own.inside.positions_percent, own.inside.entries_percent) == (95, 80)
        off = 100 * np.array([*mine["compliance_off"]])[:, 1:3]
        assert (own.bias_2_percent, own.bias_3_percent) == pytest.approx(np.median(off, axis=0))
        assert (own.off_2_percent, own.off_3_percent) == pytest.approx(np.sqrt((off**2).mean(axis=0)))
    assert find(f["models"], true_arm=s.NO_GEARS).inside.joint_errors_percent is None


@pytest.mark.parametrize(("kept", "share"), [((), 0), (("joint errors",), 100)])
def test_joint_errors_that_are_kept_without_any_are_counted(kept, share):
    own = find(made(kept)[0].numbers["models"], true_arm=s.NO_GEARS, name=s.CHOSEN)
    assert (own.gears_kept_percent, own.links_kept_percent) == (share, 0)


@pytest.mark.parametrize("numbers", [NUMBERS, (200,)])
def test_the_figure_draws_the_numbers_in_the_colour_of_each_model(numbers):
    """Errors by the number of poses; of one number a row a model."""
    found, _ = made(numbers=numbers)
    models = found.numbers["models"]
    assert STUDY.figures(read_back(found)).keys() == {"absolute_calibration.png"}
    for axes, arm in zip(STUDY.figures(found)["absolute_calibration.png"].axes, s.ARMS, strict=True):
        if len(numbers) == 1:
            errors = [find(models, arm=arm, name=name).error_mm for name in s.BY_POSES]
            first = place_of(found, s.BY_POSES)
            check_forest(axes, errors, [LOOKS[name] for name in s.BY_POSES], first=first)
            continue
        shades = {line.get_label(): line.get_color() for line in axes.get_lines()}
        for name in (s.INCUMBENT, s.ALL, s.CHOSEN, OPTIMUM):
            model, key = (s.ALL, "optimum_mm") if name == OPTIMUM else (name, "error_mm")
            rows = [find(models, arm=arm, poses=n, name=model) for n in numbers]
            assert curves(axes)[row_words(name)][1] == pytest.approx([own[key].median for own in rows])
            assert shades[row_words(name)] == LOOKS[name].hex
    assert (LOOKS[s.ALL].colour, LOOKS[s.ALL_LS].colour) == (GCO, LEAST_SQUARES)
