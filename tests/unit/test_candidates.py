"""Candidate poses satisfy what was asked, judged by other code; what a tracker sees from where it stands."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.errors import Array, BenchError, PoseError
from testbench.model.vjm import WorkArea
from testbench.plant.rigid_cell import Payload, find_contacts, find_hidden_markers
from testbench.plant.shapes import rigid_frames
from testbench.plant.tracker import FACES_AWAY, TOO_FAR, TOO_NEAR, TOO_STEEP, Station, find_out_of_view
from testbench.workflows.plan_input import (
    ADVICE,
    BLOCKED,
    OFF_AREA,
    OFF_LIMITS,
    POSES_PER_BATCH,
    REASONS,
    TOUCHING,
    Candidates,
    Checks,
    PoseConditions,
    build_checks,
    find_feasible_poses,
    refusal_reasons,
)

HERE = (4.5, -2.5, 1.6)
FRONT = WorkArea((1.0, -1.5, 1.0), (3.0, 1.5, 2.6))
ALL = PoseConditions(FRONT, Station(HERE, acceptance_angle=math.radians(80)), Payload(460.3))


@pytest.fixture(scope="module")
def checks(kr500) -> Checks:
    return build_checks(kr500, ALL)


@pytest.fixture(scope="module")
def found(checks) -> Candidates:
    return find_feasible_poses(checks, 40, np.random.default_rng(3))


def test_every_pose_drawn_is_found_or_counted_once(checks, found):
    """The draws themselves, judged in other batches, up to the last one found."""
    drawn = np.random.default_rng(3).uniform(*checks.vjm.arm.limits, (found.drawn, 6))
    reasons = [reason for q in np.array_split(drawn, 7) for reason in refusal_reasons(checks, q)]
    assert reasons[-1] is None
    np.testing.assert_array_equal(found.q, drawn[[r is None for r in reasons]])
    assert found.rejected == {reason: reasons.count(reason) for reason in REASONS}
    assert list(found.rejected) == list(REASONS)
    assert len(found.q) + sum(found.rejected.values()) == found.drawn


def test_a_pose_is_refused_for_the_first_reason_in_their_order(kr500, checks):
    """Each reason judged by itself, of all poses, by MuJoCo's kinematics."""
    q = np.random.default_rng(5).uniform(*kr500.arm.limits, (400, 6))
    q[:20, 3] = 7.0  # beyond joint 4
    names, frames = kr500.room.body_names, rigid_frames(kr500.room, q)
    at = [names.index(name) for name in kr500.arm.markers]
    tool, markers = (frames.positions[:, own] for own in (names.index(kr500.arm.tool), at))
    facing = frames.rotations[:, at][..., 2]
    back = np.array(HERE) - markers
    distance = np.linalg.norm(back, axis=2)
    elevation = np.degrees(np.arcsin(-back[:, :, 2] / distance))
    touching = [c and TOUCHING[c.category] for c in find_contacts(checks.site, q)]
    single = {
        OFF_LIMITS: np.abs(q[:, 3]) > 6.2,
        OFF_AREA: ((tool < FRONT.lower) | (tool > FRONT.upper)).any(axis=1),
        TOO_NEAR: (distance < 1).any(axis=1),
        TOO_FAR: (distance > 20).any(axis=1),
        TOO_STEEP: ((elevation < -50) | (elevation > 75)).any(axis=1),
        FACES_AWAY: ((facing * back).sum(axis=2) < np.cos(np.radians(80)) * distance).any(axis=1),
        **{reason: np.array([t == reason for t in touching]) for reason in TOUCHING.values()},
        BLOCKED: np.array([h is not None for h in find_hidden_markers(checks.site, q)]),
    }
    assert tuple(single) == REASONS
    expected = [next((r for r, mask in single.items() if mask[i]), None) for i in range(len(q))]
    assert refusal_reasons(checks, q) == expected
    assert len(set(expected)) >= 6


def test_the_error_tells_all_counts_and_both_the_most_frequent_and_the_strictest_reason(kr500, monkeypatch):
    """A weight on a sling of 5 m never hangs clear, wherever the tool is; most poses never come so far."""
    monkeypatch.setattr("testbench.workflows.plan_input.PATIENCE", 1000)
    conditions = PoseConditions(area=FRONT, payload=Payload(460.3, sling_length=5.0))
    with pytest.raises(PoseError) as err:
        find_feasible_poses(build_checks(kr500, conditions), 5, np.random.default_rng(7))
    drawn = np.random.default_rng(7).uniform(*kr500.arm.limits, (1024, 6))
    reasons = refusal_reasons(build_checks(kr500, conditions), drawn)
    counts = {reason: reasons.count(reason) for reason in REASONS if reason in reasons}
    hangs = counts[TOUCHING["payload"]]
    assert counts[OFF_AREA] > hangs
    assert str(err.value) == (
        f"found 0 of 5 poses in 1024 draws; most were refused by '{OFF_AREA}': {ADVICE[OFF_AREA]}; "
        f"'{TOUCHING['payload']}' refused {hangs} of the {hangs} poses tested: "
        f"{ADVICE[TOUCHING['payload']]} (refused: {', '.join(f'{r} {n}' for r, n in counts.items())})"
    )


def test_fewer_than_asked_for_are_an_error_unless_they_are_enough(kr500, monkeypatch):
    """One pose in 2000 has its tool in this box; a search goes on for 1000 draws a pose, so it ends."""
    monkeypatch.setattr("testbench.workflows.plan_input.PATIENCE", 10_000)
    checks = build_checks(kr500, PoseConditions(area=WorkArea((2.4, -0.3, 1.5), (2.8, 0.3, 1.9))))
    few = find_feasible_poses(checks, 10**6, np.random.default_rng(8), least=1)
    n = len(few.q)
    assert 1 <= n < 10**6
    assert 10_000 + 1000 * n <= few.drawn < 10_000 + 1000 * n + POSES_PER_BATCH
    with pytest.raises(PoseError, match=f"found {n} of {n + 9} poses in {few.drawn} draws"):
        find_feasible_poses(checks, n + 9, np.random.default_rng(8), least=n + 1)


def test_poses_of_another_arm_are_refused(checks):
    with pytest.raises(BenchError, match=r"q \[rad, m\]: expected shape \(any, 6\), got \(1, 5\)"):
        refusal_reasons(checks, np.zeros((1, 5)))
    assert refusal_reasons(checks, np.empty((0, 6))) == []


def at(distance: float, elevation_deg: float, azimuth_deg: float = 130.0) -> Array:
    """A target as seen from the station, (1, 1, 3) [m]: a turn about z of a turn about y."""
    seen = Rotation.from_euler("ZY", [azimuth_deg, -elevation_deg], degrees=True).apply([distance, 0, 0])
    return np.asarray((np.array(HERE) + seen)[None, None])


def reasons(station: Station, targets: Array, facing: Array | None = None) -> list[str]:
    return [reason for reason, mask in find_out_of_view(station, targets, facing).items() if mask.any()]


@pytest.mark.parametrize("azimuth", [0.0, 200.0])
@pytest.mark.parametrize(
    ("distance", "elevation", "expected"),
    [
        (0.99, 10.0, [TOO_NEAR]),
        (1.01, 10.0, []),
        (19.99, 10.0, []),
        (20.01, 10.0, [TOO_FAR]),
        (3.0, -51.0, [TOO_STEEP]),
        (3.0, -49.0, []),
        (3.0, 74.0, []),
        (3.0, 76.0, [TOO_STEEP]),
    ],
)
def test_targets_are_seen_between_two_distances_and_elevations_wherever_they_face(
    distance, elevation, azimuth, expected
):
    """A target that is turned by hand looks at the tracker."""
    there = at(distance, elevation, azimuth)
    assert reasons(Station(HERE), there) == expected
    assert reasons(Station(HERE), there, (there - HERE) / distance) == expected


def test_a_target_at_the_station_is_too_near_and_nothing_else():
    station = Station(HERE, acceptance_angle=0.5)
    up = np.array([[[0.0, 0, 1]]])
    assert reasons(station, np.array([[HERE]]), up) == [TOO_NEAR]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"position": (0.0, np.nan, 0.0)}, r"position of the station \[m\]: expected finite numbers"),
        (
            {"position": (4500.0, -2500.0, 1600.0)},
            "got 4500, -2500, 1600: are they in mm",
        ),
        ({"acceptance_angle": 30.0}, r"acceptance_angle \[rad\].* at most 1.571, got 30.0"),
    ],
)
def test_a_station_that_makes_no_sense_is_refused_in_one_line(wrong, message):
    with pytest.raises(BenchError, match=message) as err:
        Station(**{"position": HERE, **wrong})
    assert "\n" not in str(err.value)
