"""What a judged arm's line says of other scales of intervals and of other thresholds of links."""

import judge_arms as judge
import numpy as np
import pytest

from testbench.plant.true_arms import FAMILY_NAME
from testbench.studies.campaign.trial import covers
from testbench.workflows.campaign import Scenario, draw_poses
from testbench.workflows.models import ALL_UNKNOWNS, named_models, with_priors, wrong_prior


def test_coverage_at_every_scale_is_that_of_intervals_scaled_one_by_one(rng):
    true, half = rng.standard_normal((5, 3, 3)), rng.uniform(0.1, 3, (5, 3, 3))
    centre = true + rng.standard_normal((5, 3, 3))
    found = judge.covered_at(centre, half, true)
    assert found == [covers(centre, own * half, true).covered_percent for own in judge.SCALES]
    assert judge.SCALES[8] == 1
    assert found[0] < found[8] < found[16]


def test_scales_meet_the_bars_where_the_mean_and_the_worst_tenth_do():
    """Ten arms a kind: the worst tenth is the worst arm."""
    share = np.linspace(91, 99, 17)  # from 92 to 97 at the scales from 0.7 to 1.2
    alike = [{"covered_at": share}] * 10
    one_worse = [{"covered_at": share + 1}] * 9 + [{"covered_at": share - 14}]  # mean share - 0.5, worst - 14
    low = [{"covered_at": share - 10}] * 10

    def extents(own):
        return [row[-1] for row in judge.scaled(own)]

    found = extents({FAMILY_NAME: alike, "cast": one_worse})
    assert found == ["0.70 to 1.20", "0.90 to 1.25", "0.90 to 1.20"]
    assert extents({FAMILY_NAME: alike, "cast": low}) == ["0.70 to 1.20", "none", "none"]


def test_every_row_of_every_table_has_a_cell_under_each_heading():
    """Of ten arms of a stiff kind and of another one, the first of which loses unless links are surer."""
    same = dict.fromkeys(("joints", "squares", "gco", "ridge", "failed", "unsure"), 1.0)
    same |= {"half": 1.0, "ideal": 1.0, "covered": 95.0, "covered_at": [95.0] * 17, "changes": False}
    rows = [
        {"kind": kind, "passed": 2.0 - (seed > 0), "gain": [0.2, 0.1], "evidence": 1.0, **same}
        for kind in ("family", "stiffer_10")
        for seed in range(10)
    ]
    rows = [{**row, "default": row["passed"]} for row in rows]
    for heads, *body in judge.tables(rows).values():
        assert {len(own) for own in body} == {len(heads)}
    lost = {
        cells[0]: cells[1:3] for cells in (judge.threshold(_by_kind(rows), own) for own in judge.THRESHOLDS)
    }
    assert lost["1.9 (default)"] == ["1 of 10", "1 of 10"]
    assert lost["3.0"] == ["0 of 10", "0 of 10"]


def _by_kind(rows):
    return {kind: [row for row in rows if row["kind"] == kind] for kind in ("family", "stiffer_10")}


@pytest.mark.parametrize("kind", ["stiffer_10", "following_50"])
def test_at_the_default_s_threshold_a_line_holds_the_default_s_error(kr500, kind):
    """Of an arm whose links the poses left out judge, and of one whose links change."""
    seed = 780001
    poses = draw_poses(kr500, Scenario(arm=kr500.arm.name, workspace_poses=5), seed)
    readings, truth = judge.measured(kr500, poses, kind, seed)
    [default] = with_priors(kr500.arm, named_models(kr500, (ALL_UNKNOWNS,)), wrong_prior(kr500, seed))
    row = judge.of_default(kr500, default, readings, truth)
    assert judge.decided(row, judge.SURE) == pytest.approx(row["default"], rel=1e-9)
    assert judge.decided(row, -np.inf) == row["passed"]
    assert judge.decided(row, np.inf) == row["unsure" if row["changes"] else "failed"]
    assert len({row["passed"], row["failed"]}) == 2
    assert row["covered_at"][8] == row["covered"]


def test_every_table_is_a_csv_file_of_its_own(tmp_path):
    judge.write({"default": [["a", "b"], ["1", "2"]], "scales": [["c"], ["3, 4"]]}, tmp_path)
    assert {own.name: own.read_text() for own in tmp_path.iterdir()} == {
        "default.csv": "a,b\n1,2\n",
        "scales.csv": 'c\n"3, 4"\n',
    }
