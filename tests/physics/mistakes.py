"""Mistakes that are planted in sound data sets one by one, and the doubts that name them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from sound_sets import PAYLOAD, Sound

from testbench import BenchError, register_dataset
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Doubt
from testbench.identify.diagnosis.diagnose import diagnose, explain_unregistered_runs
from testbench.identify.diagnosis.hypotheses import describe
from testbench.identify.diagnosis.kinematics import Submission
from testbench.identify.prior import Prior
from testbench.model.vjm import tool_poses

POSES = 12  #: Of a set-up in which the tracker moves by half a millimetre.


@dataclass(frozen=True)
class Mistake:
    """What is done, and what names it."""

    words: str
    #: Fields of the data set that become wrong; a data set where the arm's folder does.
    change: Callable[[Sound, np.random.Generator], dict | Sound]
    names: str  #: Of doubts that are right.
    #: Whether it shows: in one load no sensor's zero, on one target no exchange.
    possible: Callable[[Sound], bool] = lambda _: True

    def plant(self, own: Sound, rng: np.random.Generator) -> Sound:
        """The data set with the mistake."""
        made = self.change(own, rng)
        return made if isinstance(made, Sound) else replace(own, data=replace(own.data, **made))


def named(own: Sound) -> list[Doubt]:
    """Doubts about a data set, as `testbench identify` finds them."""
    vjm, data = own.cell.vjm, own.data
    try:
        found = register_dataset(vjm, data, "tracker" if own.declared else "auto")
    except BenchError as why:
        issue = explain_unregistered_runs(vjm, data)
        return [describe(issue, vjm.arm) if issue else Doubt("refused", str(why))]
    found = diagnose(Submission(vjm, data, found, own.declared), own.prior)
    return [describe(issue, vjm.arm) for issue in found]


def bump(rng, size):
    """A move of this size in any direction, (3,)."""
    direction = rng.standard_normal(3)
    return size * direction / np.linalg.norm(direction)


def any_run(own, rng):
    return int(rng.integers(own.data.n_runs))


def any_reading(own, rng):
    return any_run(own, rng), int(rng.integers(len(own.data.markers)))


def put(change, *names):
    """What a field, or some, become by themselves."""
    return lambda own, _: {name: change(getattr(own.data, name)) for name in names}


def both(change):
    """Readings before and after alike."""
    return put(change, "before", "after")


def moved(axis, degrees, shift=(0.0, 0.0, 0.0)):
    R = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    return both(lambda x: x @ R.T + np.array(shift))


def exchanged(x):
    return x[:, [1, 0, *range(2, x.shape[1])]]


def names_once(own, rng):
    here = (own.data.pose_id == rng.choice(own.data.pose_id))[:, None, None]
    return both(lambda x: np.where(here, exchanged(x), x))(own, rng)


def target(own, rng):
    off = tool_poses(own.cell.vjm, own.data.q)[1] @ bump(rng, 0.06)
    return both(lambda x: np.concatenate([x[:, :-1], x[:, -1:] + off[:, None]], axis=1))(own, rng)


def joint(change):
    """Angles of any joint but the first and the last, by what they become of them and the next one's."""

    def of(own, rng):
        q, k = own.data.q.copy(), int(rng.integers(1, 5))
        q[:, k : k + 2] = change(q[:, k : k + 2])
        return {"q": q}

    return of


def one_pose(own, rng):
    q, pose = own.data.q.copy(), rng.choice(own.data.pose_id)
    q[own.data.pose_id == pose, int(rng.integers(1, 4))] += 0.15
    return {"q": q}


def pose_before(*names):
    """Readings of the pose before."""

    def of(own, _):
        by = own.data.n_runs // len(np.unique(own.data.pose_id))
        return put(lambda x: np.roll(x, by, axis=0), *names)(own, _)

    return of


def readings(name, rows, change):
    """Some readings otherwise."""

    def of(own, rng):
        x, where = getattr(own.data, name).copy(), rows(own, rng)
        x[where] = change(own, x[where], where, rng)
        return {name: x}

    return of


def swapped_once(own, _):
    d = own.data
    r = int(np.argmax(np.linalg.norm(d.deflection, axis=2).max(axis=1)))
    here = (np.arange(d.n_runs) == r)[:, None, None]
    return {"before": np.where(here, d.after, d.before), "after": np.where(here, d.before, d.after)}


def copied(own, rng):
    after, pose = own.data.after.copy(), own.data.pose_id
    first, other = rng.choice(np.unique(pose), 2, replace=False)
    after[np.flatnonzero(pose == first)[0]] = own.data.after[np.flatnonzero(pose == other)[0]]
    return {"after": after}


def first_station(d):
    return np.ones(d.n_runs, dtype=bool) if d.station is None else d.station == d.station[0]


def tracker_touched(own, rng):
    """The tracker's stand between the two readings: 3 mm and 1 mrad."""
    turn, shift, after = bump(rng, 1e-3), bump(rng, 3e-3), own.data.after.copy()
    here = first_station(own.data)
    centre = after[here].reshape(-1, 3).mean(axis=0)
    after[here] = (after[here] - centre) @ Rotation.from_rotvec(turn).as_matrix().T + centre + shift
    return {"after": after}


def bumped(own, rng):
    """The tracker moves between two poses, three of which at least are before it and behind."""
    d, here = own.data, first_station(own.data)
    poses = np.unique(d.pose_id[here])
    behind = here & (d.pose_id >= poses[int(rng.integers(3, len(poses) - 2))])
    shift = np.where(behind[:, None, None], bump(rng, 5e-4), 0.0)
    return both(lambda x: x + shift)(own, rng)


def longer(own, _):
    """Another arm's folder."""
    vjm, placements = own.cell.vjm, own.cell.vjm.joint_placements.copy()
    placements[2, :3, 3] *= 1 + 0.15 / np.linalg.norm(placements[2, :3, 3])
    return replace(own, cell=replace(own.cell, vjm=replace(vjm, joint_placements=placements)))


def swapped(own, _):
    return {"before": own.data.after, "after": own.data.before}


def folder(factor):
    return lambda own, _: replace(own, prior=Prior("wrong", factor * own.prior.C_theta))


def loads(change):
    return lambda own, rng: {"wrench": change(own, own.data.wrench.copy(), rng)}


def hung_from(turn):
    """An arm that is mounted otherwise than its folder, which is upright."""
    return lambda own, rng: own.mounted(Rotation.from_rotvec(turn(rng)).as_matrix())


def wall(rng):
    """Its z-axis level, any side of it up."""
    return rng.choice([-1, 1]) * np.pi / 2 * np.eye(3)[rng.integers(2)]


def tilt(rng):
    """By 10 to 30 degrees about any level axis."""
    direction = rng.uniform(-np.pi, np.pi)
    return np.deg2rad(rng.uniform(10, 30)) * np.array([np.cos(direction), np.sin(direction), 0])


def weights(own):
    return own.loads != "pressed"


def coupled(*pairs):
    """Joints, by their place, that count another one too, with any sign."""

    def of(own, rng):
        q = own.data.q.copy()
        for j, i in pairs:
            q[:, j] += rng.choice([-1, 1]) * own.data.q[:, i]
        return {"q": q}

    return of


def wrist(own, rng):
    """One joint of the wrist, or both, count the one before them."""
    return coupled(*[((4, 3),), ((5, 3),), ((4, 3), (5, 3))][rng.integers(3)])(own, rng)


def cycle(own, rng):
    order, some = np.arange(6), rng.choice(6, 3, replace=False)
    order[some] = np.roll(some, 1)
    return {"q": own.data.q[:, order]}


def mixed(own, rng):
    """An order of all joints that moves four of them or more."""
    while np.sum((order := rng.permutation(6)) != np.arange(6)) < 4:
        pass
    return {"q": own.data.q[:, order]}


def times(factor):
    return loads(lambda _, w, __: factor * w)


def sensor_zero(own, w, rng):
    """6.6 % of the payload's weight off: 300 N on the KR 500."""
    w[:, int(rng.integers(3))] += rng.choice([-1, 1]) * 0.0664 * GRAVITY * PAYLOAD[own.cell.arm.name]
    return w


def tool_axes(own, w, _):
    w[:, :3] = np.einsum("ryx,ry->rx", tool_poses(own.cell.vjm, own.data.q)[1], w[:, :3])
    return w


def one_level(_, w, __):
    force = np.linalg.norm(w, axis=1)
    w[force > 0.99 * force.max()] *= 0.8
    return w


def one_run(own, w, rng):
    w[any_run(own, rng)] *= 0.5
    return w


def other_axis(_, w, __):
    return w[:, [2, 1, 0, 3, 4, 5]]


def reversed_levels(_, w, __):
    return w.reshape(-1, 3, 6)[:, ::-1].reshape(-1, 6)


def load_point(own, rng):
    return {"point": own.data.point + bump(rng, 0.3)}


def in_base(own):
    return not own.tracker


def levels(own):
    return own.loads == "levels"


def not_hung(own):
    return own.loads != "hung"


def long(own):
    """Whether a set-up has the poses that tell a small move of the tracker from errors of the arm."""
    return len(np.unique(own.data.pose_id[first_station(own.data)])) >= POSES


def several(own):
    return len(own.data.markers) > 1


def off_2_mm(_, x, __, rng):
    return x + bump(rng, 2e-3)


def unloaded(own, _, run, __):
    return own.data.before[run]


ONE, Z = "reading run", (0, 0, 1)
ROWS = {
    "frame_tilted": ("frame turned 4 deg about a tilted axis", moved((0.6, 0.8, 0.3), 4), "frame", in_base),
    "frame_turned": ("frame turned 4 deg about the vertical", moved(Z, 4), "frame joint_zero", in_base),
    "frame_moved": ("frame 110 mm away", moved(Z, 0, (0.1, -0.05, 0)), "frame", in_base),
    "mirrored": ("sign of y", both(lambda x: x * [1, -1, 1]), "mirrored"),
    "axes": ("x, y, z are y, z, x", both(lambda x: x[..., [1, 2, 0]]), "frame", in_base),
    "millimetres": ("millimetres as metres", both(lambda x: 1e3 * x), "unit"),
    "inches": ("inches as metres", both(lambda x: x / 0.0254), "unit"),
    "inches_mm": ("inches as millimetres", both(lambda x: x / 25.4), "unit"),
    "centimetres": ("centimetres as metres", both(lambda x: 100 * x), "unit"),
    "radians": ("joint angles in radians as degrees", put(np.deg2rad, "q"), "angle_unit"),
    "names": ("two targets' names exchanged", both(exchanged), "markers", several),
    "target": ("a target 60 mm off on the tool", target, "targets", in_base),
    "joint_zero": ("a joint's zero 1.5 deg off", joint(lambda x: x + np.deg2rad([1.5, 0])), "joint_zero"),
    "joint_sign": ("a joint's sign", joint(lambda x: x * [-1, 1]), "joint_sign"),
    "joint_order": ("two joints exchanged", joint(lambda x: x[:, ::-1]), "joint_order"),
    "joint_cycle": ("three joints in a cycle", cycle, "joint_order"),
    "joints_mixed": ("four joints or more in another order", mixed, "joint_order"),
    "coupled_arm": ("joint 3 counts joint 2", coupled((2, 1)), "joint_coupling"),
    "coupled_wrist": ("joints 5, 6 or both count joint 4", wrist, "joint_coupling"),
    "order": ("readings of the pose before", pose_before("before", "after"), "order"),
    "names_once": ("two targets' names exchanged in one pose", names_once, "pose", several),
    "one_pose": ("a joint angle of one pose 0.15 rad off", one_pose, "pose"),
    "one_reading": ("an unloaded reading 2 mm off", readings("before", any_reading, off_2_mm), ONE, several),
    "longer": ("another arm's folder, a link 150 mm longer", longer, "link"),
    "equal": ("loaded and unloaded readings are equal", lambda own, _: {"after": own.data.before}, "equal"),
    "equal_once": (
        "loaded and unloaded readings are equal in one run",
        readings("after", any_run, unloaded),
        "equal",
    ),
    "swapped": ("before and after exchanged", swapped, "sign"),
    "swapped_once": ("before and after exchanged in one run", swapped_once, "run run_load reading"),
    "after_order": ("loaded readings of the pose before", pose_before("after"), "order"),
    "copied": ("loaded readings of another pose in one run", copied, "repeated"),
    "after_unit": ("loaded readings in millimetres", put(lambda x: 1e3 * x, "after"), "unit"),
    "tracker_moved": ("tracker touched between the readings: 3 mm, 1 mrad", tracker_touched, "tracker_moved"),
    "bumped": ("tracker moved by 0.5 mm between two poses", bumped, "tracker_moved", long),
    "touched": ("a target touched in one run: 2 mm", readings("after", any_reading, off_2_mm), ONE, several),
    "slipped": ("the tool slipped in one run: 2 mm", readings("after", any_run, off_2_mm), ONE, several),
    "hung": ("the arm hangs", hung_from(lambda _: np.array([np.pi, 0, 0])), "mounting", weights),
    "wall": ("the arm stands on a wall", hung_from(wall), "mounting", weights),
    "tilted": ("the arm's foot is tilted by 10 to 30 deg", hung_from(tilt), "mounting", weights),
    "kilograms": ("forces in kg", times(1 / GRAVITY), "scale"),
    "kilonewtons": ("forces in kN", times(1e-3), "scale"),
    "comma": ("forces ten times too large", times(10.0), "scale"),
    "force_sign": ("sign of the forces", times(-1.0), "sign"),
    "force_zero": ("force sensor 6.6 % off, 300 N on a KR 500", loads(sensor_zero), "force_offset", not_hung),
    "force_axis": ("force along x instead of z", loads(other_axis), "force_axes"),
    "tool_axes": ("forces in the tool's axes", loads(tool_axes), "force_axes"),
    "payload": ("one of three loads 20 % off", loads(one_level), "level", levels),
    "load_order": ("three loads in reversed order", loads(reversed_levels), "levels", levels),
    "one_load": ("a load stated as half in one run", loads(one_run), "run_load"),
    "load_point": ("load point 300 mm off", load_point, "load_point"),
    "point_unit": ("load point in millimetres", put(lambda x: 1e3 * (x + 0.05), "point"), "load_point"),
    "noise": ("noise stated 20 times too small", put(lambda sigma: sigma / 20, "sigma"), "noise"),
    "soft_folder": ("folder ten times too soft", folder(10.0), "scale"),
    "stiff_folder": ("folder ten times too stiff", folder(0.1), "scale"),
}
MISTAKES = {name: Mistake(*row) for name, row in ROWS.items()}
"""Mistakes by name, made with readings, loads and the arm's folder."""
