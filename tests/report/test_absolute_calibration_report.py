"""What is said and drawn of absolute calibrations is what their trials hold, of trials that are made up."""

import itertools

import numpy as np
import pytest
from checks import check_spread, curves, tables_of
from made_up import fill
from reports import check, table_of

from testbench.report.table import find
from testbench.studies.absolute_calibration.figure import HATCHES, HIDDEN, LOOKS
from testbench.studies.absolute_calibration.report import figures, report
from testbench.studies.absolute_calibration.settings import (
    ABSOLUTE,
    ALL,
    ARMS,
    BY_POSES,
    CAMPAIGN,
    CAMPAIGNS,
    CHOSEN,
    HIDING,
    INCUMBENT,
    JOINTS_ONLY,
    NO_GEARS,
    REAL,
    TRUE_ARMS,
    WITH_LINKS,
    Settings,
)
from testbench.studies.absolute_calibration.trial import FitRow, Held
from testbench.views.colours import GCO, LEAST_SQUARES, hexadecimal
from testbench.views.markdown import grid
from testbench.views.schema import show

SEEDS, NUMBERS = range(300, 306), (50, 200)
OWN = [(REAL, ABSOLUTE, n, name) for n in NUMBERS for name in BY_POSES]
OWN += [(REAL, ABSOLUTE, 200, WITH_LINKS)]
OWN += [(true, ABSOLUTE, 200, name) for true in [*TRUE_ARMS][1:] for name in HIDING]
OWN += [(REAL, campaign, 100, name) for campaign in [*CAMPAIGNS][1:] for name in CAMPAIGN]


def row(rng, seed, key, kept):
    true_arm, campaign, poses, name = key
    optimum = rng.uniform(0.1, 0.2)
    return fill(
        FitRow,
        rng,
        **{"arm": ARMS[seed % 2], "true_arm": true_arm, "campaign": campaign, "poses": poses, "name": name},
        readings=poses if campaign == ABSOLUTE else 200,
        kept=("joint springs", *kept) if name == CHOSEN else (),
        error_mm=1.1 * optimum if name == CHOSEN else rng.uniform(0.3, 0.4),
        optimum_mm=optimum if (true_arm, campaign) == (REAL, ABSOLUTE) else None,
        geometry=Held(30, 28 if seed % 3 else 30),
        joint_errors=None if true_arm == NO_GEARS else Held(360, 342),
        **{"positions": Held(100, 95), "joints": Held(6, 3), "entries": Held(100, 80)},
        compliance_off=tuple(rng.normal(0, 0.2, 6)),
    )


def made(kept=()):
    """Three seeds an arm."""
    rng = np.random.default_rng(1)
    trials = table_of(SEEDS, lambda seed: [row(rng, seed, key, kept) for key in OWN])
    return report(Settings(ARMS, NUMBERS, 0, 200), SEEDS, trials), trials


def test_shares_are_over_all_numbers_and_errors_over_the_optimum_of_their_own_trial():
    found, trials = made()
    check(found, ["short"])
    f = found.numbers
    assert [(r.arm, r.poses, r.name) for r in f["models"]] == [*itertools.product(ARMS, NUMBERS, BY_POSES)]
    for own in f["models"]:
        mine = trials.where(arm=own.arm, poses=own.poses, name=own.name, true_arm=REAL, campaign=ABSOLUTE)
        check_spread(own.error_mm, mine["error_mm"])
        assert own.over_optimum == pytest.approx(
            np.sqrt(np.mean((mine["error_mm"] / mine["optimum_mm"]) ** 2))
        )
        assert own.inside.geometry_percent == pytest.approx(100 * (28 + 30 + 28) / 90)
        assert (own.inside.positions_percent, own.inside.entries_percent) == (95, 80)
    assert find(f["hiding"], true_arm=NO_GEARS).inside.joint_errors_percent is None
    for gain in f["gains"]:
        ours, springs = (find(f["models"], arm=gain.arm, poses=200, name=n) for n in (CHOSEN, INCUMBENT))
        said = [f"{own.error_mm.median:.3f} mm" for own in (ours, springs)]
        start = (
            f"On {gain.arm}, 200 poses: the model chosen by cross-validation errs {said[0]}, joint springs"
        )
        assert f"{start} {said[1]}, " in found.answer
        loaded = [f"{own.loaded_mm.median:.3f} mm" for own in (ours, springs)]
        assert f"{gain.arm} {loaded[0]}, joint springs {loaded[1]}" in found.worst
    assert "1.10 times on ur10; 1.10 times on kr500_l480." in found.claims[1]


def test_what_hides_is_the_compliance_of_joints_two_and_three():
    found, trials = made()
    f = found.numbers
    off = np.array([*trials.where(arm="ur10", true_arm=JOINTS_ONLY, name=INCUMBENT)["compliance_off"]])
    own = find(f["hiding"], arm="ur10", true_arm=JOINTS_ONLY, name=INCUMBENT)
    assert (own.bias_2_percent, own.bias_3_percent) == pytest.approx(100 * np.median(off[:, 1:3], axis=0))
    rms = 100 * np.sqrt((off[:, 1:3] ** 2).mean(axis=0))
    assert (own.off_2_percent, own.off_3_percent) == pytest.approx(rms)
    assert f"joint 2's compliance is {rms[0]:.0f} % off on ur10; " in found.claims[3]
    alone, mixed = (
        find(f["campaigns"], arm="ur10", campaign=one, name=ALL).loaded_mm.median
        for one in ("absolute alone", "mixed")
    )
    assert f"mixed with loaded pairs: {alone:.3f} and {mixed:.3f} mm (ur10); " in found.claims[4]
    unseen = find(f["hiding"], arm="ur10", true_arm=NO_GEARS, name=INCUMBENT)
    assert f"joint 2's compliance is {unseen.bias_2_percent:+.0f} % off on ur10; " in found.claims[6]
    geometry = find(f["models"], arm="kr500_l480", poses=200, name="geometry alone")
    assert found.claims[0].endswith(f"; {geometry.error_mm.median:.3f} mm on kr500_l480.")
    [(head, lines)] = tables_of(grid(found.tables["campaigns"]))
    assert head[5:] == ["error, own weight, mm", "error, payload, mm", "c2 off, RMS, %", "c3 off, RMS, %"]
    shown = {tuple(line[:5]): line[5:] for line in lines}
    [(head, lines)] = tables_of(grid(found.tables["hiding"]))
    for line, one in zip(lines, f["hiding"], strict=True):
        cells = dict(zip(head, line, strict=True))
        assert cells["model"] == one.name
        assert cells["c2 off, median, %"] == show(one.bias_2_percent, ".1f")
        assert cells["c3 off, RMS, %"] == show(one.off_3_percent, ".1f")
        assert cells["geometry off, mm, mrad"] == show(one.geometry_off)
        assert cells["joint compliances inside, %"] == show(one.inside.joints_percent, ".1f")
        assert cells["joint errors kept, %"] == show(one.gears_kept_percent, ".1f")
    for one in f["campaigns"]:
        mine = trials.where(true_arm=REAL, arm=one.arm, campaign=one.campaign, name=one.name, readings=200)
        check_spread(one.loaded_mm, mine["loaded_mm"])
        shares = (one.off_2_percent, one.off_3_percent)
        cells = [show(one.error_mm), show(one.loaded_mm), *(show(share, ".1f") for share in shares)]
        assert shown[one.campaign, one.arm, str(one.poses), "200", one.name] == cells


def test_joint_errors_that_are_kept_without_any_are_counted():
    for kept, share in ((), 0), (("joint errors",), 100):
        found, _ = made(kept)
        own = find(found.numbers["hiding"], true_arm=NO_GEARS, name=CHOSEN)
        assert (own.gears_kept_percent, own.links_kept_percent) == (share, 0)
        assert f"keeps them in {share} % of the trials (ur10)" in found.claims[5]


def test_the_figure_draws_the_numbers_in_the_colour_of_each_model():
    found, _ = made()
    f = found.numbers
    panes = figures(found)["absolute_calibration.png"].axes
    assert (LOOKS[ALL].colour, LOOKS["all, least squares"].colour) == (GCO, LEAST_SQUARES)
    lines = curves(panes[0])
    for name in BY_POSES:
        rows = [find(f["models"], arm="ur10", poses=n, name=name) for n in NUMBERS]
        assert lines[name][1] == pytest.approx([own.error_mm.median for own in rows])
        [line] = [line for line in panes[0].get_lines() if line.get_label() == name]
        assert line.get_color() == LOOKS[name].hex
    rows = [find(f["hiding"], arm="ur10", true_arm=true, name=name) for name in HATCHES for true in HIDDEN]
    assert [bar.get_height() for bar in panes[2].patches] == pytest.approx([r.off_2_percent for r in rows])
    dashes = np.concatenate([line.get_ydata() for line in panes[2].get_lines()[:-1]])
    assert dashes == pytest.approx([own.bias_2_percent for own in rows])
    rows = [own for own in f["campaigns"] if (own.arm, own.name) == (ARMS[1], ALL)]
    heights = [[own.error_mm.median for own in rows], [own.loaded_mm.median for own in rows]]
    assert [bar.get_height() for bar in panes[5].patches] == pytest.approx(np.ravel(heights))
    assert panes[5].patches[0].get_facecolor()[:3] == pytest.approx(
        [int(hexadecimal(GCO)[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    )
