"""What is said and drawn of a real arm is what its ladder and draws hold, of ones that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, check_spread, curves, tables_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.studies.real_ur10.figure import LOOKS
from testbench.studies.real_ur10.ladder import CHOSEN, GEOMETRY, JOINTS, LADDER, LINKS_PRIOR, TWO, WAVES
from testbench.studies.real_ur10.report import PANES, figures, report
from testbench.studies.real_ur10.trial import Error, LadderRow, Settings, SubsetRow
from testbench.views import colours
from testbench.views.markdown import as_markdown, grid
from testbench.views.schema import show

SEEDS, ORDERS, POSES = range(3, 6), 4, (50, 100)
JUDGED = {"blocks": "AC", "blocks, realigned": "AC", "A to C": "C", "C to A": "A", "both": ""}
SIZES = {GEOMETRY.name: 8.0, JOINTS.name: 6.0, WAVES.name: 2.0}
"""Mean error in blocks [mm]; from one series to the other joint errors are the worst."""


def ladder():
    """Every model on every split."""
    rng = np.random.default_rng(7)
    for model in LADDER:
        for split, series in JUDGED.items():
            own = {"waves": tuple(rng.normal(size=12 * ORDERS)), "joints": tuple(rng.uniform(1, 9, 6) * 1e-6)}
            row = of_one_trial(
                LadderRow,
                rng,
                name=model.name,
                split=split,
                judged=None,
                error=None,
                **own,
                conservative=True,
            )
            yield replace(row, kept=("joint springs",), declined=("links", "play"))
            for k, judged in enumerate(series):
                mm = SIZES.get(model.name, 5.0) if split.startswith("blocks") else 3.0 + (model is WAVES)
                error = of_one_trial(Error, rng, n=100 * (k + 1), mean_mm=mm * (1 + k))
                yield replace(row, judged=judged, error=error)


def made():
    """Three draws of two numbers of poses."""

    def rows(seed):
        rng = np.random.default_rng(seed)
        cases = [(poses, model.name, judged) for poses in POSES for model in TWO for judged in "CA"]
        return [SubsetRow(*case, of_one_trial(Error, rng)) for case in cases]

    names = tuple(model.name for model in LADDER)
    asked = Settings(100, ORDERS, names, tuple(JUDGED), 3, dict.fromkeys(POSES, 3), tuple(ladder()))
    trials = table_of(SEEDS, rows)
    return report(asked, SEEDS, trials), trials


def test_the_words_and_tables_of_a_real_arm_are_those_of_its_ladder():
    found, trials = made()
    check(found, ["short"])
    f = found.numbers
    means = {row.name: row for row in f["means"]}
    for name, mm in SIZES.items():
        assert means[name].blocks_mm == pytest.approx((100 * mm + 200 * 2 * mm) / 300)  # by their numbers
    assert "mean: 3.333 mm with periodic joint errors, 10.000 mm with joint springs; 3.0 times less" in (
        found.answer
    )
    assert found.answer.endswith("Geometry alone leaves 13.333 mm, 4.0 times as much.")
    assert "joint errors 4.000 and 4.000 mm, joint springs 3.000 and 3.000 mm" in found.worst
    most = max(r.error.max_mm for r in f["ladder"] if (r.name, r.split) == (WAVES.name, "blocks"))
    assert f"Single position: {most:.3f} mm" in found.worst
    text = "\n".join(found.claims)
    assert "Joint errors over joint springs: 67 % less in blocks, 33 % more from A to C, 33 % more" in text
    assert "Joint springs over geometry alone: 25 % less in blocks" in text
    size = means[LINKS_PRIOR.name].blocks_mm / means[JOINTS.name].blocks_mm
    assert f"learnt prior over joint springs: {100 * (1 - size):.0f} % less in blocks" in text
    assert "keeps joint springs and declines links and play, trained on half of the blocks" in text
    chosen = next(row for row in f["models"] if row.name == CHOSEN.name)
    assert (chosen.conservative, chosen.paper) == (True, None)
    elbow = {(one.name, one.trained): one.urad_per_Nm[2] for one in f["compliances"]}
    for name, words in ((JOINTS.name, "biased: "), (WAVES.name, "with them ")):
        assert f"{words}{elbow[name, 'A']:.1f} and {elbow[name, 'C']:.1f}" in text
    assert f"| {elbow[JOINTS.name, 'A']:.2f} | {elbow[JOINTS.name, 'C']:.2f} | " in grid(
        found.tables["compliances"]
    )
    for row in f["by_number"]:
        own = trials.where(name=row.name, judged=row.judged, poses=row.poses)
        check_spread(row.error.mean_mm, own["error.mean_mm"])
        assert row.draws == 3
    [(head, cells)] = tables_of(grid(found.tables["ladder"]))
    for row, line in zip(f["ladder"], cells, strict=True):
        shown = dict(zip(head, line, strict=True))
        known = [*map(as_markdown, (row.name, row.split, row.judged))]
        assert [shown[title] for title in ("model", "split", "judged on")] == known
        sizes = ("mean error", "mean"), ("RMS", "rms"), ("95 %", "p95"), ("99 %", "p99"), ("largest", "max")
        for title, key in sizes:
            assert shown[f"{title}, mm"] == show(row.error[f"{key}_mm"])
        assert shown["inside 95 %, %"] == show(row.error.inside_95_percent, ".1f")
    here = {(row.name, row.trained, row.judged): row.here_mm for row in f["known"]}
    own = trials.where(name=WAVES.name, judged="C", poses=50)["error.mean_mm"]
    check_spread(here[WAVES.name, "50 poses of C", "C"], own)
    assert here[WAVES.name, "200 poses of C", "C"] is None


def test_the_figures_draw_the_ladder_the_draws_and_the_joints_in_the_units_of_their_axes():
    found, _ = made()
    drawn, f = figures(found), found.numbers
    for axes, key in zip(drawn["real_ur10.png"].axes, PANES, strict=True):
        assert unit_in(axes.get_xlabel()) == "mm"
        for y, row in enumerate(f["means"]):
            dot = next(line for line in axes.get_lines() if np.ravel(line.get_ydata()).tolist() == [y])
            assert np.ravel(dot.get_xdata())[0] == at(row, key)
            assert dot.get_color() == LOOKS[row.name].hex
    assert LOOKS[JOINTS.name].colour == colours.JOINTS
    assert LOOKS[WAVES.name].colour == colours.JOINTS_PRIOR
    [axes] = drawn["number_of_poses.png"].axes
    for (name, judged), rows in {
        (model.name, judged): [r for r in f["by_number"] if (r.name, r.judged) == (model.name, judged)]
        for model in TWO
        for judged in "CA"
    }.items():
        x, y = curves(axes)[f"{name}, judged on {judged}"]
        assert list(zip(x, y, strict=True)) == [(r.poses, r.error.mean_mm.median) for r in rows]
    for name, what in (("joint_errors.png", "curve"), ("spectra.png", "amplitude")):
        for axes, joint in zip(drawn[name].axes, f["joints"], strict=True):
            for by in "AC":
                label = f"by {by}" + " alone" * (what == "amplitude")
                shown = curves(axes)[label][1]
                np.testing.assert_array_equal(shown, np.array(joint[f"{what}_{by}_urad"], dtype=float))
