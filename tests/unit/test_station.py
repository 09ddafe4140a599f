"""What a tracker sees from where it stands: distance, elevation, incidence; every limit from both sides."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.campaign.tracker import FACES_AWAY, TOO_FAR, TOO_NEAR, TOO_STEEP, Station, out_of_view
from testbench.errors import Array, BenchError

HERE = (4.5, -2.5, 1.6)


def at(distance: float, elevation_deg: float, azimuth_deg: float = 130.0) -> Array:
    """A target as seen from the station, (1, 1, 3) [m]: a turn about z of a turn about y."""
    seen = Rotation.from_euler("ZY", [azimuth_deg, -elevation_deg], degrees=True).apply([distance, 0, 0])
    return np.asarray((np.array(HERE) + seen)[None, None])


def reasons(station: Station, targets: Array, facing: Array | None = None) -> list[str]:
    return [reason for reason, mask in out_of_view(station, targets, facing).items() if mask.any()]


@pytest.mark.parametrize(
    ("distance", "expected"),
    [(0.99, [TOO_NEAR]), (1.01, []), (19.99, []), (20.01, [TOO_FAR])],
)
def test_targets_are_seen_between_nearest_and_farthest(distance: float, expected: list[str]) -> None:
    assert reasons(Station(HERE), at(distance, 10.0)) == expected


@pytest.mark.parametrize("azimuth", [0.0, 200.0])
@pytest.mark.parametrize(
    ("elevation", "expected"),
    [(-51.0, [TOO_STEEP]), (-49.0, []), (74.0, []), (76.0, [TOO_STEEP])],
)
def test_targets_are_seen_between_lowest_and_highest(
    elevation: float, azimuth: float, expected: list[str]
) -> None:
    assert reasons(Station(HERE), at(3.0, elevation, azimuth)) == expected


def test_a_target_at_the_station_is_too_near_and_nothing_else() -> None:
    station = Station(HERE, acceptance=0.5)
    up = np.array([[[0.0, 0, 1]]])
    assert reasons(station, np.array([[HERE]]), up) == [TOO_NEAR]


@pytest.mark.parametrize(("turned", "expected"), [(29.0, []), (31.0, [FACES_AWAY]), (180.0, [FACES_AWAY])])
def test_a_fixed_target_returns_the_beam_within_its_acceptance(turned: float, expected: list[str]) -> None:
    rng = np.random.default_rng(1)
    station = Station(HERE, acceptance=math.radians(30))
    target = at(3.0, 20.0)
    to_tracker = (np.array(HERE) - target[0, 0]) / 3.0
    for direction in rng.standard_normal((10, 3)):  # turned about any axis at right angles
        axis = np.cross(to_tracker, direction)
        turn = Rotation.from_rotvec(np.radians(turned) * axis / np.linalg.norm(axis))
        assert reasons(station, target, turn.apply(to_tracker)[None, None]) == expected


def test_a_target_turned_by_hand_is_seen_wherever_it_faces() -> None:
    away = at(3.0, 0.0)[0, 0] - HERE
    assert reasons(Station(HERE), at(3.0, 0.0), (away / 3)[None, None]) == []


def test_one_target_out_of_view_refuses_its_pose_and_no_other() -> None:
    good, far, near = at(3.0, 0.0)[0, 0], at(30.0, 0.0)[0, 0], at(0.5, 0.0)[0, 0]
    refused = out_of_view(Station(HERE), np.array([[good, good], [good, far], [near, good], [far, near]]))
    assert list(refused) == [TOO_NEAR, TOO_FAR, TOO_STEEP]
    np.testing.assert_array_equal(refused[TOO_NEAR], [False, False, True, True])
    np.testing.assert_array_equal(refused[TOO_FAR], [False, True, False, True])
    assert not refused[TOO_STEEP].any()


def test_no_poses_are_no_error() -> None:
    assert all(mask.shape == (0,) for mask in out_of_view(Station(HERE), np.empty((0, 3, 3))).values())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"position": (0.0, np.nan, 0.0)}, r"position of the station \[m\]: expected finite numbers"),
        ({"position": (4500.0, -2500.0, 1600.0)}, r"expected coordinates up to 1000, got \[4500.0"),
        ({"acceptance": 30.0}, r"acceptance \[rad\].* <= 1.571, got 0.0 to 30.0"),
    ],
)
def test_a_station_that_makes_no_sense_is_refused_in_one_line(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(BenchError, match=message) as err:
        Station(**{"position": HERE, **wrong})
    assert "\n" not in str(err.value)
