"""Gravity from another side than the arm's folder has it: a base that hangs, stands on a wall or is tilted.

A hung weight pulls along -z of the folder's world. If the base is mounted otherwise it pulls along a unit
vector g of these axes. Deflections are linear in the force, so that expected compliances and the deflections
d_k that they give under the same force along x, y and z tell g by least squares:

    d = x_1 d_1 + x_2 d_2 + x_3 d_3,    g = x / |x|

Deflections alone do not tell an arm that hangs from one whose readings before and after are exchanged. A
tracker that stands level does: its z against the registered base. Without one, own weight tells: it has bent
the arm in the unloaded readings already, towards g.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import angle_unit, find_body, read_mjcf
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.diagnosis.hypothesis import Issue
from testbench.identify.metric import PriorScaling
from testbench.identify.registered import RegisteredDataset
from testbench.identify.registration import Frame
from testbench.identify.weighed import single_readings
from testbench.model.kinematics import body_pose
from testbench.model.vjm import Vjm, rotation

DOWN = np.array([0.0, 0.0, -1.0])
STRAIGHT = np.deg2rad(1.0)  #: Angle of a force against the vertical up to which it is a weight [rad].
LEVEL = np.deg2rad(3.0)  #: How far a tracker that is levelled by its feet may be off, and a floor [rad].
TILTED = np.deg2rad(5.0)  #: Angle of g by deflections from which a mounting is looked at [rad].
SNAP = np.deg2rad(22.0)  #: Angle up to which g is that of a ceiling, a wall or a level tracker [rad].
REVERSED = np.deg2rad(120.0)  #: Angle from which weights seem to pull upwards [rad].
FAR, EXPLAINED = np.deg2rad(45.0), 0.7
"""Angle of g [rad], and share of the typical deflection that it explains, from which it is sure alone."""
FEWEST = 6  #: Readings from which the three numbers of a direction are told from scatter.
ROUNDS = 5  #: Weightings of the least squares.
ROUNDING = 1e-9  #: Of a rotation [1].


def pulled_along(data: Dataset, g: Array) -> Dataset:
    """Rotate all wrenches from gravity along -z to gravity along g.

    Args:
        data: The runs, with loads stated for gravity along -z.
        g: Direction of gravity in the folder's world, a unit vector, (3,) [1].

    Returns:
        The runs with rotated wrenches.
    """
    return replace(data, wrench=(data.wrench.reshape(-1, 2, 3) @ towards(g).T).reshape(-1, 6))


def mounted(vjm: Vjm, g: Array) -> Vjm:
    """Rotate the arm's base so that gravity along g becomes gravity along -z.

    Args:
        vjm: The arm as its folder has it.
        g: Direction of gravity in the folder's world, a unit vector, (3,) [1].

    Returns:
        The arm as it is mounted.
    """
    turn = np.eye(4)
    turn[:3, :3] = towards(g).T
    return replace(vjm, base=turn @ vjm.base)


def towards(g: Array) -> Array:
    """Compute the smallest rotation that takes -z to g.

    Args:
        g: Direction of gravity, a unit vector, (3,) [1].

    Returns:
        The rotation, (3, 3) [1]; half a turn about x when g is +z.
    """
    axis = np.cross(DOWN, g)
    size = float(np.linalg.norm(axis))
    angle = float(np.arctan2(size, DOWN @ g))
    return rotation(axis / size if size > ROUNDING else np.eye(3)[0], angle)


def angle(a: Array, b: Array) -> float:
    """Compute the angle between two vectors, atan2(|a x b|, a . b).

    Args:
        a: A vector, (3,).
        b: Another, (3,), in any unit.

    Returns:
        The angle, 0 to pi [rad].
    """
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def tracker_level(registered: RegisteredDataset) -> Array | None:
    """Find the direction of gravity from a tracker that stands level.

    Args:
        registered: The runs with the registration of their stations.

    Returns:
        Gravity in the folder's world, a unit vector, (3,) [1]. None without a registration, or when stations
        disagree.
    """
    if registered.frame != "tracker" or registered.registration is None:
        return None
    return mean_level(registered.registration.frames.values())


def mean_level(frames: Iterable[Frame]) -> Array | None:
    """Average the direction of gravity over frames of trackers that stand level.

    Gravity along -z of a frame with rotation R is R^T (0, 0, -1) in the base's world.

    Args:
        frames: Frames of the trackers, at least one.

    Returns:
        Gravity in the folder's world, a unit vector, (3,) [1]; None when one differs from the mean by LEVEL
        or more.
    """
    own = np.array([DOWN @ frame.rotation for frame in frames])
    mean = own.mean(axis=0) / np.linalg.norm(own.mean(axis=0))
    return mean if max(angle(one, mean) for one in own) < LEVEL else None


@dataclass(frozen=True)
class Pull:
    """Hold the direction of gravity, as found from the loads and from a level tracker."""

    g: Array  #: Gravity in the folder's world, a unit vector, (3,) [1].
    level: Array | None = None  #: The same by a level tracker, (3,) [1]; None if unknown.
    explained: float = 0.0  #: Share of the typical deflection that the prior explains with this gravity [1].

    @property
    def told(self) -> bool:
        """Tell whether a level tracker has gravity within SNAP of this direction."""
        return self.level is not None and bool(angle(self.level, self.g) < SNAP)

    @property
    def plain(self) -> bool:
        """Tell whether gravity is more than FAR from -z and explains more than EXPLAINED of the deflections.

        No other mistake does both.
        """
        return angle(self.g, DOWN) > FAR and self.explained > EXPLAINED


def weights_only(data: Dataset) -> bool:
    """Tell whether all loads are weights: forces within STRAIGHT of -z.

    Args:
        data: The runs.

    Returns:
        Whether they are; False when no run has a force.
    """
    force = data.wrench[:, :3]
    pushed = force.any(axis=1)
    return bool(pushed.any()) and all(angle(one, DOWN) <= STRAIGHT for one in force[pushed])


def suspected_pull(vjm: Vjm, metric: PriorScaling, data: Dataset, level: Array | None) -> Pull | None:
    """Find gravity that comes from another side than the folder has it.

    The direction is the least-squares x / |x| of d = x_1 d_1 + x_2 d_2 + x_3 d_3, with d_k the deflections
    under gravity along axis k. A level tracker near it takes precedence.

    Args:
        vjm: The arm's virtual joint model.
        metric: Prior of its compliances.
        data: Loaded runs.
        level: Gravity in the folder's world if the tracker stands level, a unit vector, (3,) [1]; None if
            unknown.

    Returns:
        The direction of gravity. None when it is as in the folder, when a load is no weight, or when there
        are fewer than FEWEST readings.
    """
    if not weights_only(data) or np.count_nonzero(data.seen) < FEWEST:
        return None
    g, explained = _by_deflections(vjm, metric, data)
    if level is not None and angle(level, DOWN) < LEVEL:
        return None  # it stands upright, whatever else is wrong
    if level is not None and angle(level, g) < min(SNAP, angle(g, DOWN)):
        return Pull(snapped(level, LEVEL), level, explained)
    return None if angle(g, DOWN) < TILTED else Pull(snapped(g, SNAP), level, explained)


def snapped(g: Array, least: float) -> Array:
    """Replace a direction by the nearest one of a ceiling or a wall, if that is near.

    Args:
        g: Direction of gravity, a unit vector, (3,) [1].
        least: Angle from which the direction is kept as it is [rad].

    Returns:
        The nearest of +z, +-x and +-y, or g, (3,) [1].
    """
    nearest = min((*np.eye(3), *-np.eye(3)[:2]), key=lambda side: angle(g, side))
    return nearest if angle(g, nearest) < least else g


def _by_deflections(vjm: Vjm, metric: PriorScaling, data: Dataset) -> tuple[Array, float]:
    """The direction in which weights pull, (3,), by robust least squares, and what it explains [1]."""
    pi = metric.L @ metric.expected
    read = [single_readings(vjm, metric.structure, pulled_along(data, e)) for e in np.eye(3)]
    A, y = np.stack([(readings.A @ pi).ravel() for readings in read], axis=1), read[0].y.ravel()
    weight = np.ones(len(y))
    for _ in range(ROUNDS):
        x = np.linalg.lstsq(A * weight[:, None], y * weight)[0]
        off = np.linalg.norm((y - A @ x).reshape(-1, 3), axis=1)
        weight = np.repeat(1 / np.sqrt(1 + np.square(off / max(float(np.median(off)), 1e-12))), 3)
    typical = float(np.median(np.linalg.norm(y.reshape(-1, 3), axis=1)))
    explained = 1 - float(np.median(off)) / max(typical, 1e-12)
    return np.asarray(x / max(float(np.linalg.norm(x)), 1e-300)), explained


def mounting(vjm: Vjm, pull: Pull, nats: float | None = None) -> Issue:
    """Report a base that is mounted so that gravity has the direction of the pull.

    Args:
        vjm: The arm as its folder has it.
        pull: Direction of gravity.
        nats: Nats that the readings gain by it; None if they were not compared.

    Returns:
        The issue. Its size, (7,) [1], holds gravity in the base's axes, then a quaternion (w, x, y, z): the
        orientation of the base's body in its parent that rigid.xml needs.

    Raises:
        InputError: When rigid.xml cannot be read.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    arm, root = vjm.arm, read_mjcf(vjm.arm.rigid)
    own = body_pose(arm, find_body(arm.rigid, root, arm.links[0].name), angle_unit(root))
    stands = own @ np.linalg.inv(vjm.base) @ mounted(vjm, pull.g).base
    turn = Rotation.from_matrix(stands[:3, :3]).as_quat(scalar_first=True)
    turn = turn * np.sign(turn[np.abs(turn) > ROUNDING][0])
    size = np.concatenate([pull.g @ vjm.base[:3, :3], turn])
    return Issue("mounting", (arm.links[0].name,), size, {"level": pull.told}, nats)
