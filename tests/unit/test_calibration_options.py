"""Rows that a calibration does without on its way."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.absolute_truth import AbsoluteCampaign, simulate_series
from testbench.identify.absolute.fit import LEAST_OF_ONE, ON_THE_WAY, thinned


@pytest.fixture(scope="module")
def series(kr500):
    return simulate_series(kr500, AbsoluteCampaign(poses=30, masses=(0.0, 230.0)), seed=5)[0]


def longer(one, times, name):
    """The same readings again and again, two a pose."""
    tiled = {x: np.concatenate([getattr(one, x)] * times) for x in ("q", "wrench", "point", "position")}
    row = np.arange(times * one.rows)
    return replace(one, name=name, row=row, pose=row // 2, **tiled)


def test_steps_on_the_way_take_few_rows_all_of_a_pose_and_enough_of_every_series(series):
    [one] = series
    many, huge = longer(one, 40, "many"), longer(one, 200, "huge")
    few, short = thinned((many, one))
    assert short is one
    assert ON_THE_WAY / 2 < few.rows <= ON_THE_WAY or few.rows == many.rows
    _, count = np.unique(few.pose, return_counts=True)
    assert (count == 2).all()
    few, short = thinned((huge, many))
    assert LEAST_OF_ONE <= short.rows < many.rows
    assert few.rows + short.rows <= 1.05 * ON_THE_WAY
    assert set(np.unique(few.pose)) < set(huge.pose)
