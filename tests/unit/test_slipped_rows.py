"""Mistakes of tables: rows that slipped, columns that were exchanged, a zero that geometry hides."""

import re
from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.absolute import calibrated, explained
from testbench.campaign.absolute_truth import AbsoluteCampaign, simulate_series
from testbench.campaign.doubt import said
from testbench.commands.calibrate import report
from testbench.commands.calibrate_numbers import left_of
from testbench.data.series import select_rows
from testbench.errors import BenchError
from testbench.identify.absolute.fit import Options
from testbench.identify.diagnosis.notation import check_order, unplaced
from testbench.identify.diagnosis.place import Free, Seen
from testbench.identify.diagnosis.undone import PRECISE, placed
from testbench.model.vjm import marker_points, tool_points

ONLY = Options(only=frozenset({"joint springs"}), orders=5)
ROWS = 100


@pytest.fixture(scope="module")
def series(ur10):
    """Readings of a true arm with typical errors; rows are numbered as in a file with a header."""
    (one,) = simulate_series(ur10, AbsoluteCampaign(poses=ROWS, orientations=True), 3)[0]
    return replace(one, row=np.arange(ROWS) + 2)


def positions(one):
    return replace(one, rotation=None, sigma_rotation=None)


def late(one, k, shift):
    """The joint angles of row k deleted and those below moved up, or one inserted: the last one is lost."""
    other = np.roll(one.q, shift, axis=0)
    q = np.where(np.arange(one.rows)[:, None] < k, one.q, other)
    return select_rows(replace(one, q=q), np.arange(one.rows - 1))


@pytest.mark.parametrize(
    ("turned", "k", "shift"),
    [(True, 15, -1), (True, 80, 1), (False, 15, 1), (False, 50, -1)],
)
def test_rows_that_slipped_are_named_with_the_first_one(ur10, series, turned, k, shift):
    one = late(series if turned else positions(series), k, shift)
    words = "pose before" if shift < 0 else "pose after"
    expected = (
        rf"rows from {k + 2} on do not fit .*; the readings are those of the {words} from row {k + 2} on"
    )
    with pytest.raises(BenchError, match=expected), explained(ur10.vjm):
        calibrated(ur10.vjm, [one], ONLY)


def test_nothing_slipped_in_sound_rows_nor_where_a_tracker_moved_or_poses_repeat(ur10, series):
    """Nor where rows at the end are wild, nor is half of the truth said where a tracker moved too."""
    number = np.arange(ROWS)[:, None, None]
    moved, wild = 0.05 * (number >= 50), 0.3 * (number >= ROWS - 8)
    again = replace(select_rows(series, np.repeat(np.arange(ROWS), 3)), row=np.arange(3 * ROWS) + 2)
    slipped = late(positions(series), 50, -1)
    for one in (
        series,
        positions(series),
        again,
        replace(positions(series), position=series.position + moved),
        replace(series, position=series.position + wild),
        replace(slipped, position=slipped.position + moved[: slipped.rows]),
    ):
        check_order(ur10.vjm, [one])


@pytest.mark.parametrize(
    ("rows", "k", "shift", "words"),
    [(60, 40, -1, "before"), (11, 5, 1, "after"), (11, 8, -1, "before"), (40, 3, 1, "after")],
)
def test_runs_that_slipped_are_named_in_pairs_too(kr500, rows, k, shift, words):
    """Three rows before or behind are enough."""
    q = np.random.default_rng(4).uniform(*kr500.arm.limits, (rows, 6))
    markers = marker_points(kr500.vjm, kr500.arm.markers)
    x = tool_points(kr500.vjm, q, markers)
    seen = Seen(
        vjm=kr500.vjm,
        q=np.where(np.arange(rows)[:, None] < k, q, np.roll(q, shift, axis=0)),
        markers=markers,
        read=x,
        there=np.ones(x.shape[:2], dtype=bool),
        names=kr500.arm.markers,
        runs=np.arange(rows) + 101,
        poses=np.arange(rows),
        scale=PRECISE * kr500.vjm.reach,
    )
    for free in (Free(), Free(frame=True, targets=True)):
        found, _ = placed(seen, free)
        assert found.where == ("unloaded", f"{101 + k}")
        assert said(found, kr500.arm).sentence.startswith(
            f"the unloaded readings are those of the pose {words} from run {101 + k} on"
        )


@pytest.mark.parametrize(
    ("order", "sign", "words"),
    [
        ([1, 0, 2], 1, "x and y of the positions are exchanged"),
        ([0, 2, 1], 1, "y and z of the positions are exchanged"),
        ([2, 1, 0], 1, "x and z of the positions are exchanged"),
        ([0, 1, 2], [1, -1, 1], "y of the positions has the other sign"),
    ],
)
def test_exchanged_axes_of_positions_are_named(ur10, series, order, sign, words):
    one = replace(series, position=series.position[..., order] * sign)
    with pytest.raises(BenchError, match=f"the readings fit if {words}"), explained(ur10.vjm):
        calibrated(ur10.vjm, [one], ONLY)
    found = said(unplaced(ur10.vjm, positions(one)), ur10.arm).sentence
    assert "left-handed frame: the sign of an axis, or two axes exchanged?" in found


def test_a_zero_that_geometry_hides_is_a_doubt_with_its_joint_and_size(ur10, series):
    """A turn of the link before it does the same, so that the readings fit."""
    one = replace(series, q=series.q + np.radians(5) * np.eye(6)[4])
    found = calibrated(ur10.vjm, [one], ONLY)
    numbers = report(found, left_of(found)).numbers
    assert numbers.total_after.mean_mm < 0.3
    (doubt,) = [text for text in numbers.doubts if text.startswith("Geometry no arm has: ")]
    size = re.search(r"the zero of wrist_2_joint is off by (\S+) deg", doubt)
    assert float(size[1]) == pytest.approx(-5, abs=0.3)  # the arm's own errors are tenths of a degree there


def test_sound_geometry_is_no_doubt(ur10, series):
    found = calibrated(ur10.vjm, [series], ONLY)
    assert report(found, left_of(found)).numbers.far_geometry == ""
