"""Mistakes that are made with readings, loads and folders: each plants itself in a sound data set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.prior import Prior
from testbench.model.vjm import tool_pose
from testbench.studies.wrong_inputs.sound import PAYLOAD, Sound

Plant = Callable[[Sound, np.random.Generator], Sound]


@dataclass(frozen=True)
class Fault:
    """A mistake, and the doubts that name it."""

    words: str  #: What was done.
    plant: Plant  #: Does it.
    names: tuple[str, ...]  #: Of doubts that are right.
    #: Whether it can be seen in a data set: in one load no sensor's zero, on one target no exchange.
    possible: Callable[[Sound], bool] = lambda _: True


def _data(change: Callable[[Sound, Dataset, np.random.Generator], Dataset]) -> Plant:
    return lambda sound, rng: replace(sound, data=change(sound, sound.data, rng))


def _rigid(R: Array, t: Array) -> Plant:
    def change(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
        return replace(d, before=d.before @ R.T + t, after=d.after @ R.T + t)

    return _data(change)


def _turn(axis: tuple[float, float, float], degrees: float) -> Array:
    from scipy.spatial.transform import Rotation

    unit = np.array(axis) / np.linalg.norm(axis)
    return np.asarray(Rotation.from_rotvec(np.deg2rad(degrees) * unit).as_matrix())


def _units(factor: float) -> Plant:
    return _data(lambda _, d, __: replace(d, before=factor * d.before, after=factor * d.after))


def _random_frame(sound: Sound, rng: np.random.Generator) -> Sound:
    R = _turn((0.0, 0.0, 1.0), float(rng.uniform(20, 340)))
    return _rigid(R, rng.uniform(-3, 3, 3))(sound, rng)


def _names(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    order = [1, 0, *range(2, len(d.markers))]
    return replace(d, before=d.before[:, order], after=d.after[:, order])


def _target(sound: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """One target 60 mm off on the tool."""
    off = rng.standard_normal(3)
    off *= 0.06 / np.linalg.norm(off)
    moved = tool_pose(sound.cell.vjm, d.q)[1] @ off
    before, after = d.before.copy(), d.after.copy()
    before[:, -1] += moved
    after[:, -1] += moved
    return replace(d, before=before, after=after)


def _joint(change: Callable[[Array, Array, int], None]) -> Plant:
    def of(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
        q = d.q.copy()
        change(d.q, q, int(rng.integers(1, 5)))
        return replace(d, q=q)

    return _data(of)


def _zero(_: Array, q: Array, k: int) -> None:
    q[:, k] += np.deg2rad(1.5)


def _reversed(_: Array, q: Array, k: int) -> None:
    q[:, k] *= -1


def _exchanged(was: Array, q: Array, k: int) -> None:
    q[:, k], q[:, k + 1] = was[:, k + 1], was[:, k]


def _shifted(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    own = d.runs // len(np.unique(d.pose))
    return replace(d, before=np.roll(d.before, own, axis=0), after=np.roll(d.after, own, axis=0))


def _one_pose(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """One joint angle of one pose 0.15 rad off."""
    q, pose = d.q.copy(), rng.choice(d.pose)
    q[d.pose == pose, int(rng.integers(1, 4))] += 0.15
    return replace(d, q=q)


def _one_reading(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """One unloaded reading 2 mm off."""
    before = d.before.copy()
    before[int(rng.integers(d.runs)), int(rng.integers(len(d.markers)))] += _bump(rng, 2e-3)
    return replace(d, before=before)


def _bump(rng: np.random.Generator, size: float) -> Array:
    direction = rng.standard_normal(3)
    return np.asarray(size * direction / np.linalg.norm(direction))


def _equal(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, after=d.before)


def _equal_once(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    after, r = d.after.copy(), int(rng.integers(d.runs))
    after[r] = d.before[r]
    return replace(d, after=after)


def _swapped(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, before=d.after, after=d.before)


def _swapped_once(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    before, after = d.before.copy(), d.after.copy()
    r = int(np.argmax(np.linalg.norm(d.deflection, axis=2).max(axis=1)))
    before[r], after[r] = d.after[r], d.before[r]
    return replace(d, before=before, after=after)


def _after_shifted(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, after=np.roll(d.after, d.runs // len(np.unique(d.pose)), axis=0))


def _copied(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    after, poses = d.after.copy(), np.unique(d.pose)
    first, other = rng.choice(poses, 2, replace=False)
    after[np.flatnonzero(d.pose == first)[0]] = d.after[np.flatnonzero(d.pose == other)[0]]
    return replace(d, after=after)


def _after_mm(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, after=1e3 * d.after)


def _tracker_moved(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """The tracker's stand is touched between the two readings: 3 mm and 1 mrad."""
    x, y, z = rng.standard_normal(3)
    R, shift, after = _turn((x, y, z), np.rad2deg(1e-3)), _bump(rng, 3e-3), d.after.copy()
    own = np.ones(d.runs, dtype=bool) if d.station is None else d.station == d.station[0]
    centre = after[own].reshape(-1, 3).mean(axis=0)
    after[own] = (after[own] - centre) @ R.T + centre + shift
    return replace(d, after=after)


def _touched(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    after = d.after.copy()
    after[int(rng.integers(d.runs)), int(rng.integers(len(d.markers)))] += _bump(rng, 2e-3)
    return replace(d, after=after)


def _slipped(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    after = d.after.copy()
    after[int(rng.integers(d.runs))] += _bump(rng, 2e-3)
    return replace(d, after=after)


def _wrench(change: Callable[[Sound, Array, np.random.Generator], Array]) -> Plant:
    def of(sound: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
        return replace(d, wrench=change(sound, d.wrench.copy(), rng))

    return _data(of)


def _times(factor: float) -> Plant:
    return _wrench(lambda _, w, __: factor * w)


def _offset(sound: Sound, w: Array, rng: np.random.Generator) -> Array:
    """A force sensor 6.6 % of the payload's weight off: 300 N on the KR 500."""
    w[:, int(rng.integers(3))] += rng.choice([-1, 1]) * 0.0664 * GRAVITY * PAYLOAD[sound.cell.arm.name]
    return w


def _tool_axes(sound: Sound, d: Dataset, _: np.random.Generator) -> Dataset:
    w = d.wrench.copy()
    w[:, :3] = np.einsum("ryx,ry->rx", tool_pose(sound.cell.vjm, d.q)[1], w[:, :3])
    return replace(d, wrench=w)


def _other_axis(_: Sound, w: Array, __: np.random.Generator) -> Array:
    w[:, [0, 2]] = w[:, [2, 0]]
    return w


def _one_level(_: Sound, w: Array, __: np.random.Generator) -> Array:
    force = np.linalg.norm(w, axis=1)
    w[force > 0.99 * force.max()] *= 0.8
    return w


def _level_order(_: Sound, w: Array, __: np.random.Generator) -> Array:
    return np.ascontiguousarray(w.reshape(-1, 3, 6)[:, ::-1].reshape(-1, 6))


def _one_run(_: Sound, w: Array, rng: np.random.Generator) -> Array:
    w[int(rng.integers(len(w)))] *= 0.5
    return w


def _point(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    return replace(d, point=d.point + _bump(rng, 0.3))


def _point_mm(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, point=1e3 * (d.point + 0.05))


def _sigma(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, sigma=d.sigma / 20)


def _folder(factor: float) -> Plant:
    def plant(sound: Sound, _: np.random.Generator) -> Sound:
        return replace(sound, prior=Prior(f"{sound.prior.name}, wrong", factor * sound.prior.C_theta))

    return plant


def _longer(sound: Sound, _: np.random.Generator) -> Sound:
    """Another arm's folder: one of its links is 150 mm longer."""
    vjm, placements = sound.cell.vjm, sound.cell.vjm.placements.copy()
    placements[2, :3, 3] *= 1 + 0.15 / np.linalg.norm(placements[2, :3, 3])
    return replace(sound, cell=replace(sound.cell, vjm=replace(vjm, placements=placements)))


def _in_base(sound: Sound) -> bool:
    return not sound.tracker


def _several(sound: Sound) -> bool:
    return len(sound.data.markers) > 1


def _levels(sound: Sound) -> bool:
    return sound.loads == "levels"


def _not_one(sound: Sound) -> bool:
    return sound.loads != "hung"


FAULTS: Mapping[str, Fault] = {
    "frame_tilted": Fault(
        "frame turned 4 deg about a tilted axis",
        _rigid(_turn((0.6, 0.8, 0.3), 4), np.zeros(3)),
        ("frame",),
        _in_base,
    ),
    "frame_turned": Fault(
        "frame turned 4 deg about the vertical",
        _rigid(_turn((0, 0, 1), 4), np.zeros(3)),
        ("frame", "joint_zero"),
        _in_base,
    ),
    "frame_moved": Fault(
        "frame 110 mm away", _rigid(np.eye(3), np.array([0.1, -0.05, 0.0])), ("frame",), _in_base
    ),
    "tracker_frame": Fault("readings in the tracker's frame", _random_frame, ("frame",), _in_base),
    "mirrored": Fault("sign of y", _rigid(np.diag([1.0, -1, 1]), np.zeros(3)), ("mirrored",)),
    "axes": Fault("x, y, z are y, z, x", _rigid(np.eye(3)[[1, 2, 0]], np.zeros(3)), ("frame",), _in_base),
    "millimetres": Fault("millimetres as metres", _units(1e3), ("unit",)),
    "inches": Fault("inches as metres", _units(1 / 0.0254), ("unit",)),
    "names": Fault("two targets' names exchanged", _data(_names), ("markers",), _several),
    "target": Fault("a target 60 mm off on the tool", _data(_target), ("targets",), _in_base),
    "joint_zero": Fault("a joint's zero 1.5 deg off", _joint(_zero), ("joint_zero",)),
    "joint_sign": Fault("a joint's sign", _joint(_reversed), ("joint_sign",)),
    "joint_order": Fault("two joints exchanged", _joint(_exchanged), ("joint_order",)),
    "order": Fault("readings of the pose before", _data(_shifted), ("order",)),
    "one_pose": Fault("a joint angle of one pose 0.15 rad off", _data(_one_pose), ("pose",)),
    "one_reading": Fault("an unloaded reading 2 mm off", _data(_one_reading), ("reading", "run"), _several),
    "longer": Fault("another arm's folder, a link 150 mm longer", _longer, ("link",)),
    "equal": Fault("after equals before", _data(_equal), ("equal",)),
    "equal_once": Fault("after equals before in one run", _data(_equal_once), ("equal",)),
    "swapped": Fault("before and after exchanged", _data(_swapped), ("sign",)),
    "swapped_once": Fault(
        "before and after exchanged in one run", _data(_swapped_once), ("run", "run_load", "reading")
    ),
    "after_order": Fault("loaded readings of the pose before", _data(_after_shifted), ("order",)),
    "copied": Fault("loaded readings of another pose in one run", _data(_copied), ("repeated",)),
    "after_unit": Fault("loaded readings in millimetres", _data(_after_mm), ("unit",)),
    "tracker_moved": Fault(
        "tracker touched between the readings: 3 mm, 1 mrad", _data(_tracker_moved), ("tracker_moved",)
    ),
    "touched": Fault("a target touched in one run: 2 mm", _data(_touched), ("reading", "run"), _several),
    "slipped": Fault("the tool slipped in one run: 2 mm", _data(_slipped), ("run", "reading"), _several),
    "kilograms": Fault("forces in kg", _times(1 / GRAVITY), ("scale",)),
    "kilonewtons": Fault("forces in kN", _times(1e-3), ("scale",)),
    "comma": Fault("forces ten times too large", _times(10.0), ("scale",)),
    "force_sign": Fault("sign of the forces", _times(-1.0), ("sign",)),
    "force_zero": Fault(
        "force sensor 6.6 % off, 300 N on a KR 500", _wrench(_offset), ("force_offset",), _not_one
    ),
    "force_axis": Fault("force along x instead of z", _wrench(_other_axis), ("force_axes",)),
    "tool_axes": Fault("forces in the tool's axes", _data(_tool_axes), ("force_axes",)),
    "payload": Fault("one of three loads 20 % off", _wrench(_one_level), ("level",), _levels),
    "load_order": Fault("three loads in reversed order", _wrench(_level_order), ("levels",), _levels),
    "one_load": Fault("a load stated as half in one run", _wrench(_one_run), ("run_load",)),
    "load_point": Fault("load point 300 mm off", _data(_point), ("load_point",)),
    "point_unit": Fault("load point in millimetres", _data(_point_mm), ("load_point",)),
    "noise": Fault("noise stated 20 times too small", _data(_sigma), ("noise",)),
    "soft_folder": Fault("folder ten times too soft", _folder(10.0), ("scale",)),
    "stiff_folder": Fault("folder ten times too stiff", _folder(0.1), ("scale",)),
}
"""Mistakes by name."""
