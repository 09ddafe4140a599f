"""What a model says of its corrections: the rows of its intervals, and where these come from."""

from dataclasses import replace

import numpy as np
import pytest
from loads import correct
from unsure import AIM, FORCE, RIGID, TIP, Q, normal, state_of, unsure, unsure_everywhere

from testbench.campaign.program import extrapolated
from testbench.correct.beyond import extent
from testbench.correct.compensated import compensate
from testbench.correct.newton import Aim, asked
from testbench.correct.rest import rest
from testbench.correct.uncertainty import Poses, fitted_half_widths, half_widths, most_open, rows_between
from testbench.errors import BenchError
from testbench.identify.arm_model import About
from testbench.model.load import Load
from testbench.model.vjm import tool_pose
from testbench.plant import settle

POINTS = 8


@pytest.fixture(scope="module")
def known(kr500):
    return unsure(kr500)


@pytest.fixture(scope="module")
def absolute(kr500):
    return unsure_everywhere(kr500)


@pytest.mark.parametrize(
    "column", [3, 12, 29, 30, 32, 33, *range(36, 54, 4), *range(37, 54, 4), 54, 60, 130, 204, 206]
)
def test_rows_are_how_positions_move_with_what_is_unsure(absolute, column):
    """Of geometry, joint errors and compliances: differences of the bent arm's tip, but for second order."""
    q = Q[None]
    row = rows_between(absolute, Poses(q, [FORCE]), None, TIP[None])[0, 0, :, column]
    x, tips = absolute.unknowns.current(absolute.state), []
    step = 1e-5 if column < RIGID else 1e-3 * max(abs(x[column]), 1e-7)
    for sign in (1, -1):
        moved = x.copy()
        moved[column] += sign * step
        tips.append(rest(state_of(absolute, moved), q, [FORCE]).at(TIP)[0])
    slope = (tips[0] - tips[1]) / (2 * step)
    assert np.abs(slope - row).max() < 0.03 * np.abs(slope).max() + 1e-6


def test_what_points_share_goes_with_a_frame_that_is_fitted_to_them(absolute):
    q = Q + np.random.default_rng(6).uniform(-0.1, 0.1, (POINTS, 6))
    q[:, 0] = 0.3
    stand = Poses(q, [FORCE])
    whole, left = (
        half_widths(absolute, stand, None, TIP[None])[:, 0],
        fitted_half_widths(absolute, stand, TIP),
    )
    assert np.median(left) < 0.6 * np.median(whole)
    base = np.zeros((1, len(absolute.posterior.root[0])))
    base[0, 3:6] = 1e-3  # a turn of link 1's end, joint 1 at rest: all go round as one
    turned = replace(absolute, posterior=normal(absolute.posterior.x, base))
    assert fitted_half_widths(turned, stand, TIP).max() < 1e-6
    assert half_widths(turned, stand, None, TIP[None]).max() > 1e-3


def test_before_and_after_are_foretold_minus_asked(kr500, known):
    q = Q[None]
    found = compensate(known, q, [FORCE], AIM)
    loaded, still = (
        settle(kr500.plant, q, *load) for load in ((FORCE.over(1).wrench, FORCE.over(1).point), ())
    )
    tips = [rest.tool + rest.rotation @ TIP for rest in (loaded, still)]
    np.testing.assert_allclose(found.before, tips[0] - tips[1], atol=1e-8)
    again = correct(known.state, q, [], asked(known.state, q, "drawn", TIP), AIM)
    sagged = compensate(known, q, [], replace(AIM, asked="drawn"))
    assert sagged.before[0, 2] < -1e-3  # own weight
    assert np.array_equal(sagged.q, again.q)
    assert (sagged.half[0] > 1e-5).any()  # compliances are unsure by a tenth


def test_a_point_where_nothing_acts_stays_as_it_is_to_the_last_digit(known):
    q = np.array([Q, Q])
    force = Load(np.array([np.zeros(6), FORCE.wrench]), np.array([TIP, TIP]))
    found = compensate(known, q, [force], AIM)
    assert np.array_equal(found.q[0], q[0])
    assert not np.array_equal(found.q[1], q[1])


def test_the_part_that_is_named_is_the_one_whose_knowledge_helps(kr500, known):
    """Two joints whose errors cancel leave nothing open between them, however unsure each is by itself."""
    q = Q + np.random.default_rng(7).uniform(-0.2, 0.2, (POINTS, 6))
    pi, columns = known.posterior.x, len(known.posterior.x)
    joint = {name: columns - 6 + k for k, name in enumerate(j.name for j in kr500.arm.joints)}
    root = np.zeros((1, columns))
    root[0, joint["joint_2"]] = 1e-7
    open_ = most_open(replace(known, posterior=normal(pi, root)), q, [FORCE], TIP, absolute=False)
    assert (open_.name, open_.joint) == ("joint_2", True)
    assert open_.share == pytest.approx(1)
    unseen = np.zeros((1, columns))
    unseen[0, joint["joint_1"]] = 1
    blind = replace(known, posterior=normal(pi, root, unseen))
    assert most_open(blind, q, [FORCE], TIP, absolute=False).name == "joint_1"
    both = np.diag([0.0] * columns)
    both[0, joint["joint_2"]] = both[1, joint["joint_3"]] = 1e-7
    alike = most_open(replace(known, posterior=normal(pi, both)), q, [FORCE], TIP, absolute=False)
    assert alike is None or alike.name in ("joint_2", "joint_3")


def test_loads_beyond_those_of_the_identification_are_said_even_where_these_were_none(kr500, known):
    q = Q[None]
    size = float(np.linalg.norm(FORCE.wrench[:3]))
    half = replace(known, about=About("made up", force=size / 2, moment=1e9))
    assert "2.0 times the largest force" in extrapolated(extent(half, q, [FORCE]))[0]
    none = replace(known, about=About("made up", force=0.0, moment=0.0))
    assert "under own weight alone" in extrapolated(extent(none, q, [FORCE]))[0]
    assert not extrapolated(extent(replace(known, about=About("made up")), q, [FORCE]))
    lever = np.cross(tool_pose(known.vjm, q)[1][0] @ TIP, FORCE.wrench[:3])
    held = Load(np.concatenate([FORCE.wrench[:3], -lever]), TIP)  # its moment about the tool's origin is zero
    assert extent(known, q, [held]).moment < 1e-9
    heavy = Load(np.array([0, 0, -2 * 9.81 * kr500.arm.payload, 0, 0, 0]), TIP)
    assert "2.0 times the payload" in extrapolated(extent(known, q, [heavy]))[0]


#: Near a stretched elbow and wrist: how a path was once torn between two ways to take a point.
TORN = [0.679164, -1.850984, 0.144721, 0.827372, 0.01697, -0.264587]
TO = [0.679618, -1.851264, 0.144247, 0.827643, 0.016682, -0.264803]


@pytest.mark.parametrize("hold", ["pose", "axis", "position"])
def test_points_that_are_close_have_corrections_that_are_close(known, hold):
    q = np.linspace(TORN, TO, 60)
    load = [Load(np.array([2434.54, 1322.173, 1151.032, 0, 0, 0]), np.array([0.3, 0.1, 0.1]))]
    aim = Aim(hold, point=(0.3, 0.1, 0.1))
    found = correct(known.state, q, load, asked(known.state, q, "unloaded", np.array(aim.point)), aim)
    assert found.solved.all()
    assert np.abs(np.diff(found.q - q, axis=0)).max() < 1e-3


def test_an_aim_that_is_none_and_no_points_are_refused(known):
    wrong = {"hold": "positon"}, {"asked": "taught"}, {"spindle": (2.0, 0, 0)}, {"point": (300.0, 0, 0)}
    for one in wrong:
        with pytest.raises(BenchError, match="aim"):
            Aim(**one)
    with pytest.raises(BenchError, match="at least one point"):
        compensate(known, np.zeros((0, 6)), [])
