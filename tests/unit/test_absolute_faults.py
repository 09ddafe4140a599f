"""Faults planted in absolute readings of simulated arms: each is found, named and mended where it can be."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from serial_arms import write_arm

from testbench.data.dataset import select_rows
from testbench.errors import BenchError
from testbench.identify.absolute.align import align, align_all, residuals, with_common_targets
from testbench.identify.absolute.fit import (
    CalibrationOptions,
    calibrate,
    check_row_order,
    linearise_readings,
    select_and_solve,
)
from testbench.identify.absolute.state import nominal_state
from testbench.identify.diagnosis.diagnose import explain_unregistered_series
from testbench.identify.diagnosis.hypotheses import describe
from testbench.identify.prior import cad_prior
from testbench.model.load import read_body_masses
from testbench.workflows.absolute import calibrate_with_masses, raise_explanation
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series
from testbench.workflows.calibration_numbers import numbers, outliers, remaining_errors
from testbench.workflows.cell import build_cell

ONLY = CalibrationOptions(used_errors=frozenset({"joint springs"}), max_order=5)
ROWS = 40


def read(cell, seed=1, **asked):
    """One series of a true arm with typical errors, poses and orientations."""
    return simulate_series(cell, AbsoluteCampaign(**{"poses": ROWS, "orientations": True} | asked), seed)[0]


def outliers_of(found):
    """Rows of outliers of a calibration, and the note about them."""
    left = [residuals(found.state, one)[: len(one.markers)].transpose(2, 0, 1) for one in found.series]
    rows, note = outliers(found, left)
    return rows.outliers, note


def gathered(cell, *series):
    """As far as a fit takes the readings in: what it then tries is not asked here."""
    with raise_explanation(cell.vjm):
        return linearise_readings(cell.vjm, series, cad_prior(cell.arm), ONLY)


def moves(found, cell):
    return [describe(move, cell.arm).sentence for move in found.issues]


def position_only(series):
    return replace(series, rotation=None, sigma_rotation=None)


def target_moved(series, k, move, turn=(0, 0, 0)):
    """The mount moved and turned on the tool from place k on, in its own axes."""
    R, behind = series.rotation, np.arange(series.n_rows) >= k
    d, W = np.asarray(move), Rotation.from_rotvec(turn).as_matrix()
    position = series.position + behind[:, None, None] * (R @ d)[:, None]
    return replace(series, position=position, rotation=np.where(behind[:, None, None], R @ W, R))


def tracker_moved(series, k, move, turn=(0, 0, 0)):
    """The tracker moved and turned about its own origin from place k on."""
    behind, W = np.arange(series.n_rows) >= k, Rotation.from_rotvec(turn).as_matrix()
    position = np.where(behind[:, None, None], series.position @ W.T + move, series.position)
    rotation = np.where(behind[:, None, None], W @ series.rotation, series.rotation)
    return replace(series, position=position, rotation=rotation)


@pytest.mark.parametrize("order", ["random", "joint 1 rises", "loaded after a while", "half turned"])
def test_nothing_moves_in_sound_series(ur10, order):
    """Also where poses or loads change along with time, and the model's own errors with them.

    A blank orientation is as good as none: half of them leave the fit between all and none.
    """
    (one,) = read(ur10, masses=(0.0, 5.0) if order == "loaded after a while" else (0.0,))
    time = one.q[:, 0] if order == "joint 1 rises" else np.linalg.norm(one.wrench, axis=1)
    ordered = replace(select_rows(one, np.argsort(time, kind="stable")), row_id=one.row_id)
    if order == "half turned":
        blank = np.arange(one.n_rows)[:, None, None] % 2
        ordered = replace(ordered, rotation=np.where(blank, np.nan, ordered.rotation))
    found = gathered(ur10, ordered)
    assert not found.issues
    assert found.noise.position_model_error < 2e-4


@pytest.mark.study
def test_what_a_pose_leaves_open_is_no_move_however_many_readings_it_has(kr500):
    """Three targets under three loads, 27 numbers a pose, share the errors of its gears; a move is seen."""
    (one,) = read(kr500, poses=24, targets=3, orientations=False, masses=(0.0, 200.0, 460.0))
    assert not gathered(kr500, one).issues
    behind = np.arange(one.n_rows) >= 36
    moved = gathered(kr500, replace(one, position=one.position + behind[:, None, None] * 5e-3))
    (words,) = moves(moved, kr500)
    size = float(re.search(r"the tracker moved by (\S+) mm.* between rows 36 and 37,", words)[1])
    assert size == pytest.approx(5 * 3**0.5, rel=0.05)  # tenths of a millimetre are the arm's own


FAULTS = {
    "target by 1 mm": (9, "target", lambda s, k: target_moved(s, k, (0, 0.6e-3, 0.8e-3))),
    "target by 90 degrees": (20, "target", lambda s, k: target_moved(s, k, (0.05, 0, 0.1), (0, 0, 1.57))),
    "tracker by 1 mrad": (12, "tracker", lambda s, k: tracker_moved(s, k, (0, 0, 0), (0, 6e-4, 8e-4))),
    "tracker by metres": (22, "tracker", lambda s, k: tracker_moved(s, k, (3, 0.4, 0), (0, 0, 0.3))),
}


@pytest.mark.parametrize(
    "fault", [pytest.param(name, marks=[pytest.mark.study] * (name != "target by 1 mm")) for name in FAULTS]
)
def test_what_moved_in_mid_series_is_found_at_its_row_and_parted(ur10, fault):
    """Readings are numbered from 1: the first behind the step has the number k + 1."""
    k, what, plant = FAULTS[fault]
    (one,) = read(ur10)
    moved = plant(one, k)
    moved = position_only(moved) if "mm" in fault else moved
    found = gathered(ur10, moved)
    (words,) = moves(found, ur10)
    assert f"the {what} moved" in words
    assert f"between rows {k} and {k + 1}," in words
    assert [part.n_rows for part in found.series] == [k, ROWS - k]
    assert found.noise.position_model_error < 2e-4  # tenths of what the step would leave


def test_a_mount_that_moved_is_shared_no_more(ur10):
    """With which part another series would share it is not known."""
    one, two = read(ur10, series=2, share_target=True)
    found = gathered(ur10, target_moved(one, 20, (0, 0, 5e-3)), two)
    assert moves(found, ur10)[1] == "series 2: its mount should be shared, but is fitted separately"
    assert [part.mount for part in found.series] == ["mount 1", "mount 1 from row 21", "mount 1 of series 2"]
    assert found.noise.position_model_error < 2e-4


def joints(change):
    return lambda s: replace(s, q=change(s.q))


def flipped(j):
    return joints(lambda q: q * np.where(np.arange(6) == j, -1, 1))


def counting(j, i):
    """Joint j counts joint i along with itself."""
    return joints(lambda q: q + np.outer(q[:, i], np.eye(6)[j]))


def notation(meant, read):
    """Orientations in one notation of angles that were read in another."""
    return lambda s: replace(
        s, rotation=Rotation.from_euler(read, Rotation.from_matrix(s.rotation).as_euler(meant)).as_matrix()
    )


def positions(change):
    return lambda s: replace(s, position=change(s.position))


MIRRORED = r"left-handed frame: is the sign of an axis wrong, or are two axes exchanged\?"
MISTAKES = {
    "x and y": (positions(lambda p: p[..., [1, 0, 2]]), "fit if x and y of the positions are exchanged"),
    "degrees": (joints(np.degrees), "fit if joint angles are degrees, not radians"),
    "millimetres": (positions(lambda p: 1e3 * p), "are 1000 times too large: milli"),
    "sign of joint 2": (flipped(1), "fit if shoulder_lift_joint has the other sign"),
    "zero of joint 4": (joints(lambda q: q + np.pi * np.eye(6)[3]), "wrist_1_joint is off by 180 deg"),
    "two exchanged": (
        joints(lambda q: q[:, [0, 1, 3, 2, 4, 5]]),
        "shoulder_lift_joint, wrist_1_joint, elbow_joint",
    ),
    "pose before": (joints(lambda q: np.roll(q, -1, axis=0)), "belong to the previous pose"),
    "all mixed": (
        joints(lambda q: q[:, [3, 5, 0, 4, 2, 1]]),
        "wrist_1_joint, wrist_3_joint, shoulder_pan_jo",
    ),
    "joint 3 counts joint 2": (counting(2, 1), "elbow_joint is the file's elbow_joint - shoulder_lift_joint"),
    "opposite order": (joints(lambda q: q[:, ::-1]), "file is wrist_3_joint, wrist_2_joint"),
    "sign of y alone": (lambda s: position_only(positions(lambda p: p * [1, -1, 1])(s)), MIRRORED),
    "extrinsic angles": (notation("xyz", "XYZ"), "extrinsic xyz instead of intrinsic xyz"),
    "transposed": (
        lambda s: replace(s, rotation=s.rotation.swapaxes(1, 2)),
        "the tracker's in the target's frame",
    ),
    "any orientations": (
        lambda s: replace(s, rotation=Rotation.random(s.n_rows, random_state=0).as_matrix()),
        "its positions fit this arm, but its orientations are",
    ),
    "five poses": (lambda s: select_rows(s, np.arange(5)), "5 poses .* for the 12 numbers .* at least 6"),
    "joint 1 alone": (
        joints(lambda q: np.where(np.arange(6) == 0, q, q[0])),
        "only shoulder_pan_joint turn.* need 2 joints",
    ),
    "all lost": (lambda s: replace(s, precision=np.zeros((s.n_rows, 1, 3, 3))), "tmac was never read"),
}


FIRST = "x and y, joint 3 counts joint 2, five poses, all lost".split(", ")
"""One mistake of each way to find it; `make studies` plants the others."""


@pytest.mark.parametrize(
    "mistake", [pytest.param(name, marks=[pytest.mark.study] * (name not in FIRST)) for name in MISTAKES]
)
def test_a_mistake_is_named(ur10, mistake):
    plant, words = MISTAKES[mistake]
    (one,) = read(ur10, poses=16)
    with pytest.raises(BenchError, match=f"^series 1: .*{words}"):
        gathered(ur10, plant(one))


@pytest.fixture(scope="module")
def circles(kr500):
    """Three targets of an arm whose joints move one after the other, six poses each."""
    rest, ends = np.radians([0, -90, 90, 0, 40, 0]), np.radians([60, 30, 30, 150, 55, 170])
    q = np.tile(rest, (36, 1))
    for j in range(6):
        q[6 * j : 6 * j + 6, j] += np.linspace(-ends[j], ends[j], 6)
    asked = AbsoluteCampaign(poses=36, targets=3)
    return simulate_series(kr500, asked, 1, q)[0][0]


@pytest.mark.study
def test_circles_of_one_joint_each_tell_couplings_orders_and_slips(kr500, circles):
    """Most rows have one angle of the coupled joint: its zero would explain them, but not the others."""
    planted = {
        "joint_3 is the file's joint_3 - joint_2": counting(2, 1),
        "joint_2, joint_3, joint_1, joint_4, joint_5, joint_6": joints(lambda q: q[:, [1, 2, 0, 3, 4, 5]]),
        "belong to the previous pose from row 21 on": lambda s: replace(
            s, q=np.where(np.arange(36)[:, None] < 20, s.q, np.roll(s.q, -1, axis=0))
        ),
    }
    assert explain_unregistered_series(kr500.vjm, circles) is None
    for words, plant in planted.items():
        assert words in describe(explain_unregistered_series(kr500.vjm, plant(circles)), kr500.arm).sentence


def test_readings_of_another_arm_are_refused_with_their_size(ur10, kr500):
    """A KR500 reaches 2.5 times as far as a UR10."""
    (one,) = simulate_series(kr500, AbsoluteCampaign(poses=8), 1)[0]
    with pytest.raises(BenchError, match=r"spread 2\.\d+ times as far as its tool: another arm"):
        gathered(ur10, one)


def test_a_mount_may_be_turned_by_any_angle(ur10):
    """It starts from where the same series without the turn would, turned; also one that another shares."""
    one, two = read(ur10, series=2, share_target=True)
    bare = nominal_state(ur10.vjm, read_body_masses(ur10.arm), np.ones(6))
    sound = align(bare, two)[1].rotation
    for turn in ((90, 0, 0), (0, 90, 0), (0, 0, 172), (0, 180, 0)):
        W = Rotation.from_rotvec(turn, degrees=True).as_matrix()
        turned = replace(two, rotation=two.rotation @ W)
        np.testing.assert_allclose(align(bare, turned)[1].rotation, sound @ W, atol=1e-9)
    shared = align_all(bare, (position_only(one), turned)).mounts["mount 1"].rotation
    np.testing.assert_array_equal(shared, align(bare, turned)[1].rotation)


def test_a_target_that_was_never_read_is_left_out(kr500):
    (one,) = simulate_series(kr500, AbsoluteCampaign(poses=10, targets=3), 1)[0]
    precision = np.tile(np.eye(3) / one.sigma**2, (10, 3, 1, 1))
    precision[:, 1] = 0
    (left,), notes = with_common_targets((replace(one, precision=precision),))
    words = [describe(note, kr500.arm).sentence for note in notes]
    assert words == [f"series 1: targets without any reading are left out: {one.markers[1]}"]
    assert left.markers == (one.markers[0], one.markers[2])
    np.testing.assert_array_equal(left.position, one.position[:, [0, 2]])
    assert left.is_measured.all()


@pytest.mark.study
def test_targets_of_a_shared_mount_go_by_their_names(kr500):
    """In another order nothing changes; a series that lacks one is fitted with what the other says of it."""
    one, two = read(kr500, series=2, poses=30, targets=3, orientations=False, share_target=True)
    swapped = replace(two, markers=two.markers[::-1], position=two.position[:, ::-1])
    fewer = replace(two, markers=two.markers[:2], position=two.position[:, :2])
    sound = gathered(kr500, one, two)
    other = gathered(kr500, one, swapped)
    assert other.noise.position_model_error == pytest.approx(sound.noise.position_model_error, rel=1e-9)
    left, right = (residuals(sound.state, x)[:3] for x in (two, swapped))
    np.testing.assert_allclose(left, right[::-1], atol=1e-12)
    for order in ((one, fewer), (fewer, one)):
        found = gathered(kr500, *order)
        assert found.noise.position_model_error == pytest.approx(sound.noise.position_model_error, rel=0.1)
        assert found.state.mount(one).points[2] == pytest.approx(sound.state.mount(one).points[2], abs=2e-3)
    with pytest.raises(BenchError, match="no target P9 is known; there are P1, P2, P3"):
        sound.state.mount(replace(two, markers=("P9", "P1", "P2")))


def test_a_frame_that_is_not_shared_after_all_is_refused(ur10):
    """Whichever comes first; a tracker that moved by metres in mid-series is another matter."""
    one, two = read(ur10, series=2)
    for first, second in ((one, two), (two, one)):
        with pytest.raises(
            BenchError, match=r"from the positions predicted in the frame .* that it shares; did the tracker"
        ):
            gathered(ur10, first, replace(second, frame=first.frame))
    _, _, jump = FAULTS["tracker by metres"]
    one, two = read(ur10, series=2, share_frame=True)
    assert "the tracker moved by" in moves(gathered(ur10, jump(one, 22), two), ur10)[0]


@pytest.mark.parametrize(
    "shared", [pytest.param({"share_frame": True}, marks=pytest.mark.study), {"share_target": True}]
)
def test_what_few_poses_leave_open_is_taken_from_what_others_share(ur10, shared):
    """Three poses with the frame of another series or five with its mount, whichever is read first."""
    one, two = read(ur10, series=2, orientations=False, **shared)
    few = select_rows(two, np.arange(3 if "share_frame" in shared else 5))
    for order in ((few, one), (one, few)):
        state = gathered(ur10, *order).state
        off = np.linalg.norm(residuals(state, two)[:1], axis=1)
        assert np.sqrt((off**2).mean()) < 6e-4  # 0.2 mm are left of the long series alone
    with pytest.raises(BenchError, match=f"^series 2: {few.n_rows} poses with a reading are too few"):
        gathered(ur10, one, replace(few, frame="its own", mount="its own"))
    with pytest.raises(BenchError, match=r"^series 2: 1 poses with a reading are too few"):
        gathered(ur10, one, replace(select_rows(two, np.arange(1)), frame="its own"))


@pytest.fixture(scope="module")
def seven(tmp_path_factory):
    return build_cell(str(write_arm(tmp_path_factory.mktemp("seven") / "arm", "zyzyzyz")))


def turning_alone(cell, joints, **asked):
    """24 poses under 2.5 kg in which some joints turn, the same frame and mount as all others of the seed."""
    q = np.full((24, 7), 0.3)
    q[:, joints] = np.random.default_rng(3).uniform(-1.2, 1.2, (24, len(joints)))
    campaign = AbsoluteCampaign(poses=24, masses=(2.5,), **asked)
    return replace(simulate_series(cell, campaign, 7, q)[0][0], name="turned", mount="another")


def test_two_joints_that_turn_are_enough_beside_a_series_of_the_same_frame(seven):
    """Seven joints, a payload; read first, the series waits for the one that tells its frame."""
    q = np.random.default_rng(4).uniform(-1.2, 1.2, (40, 7))
    (rich,), _ = simulate_series(seven, AbsoluteCampaign(poses=40), 7, q)
    few = turning_alone(seven, [0, 1])
    state = gathered(seven, few, rich).state
    assert np.sqrt((residuals(state, few)[:1] ** 2).sum(axis=1).mean()) < 1e-3
    with pytest.raises(
        BenchError, match=r"^turned: only joint_1 and joint_2 turn; the 9 numbers .* need 3 joints .* another"
    ):
        align_all(nominal_state(seven.vjm, read_body_masses(seven.arm), np.ones(7)), (few,))


def test_with_orientations_two_axes_that_are_not_parallel_are_enough(seven):
    bare = nominal_state(seven.vjm, read_body_masses(seven.arm), np.ones(7))
    one, parallel = (turning_alone(seven, joints, orientations=True) for joints in ([0, 1], [1, 3]))
    assert np.median(np.linalg.norm(residuals(align_all(bare, (one,)), one)[:1], axis=1)) < 3e-3
    with pytest.raises(BenchError, match=r"^turned: its poses do not determine .* axes are not parallel"):
        align_all(bare, (parallel,))


def test_few_poses_under_two_loads_keep_a_scatter_of_their_own(ur10):
    """Unknowns may spend all equations of the means; what is left then tells nothing of their scatter."""
    options = CalibrationOptions(used_errors=frozenset({"joint springs", "joint errors"}))
    series = read(ur10, poses=20, orientations=False, masses=(0.0, 5.0))
    found = calibrate(ur10.vjm, series, cad_prior(ur10.arm), options)
    assert outliers_of(found) == ([], [])
    assert found.noise.factor[0] > 0.4


def test_outliers_of_2_mm_are_counted_and_the_worst_is_named(ur10):
    """None of the sound readings is among them, and they move the fit by less than it is off."""
    asked = AbsoluteCampaign(poses=2 * ROWS, outliers=0.04)
    series, truth = simulate_series(ur10, asked, 1)
    found = select_and_solve(gathered(ur10, *series), ONLY)
    rows, [note] = outliers_of(found)
    assert not found.issues
    assert len(rows) == truth.outliers[0].sum() > 2
    assert all(truth.outliers[0][row.row - 1].all() for row in rows)
    assert [row.error_mm for row in rows] == pytest.approx([2] * len(rows), rel=0.2)
    assert f"{len(rows)} of {2 * ROWS} positions" in note
    assert f"row {rows[0].row} of series 1" in note


@pytest.fixture(scope="module")
def hundred(ur10):
    """Readings whose rows are numbered as in a file with a header."""
    return replace(read(ur10, 3, poses=100)[0], row_id=np.arange(100) + 2)


def late(one, k, shift):
    """The joint angles of row k deleted and those below moved up, or one inserted: the last one is lost."""
    other = np.roll(one.q, shift, axis=0)
    q = np.where(np.arange(one.n_rows)[:, None] < k, one.q, other)
    return select_rows(replace(one, q=q), np.arange(one.n_rows - 1))


@pytest.mark.parametrize(
    ("turned", "k", "shift"),
    [pytest.param(True, 15, -1, marks=pytest.mark.study), (False, 15, 1)],
)
def test_rows_that_slipped_are_named_with_the_first_one(ur10, hundred, turned, k, shift):
    one = late(hundred if turned else position_only(hundred), k, shift)
    words = "previous pose" if shift < 0 else "next pose"
    expected = rf"rows from {k + 2} on do not fit .*; the readings belong to the {words} from row {k + 2} on"
    with pytest.raises(BenchError, match=expected), raise_explanation(ur10.vjm):
        calibrate_with_masses(ur10.vjm, [one], ONLY)


def test_nothing_slipped_in_sound_rows_nor_where_a_tracker_moved_or_poses_repeat(ur10, hundred):
    """Nor where rows at the end are wild, nor is half of the truth said where a tracker moved too."""
    number = np.arange(100)[:, None, None]
    moved, wild = 0.05 * (number >= 50), 0.3 * (number >= 92)
    again = replace(select_rows(hundred, np.repeat(np.arange(100), 3)), row_id=np.arange(300) + 2)
    slipped = late(position_only(hundred), 50, -1)
    for one in (
        hundred,
        position_only(hundred),
        again,
        replace(position_only(hundred), position=hundred.position + moved),
        replace(hundred, position=hundred.position + wild),
        replace(slipped, position=slipped.position + moved[: slipped.n_rows]),
    ):
        check_row_order(ur10.vjm, [one])


@pytest.mark.study
def test_a_zero_that_geometry_hides_is_a_doubt_with_its_joint_and_size(ur10, hundred):
    """A turn of the link before it does the same, so that the readings fit; sound ones raise no doubt."""
    some = select_rows(hundred, np.arange(ROWS))
    one = replace(some, q=some.q + np.radians(5) * np.eye(6)[4])
    every = [calibrate_with_masses(ur10.vjm, [own], ONLY) for own in (some, one)]
    sound, off = (numbers(found, remaining_errors(found)) for found in every)
    assert sound.far_geometry == ""
    assert off.total_after.mean_mm < 0.3
    (doubt,) = [text for text in off.doubts if text.startswith("Implausible geometry: ")]
    size = re.search(r"the zero of wrist_2_joint is off by (\S+) deg", doubt)
    assert float(size[1]) == pytest.approx(-5, abs=0.3)  # the arm's own errors are tenths of a degree there
