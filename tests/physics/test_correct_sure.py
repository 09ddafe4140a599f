"""What a model says of its corrections: intervals that hold what its doubts do, and where these come from."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.correct.arm_model import About, bending, of_compliances
from testbench.correct.beyond import extent
from testbench.correct.compensated import compensate
from testbench.correct.newton import Aim, correct
from testbench.correct.open import most_open
from testbench.correct.rest import rest
from testbench.correct.sure import Stand, fitted_half_widths, half_widths, rows_between
from testbench.correct.target import asked
from testbench.errors import BenchError
from testbench.identify.intervals import Linearised
from testbench.model.joint_errors import JointErrors
from testbench.model.load import Load
from testbench.model.structure import all153
from testbench.model.vjm import tool_pose
from testbench.model.weights import read_weights
from testbench.plant import settle

TIP = np.array([0.2, 0.0, 0.1])
AIM = Aim(point=tuple(TIP))
POINTS, DRAWS = 8, 120
ELASTIC = 54  #: First column of the compliances.
SCALE = np.array([9e3, 8e3, 3e3, 5e2, 4e2, 2e2])  #: Of the torque of every joint [N m].
FORCE = Load(np.array([900.0, 1500, -700, 0, 0, 0]), TIP)


def spread(pi, root, unseen=None):
    unseen = np.zeros((0, len(pi))) if unseen is None else unseen
    return Linearised(pi, root, unseen, np.ones(len(pi)), np.inf, 0.0, on_boundary=False)


@pytest.fixture(scope="module")
def known(kr500):
    """Compliances that are unsure by a tenth, no two of one link alike."""
    structure = all153(kr500.arm)
    state = bending(kr500.vjm, kr500.arm.C_theta, read_weights(kr500.arm))
    pi = structure.entries(state.C_theta)
    d = np.sqrt(np.diag(state.C_theta))
    root = np.diag(0.1 * d[structure.a] * d[structure.b])
    root[1:, :-1] += 0.5 * np.diag(np.diag(root)[1:])
    return of_compliances(state, structure, spread(pi, root), About("made up"))


@pytest.fixture(scope="module")
def absolute(known):
    """The same that knows geometry and joint errors too, by a tenth of a millimetre and a milliradian."""
    errors = JointErrors(orders=(1,), play=True, stiffening=True)
    state = replace(known.state, errors=errors, n=np.full((6, 4), 1e-4), torque_scale=SCALE)
    model = replace(known, state=state, absolute=True)
    rigid = 30 + 24
    sizes = np.concatenate([np.tile([1e-4] * 3 + [1e-4] * 3, 5), np.full(24, 5e-5)])
    root = np.zeros((rigid + 153, rigid + 153))
    root[:rigid, :rigid] = np.diag(sizes)
    root[1:rigid, : rigid - 1] += 0.5 * np.diag(sizes[1:])
    root[rigid:, rigid:] = known.spread.root
    columns = np.arange(rigid + 153)
    centre = model.unknowns.current(state)[columns]
    return replace(model, columns=columns, spread=spread(centre, root))


def drawn_state(model, rng):
    """The arm that a model may be, as its doubts have it."""
    x = model.unknowns.current(model.state)
    x[model.columns] += rng.standard_normal(len(model.spread.root)) @ model.spread.root
    return state_of(model, x)


def state_of(model, x):
    """The arm with these values of all unknowns."""
    unknowns = model.unknowns
    theta = model.state.theta_0.copy()
    theta[unknowns.inner] = x[unknowns.columns("geometry")]
    n = x[unknowns.columns("errors")].reshape(model.state.n.shape)
    C = model.structure.matrix(x[unknowns.columns("elastic")])
    return replace(model.state, theta_0=theta, C_theta=C, n=n)


def share_inside(model, aim, rng):
    """How often what is left of a correction is inside its interval, over arms that the model may be."""
    q = np.array([0.3, -1.2, 1.6, 0.3, -0.5, 0.1]) + rng.uniform(-0.3, 0.3, (POINTS, 6))
    found = compensate(model, q, [FORCE], aim)
    assert found.corrected.all()
    inside = []
    for _ in range(DRAWS):
        true = drawn_state(model, rng)
        target = asked(true, q, found.asked, TIP).position
        inside.append(np.abs(rest(true, found.q, [FORCE]).at(TIP) - target) <= found.half)
    return np.mean(inside)


@pytest.mark.parametrize(
    ("kind", "meant"), [("known", "unloaded"), ("absolute", "unloaded"), ("absolute", "drawn")]
)
def test_intervals_hold_what_the_doubts_of_a_model_do(request, kind, meant):
    """120 arms at 8 points: 95 % are held; a share of 0.90 is seven standard deviations of a draw away."""
    model = request.getfixturevalue(kind)
    share = share_inside(model, replace(AIM, asked=meant), np.random.default_rng(5))
    assert 0.90 < share < 0.99


@pytest.mark.parametrize(
    "column", [3, 12, 29, 30, 32, 33, *range(36, 54, 4), *range(37, 54, 4), 54, 60, 130, 204, 206]
)
def test_rows_are_how_positions_move_with_what_is_unsure(absolute, column):
    """Of geometry, joint errors and compliances: differences of the bent arm's tip, but for second order."""
    q = np.array([[0.3, -1.2, 1.6, 0.3, -0.5, 0.1]])
    row = rows_between(absolute, Stand(q, [FORCE]), None, TIP[None])[0, 0, :, column]
    x, tips = absolute.unknowns.current(absolute.state), []
    step = 1e-5 if column < ELASTIC else 1e-3 * max(abs(x[column]), 1e-7)
    for sign in (1, -1):
        moved = x.copy()
        moved[column] += sign * step
        tips.append(rest(state_of(absolute, moved), q, [FORCE]).at(TIP)[0])
    slope = (tips[0] - tips[1]) / (2 * step)
    assert np.abs(slope - row).max() < 0.03 * np.abs(slope).max() + 1e-6


def test_what_points_share_goes_with_a_frame_that_is_fitted_to_them(absolute):
    q = np.array([0.3, -1.2, 1.6, 0.3, -0.5, 0.1]) + np.random.default_rng(6).uniform(-0.1, 0.1, (POINTS, 6))
    q[:, 0] = 0.3
    stand = Stand(q, [FORCE])
    whole, left = (
        half_widths(absolute, stand, None, TIP[None])[:, 0],
        fitted_half_widths(absolute, stand, TIP),
    )
    assert np.median(left) < 0.6 * np.median(whole)
    base = np.zeros((1, len(absolute.spread.root[0])))
    base[0, 3:6] = 1e-3  # a turn of link 1's end, joint 1 at rest: all go round as one
    turned = replace(absolute, spread=spread(absolute.spread.pi, base))
    assert fitted_half_widths(turned, stand, TIP).max() < 1e-6
    assert half_widths(turned, stand, None, TIP[None]).max() > 1e-3


def test_before_and_after_are_foretold_minus_asked(kr500, known):
    q = np.array([[0.3, -1.2, 1.6, 0.3, -0.5, 0.1]])
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
    q = np.array([[0.3, -1.2, 1.6, 0.3, -0.5, 0.1]] * 2)
    force = Load(np.array([np.zeros(6), FORCE.wrench]), np.array([TIP, TIP]))
    found = compensate(known, q, [force], AIM)
    assert np.array_equal(found.q[0], q[0])
    assert not np.array_equal(found.q[1], q[1])


def test_the_part_that_is_named_is_the_one_whose_knowledge_helps(kr500, known):
    """Two joints whose errors cancel leave nothing open between them, however unsure each is by itself."""
    q = np.array([0.3, -1.2, 1.6, 0.3, -0.5, 0.1]) + np.random.default_rng(7).uniform(-0.2, 0.2, (POINTS, 6))
    pi, columns = known.spread.pi, len(known.spread.pi)
    joint = {name: columns - 6 + k for k, name in enumerate(j.name for j in kr500.arm.joints)}
    root = np.zeros((1, columns))
    root[0, joint["joint_2"]] = 1e-7
    open_ = most_open(replace(known, spread=spread(pi, root)), q, [FORCE], TIP, absolute=False)
    assert (open_.name, open_.joint) == ("joint_2", True)
    assert open_.share == pytest.approx(1)
    unseen = np.zeros((1, columns))
    unseen[0, joint["joint_1"]] = 1
    blind = replace(known, spread=spread(pi, root, unseen))
    assert most_open(blind, q, [FORCE], TIP, absolute=False).name == "joint_1"
    both = np.diag([0.0] * columns)
    both[0, joint["joint_2"]] = both[1, joint["joint_3"]] = 1e-7
    alike = most_open(replace(known, spread=spread(pi, both)), q, [FORCE], TIP, absolute=False)
    assert alike is None or alike.name in ("joint_2", "joint_3")


def test_loads_beyond_those_of_the_identification_are_said_even_where_these_were_none(kr500, known):
    q = np.array([[0.3, -1.2, 1.6, 0.3, -0.5, 0.1]])
    size = float(np.linalg.norm(FORCE.wrench[:3]))
    half = replace(known, about=About("made up", force=size / 2, moment=1e9))
    assert "2.0 times the largest force" in extent(half, q, [FORCE]).sentences[0]
    none = replace(known, about=About("made up", force=0.0, moment=0.0))
    assert "under own weight alone" in extent(none, q, [FORCE]).sentences[0]
    assert not extent(replace(known, about=About("made up")), q, [FORCE]).sentences
    lever = np.cross(tool_pose(known.vjm, q)[1][0] @ TIP, FORCE.wrench[:3])
    held = Load(np.concatenate([FORCE.wrench[:3], -lever]), TIP)  # its moment about the tool's origin is zero
    assert extent(known, q, [held]).moment < 1e-9
    heavy = Load(np.array([0, 0, -2 * 9.81 * kr500.arm.payload, 0, 0, 0]), TIP)
    assert "2.0 times the payload" in extent(known, q, [heavy]).sentences[0]


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


def test_a_stretched_arm_keeps_its_position(known):
    q = np.array([[-2.1214, -1.7645, -0.0479, 4.6671, -0.0688, -2.2692]])
    load = [Load(np.array([-1851.1, 320.9, 686.0, 0, 0, 0]), np.zeros(3))]
    found = correct(known.state, q, load, asked(known.state, q, "unloaded", np.zeros(3)))
    assert found.solved.all()
    met = rest(known.state, found.q, load).position
    assert np.abs(met - rest(known.state, q).position).max() < 1e-9
    assert np.linalg.norm(found.turned) > 1e-5
    assert np.abs(tool_pose(known.vjm, found.q)[0] - met).max() > 1e-4  # not where the drawn arm is


@pytest.mark.parametrize(
    "wrong",
    [
        {"hold": "positon"},
        {"asked": "taught"},
        {"spindle": (2.0, 0, 0)},
        {"spindle": (0.0, 0, 0)},
        {"point": (300.0, 0, 0)},
    ],
)
def test_an_aim_that_is_none_is_refused(wrong):
    with pytest.raises(BenchError, match="aim"):
        Aim(**wrong)


def test_no_points_are_refused(known):
    with pytest.raises(BenchError, match="at least one point"):
        compensate(known, np.zeros((0, 6)), [])
