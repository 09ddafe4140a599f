"""Mistakes in readings, in poses, and in where the arm and its targets are."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array
from testbench.model.vjm import tool_pose
from testbench.studies.wrong_inputs.fault import Fault, Plant, bump, of_data
from testbench.studies.wrong_inputs.sound import Sound

POSES = 12  #: Of a set-up in which the tracker moves by half a millimetre.


def _rigid(R: Array, t: Array) -> Plant:
    def change(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
        return replace(d, before=d.before @ R.T + t, after=d.after @ R.T + t)

    return of_data(change)


def _turn(axis: tuple[float, float, float], degrees: float) -> Array:
    from scipy.spatial.transform import Rotation

    unit = np.array(axis) / np.linalg.norm(axis)
    return np.asarray(Rotation.from_rotvec(np.deg2rad(degrees) * unit).as_matrix())


def _units(factor: float) -> Plant:
    return of_data(lambda _, d, __: replace(d, before=factor * d.before, after=factor * d.after))


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

    return of_data(of)


def _zero(_: Array, q: Array, k: int) -> None:
    q[:, k] += np.deg2rad(1.5)


def _reversed(_: Array, q: Array, k: int) -> None:
    q[:, k] *= -1


def _exchanged(was: Array, q: Array, k: int) -> None:
    q[:, k], q[:, k + 1] = was[:, k + 1], was[:, k]


def _shifted(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    own = d.runs // len(np.unique(d.pose))
    return replace(d, before=np.roll(d.before, own, axis=0), after=np.roll(d.after, own, axis=0))


def _radians(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, q=np.deg2rad(d.q))


def _names_once(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    before, after, own = d.before.copy(), d.after.copy(), d.pose == rng.choice(d.pose)
    order = [1, 0, *range(2, len(d.markers))]
    before[own], after[own] = d.before[own][:, order], d.after[own][:, order]
    return replace(d, before=before, after=after)


def _one_pose(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """One joint angle of one pose 0.15 rad off."""
    q, pose = d.q.copy(), rng.choice(d.pose)
    q[d.pose == pose, int(rng.integers(1, 4))] += 0.15
    return replace(d, q=q)


def _one_reading(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """One unloaded reading 2 mm off."""
    before = d.before.copy()
    before[int(rng.integers(d.runs)), int(rng.integers(len(d.markers)))] += bump(rng, 2e-3)
    return replace(d, before=before)


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
    R, shift, after = _turn((x, y, z), np.rad2deg(1e-3)), bump(rng, 3e-3), d.after.copy()
    own = _first_station(d)
    centre = after[own].reshape(-1, 3).mean(axis=0)
    after[own] = (after[own] - centre) @ R.T + centre + shift
    return replace(d, after=after)


def _bumped(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    """The tracker moves by 0.5 mm between two poses, three of which at least are before it and behind."""
    own = _first_station(d)
    poses = np.unique(d.pose[own])
    behind = own & (d.pose >= poses[int(rng.integers(3, len(poses) - 2))])
    shift = np.where(behind[:, None, None], bump(rng, 5e-4), 0.0)
    return replace(d, before=d.before + shift, after=d.after + shift)


def _first_station(d: Dataset) -> Mask:
    return np.ones(d.runs, dtype=bool) if d.station is None else np.asarray(d.station == d.station[0])


def _touched(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    after = d.after.copy()
    after[int(rng.integers(d.runs)), int(rng.integers(len(d.markers)))] += bump(rng, 2e-3)
    return replace(d, after=after)


def _slipped(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    after = d.after.copy()
    after[int(rng.integers(d.runs))] += bump(rng, 2e-3)
    return replace(d, after=after)


def _longer(sound: Sound, _: np.random.Generator) -> Sound:
    """Another arm's folder: one of its links is 150 mm longer."""
    vjm, placements = sound.cell.vjm, sound.cell.vjm.placements.copy()
    placements[2, :3, 3] *= 1 + 0.15 / np.linalg.norm(placements[2, :3, 3])
    return replace(sound, cell=replace(sound.cell, vjm=replace(vjm, placements=placements)))


def _in_base(sound: Sound) -> bool:
    return not sound.tracker


def _long(sound: Sound) -> bool:
    """Whether a set-up has the poses that tell a small move of the tracker from errors of the arm."""
    return len(np.unique(sound.data.pose[_first_station(sound.data)])) >= POSES


def _several(sound: Sound) -> bool:
    return len(sound.data.markers) > 1


READINGS: Mapping[str, Fault] = {
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
    "mirrored": Fault("sign of y", _rigid(np.diag([1.0, -1, 1]), np.zeros(3)), ("mirrored",)),
    "axes": Fault("x, y, z are y, z, x", _rigid(np.eye(3)[[1, 2, 0]], np.zeros(3)), ("frame",), _in_base),
    "millimetres": Fault("millimetres as metres", _units(1e3), ("unit",)),
    "inches": Fault("inches as metres", _units(1 / 0.0254), ("unit",)),
    "inches_mm": Fault("inches as millimetres", _units(1 / 25.4), ("unit",)),
    "centimetres": Fault("centimetres as metres", _units(100.0), ("unit",)),
    "radians": Fault("joint angles in radians as degrees", of_data(_radians), ("angle_unit",)),
    "names": Fault("two targets' names exchanged", of_data(_names), ("markers",), _several),
    "target": Fault("a target 60 mm off on the tool", of_data(_target), ("targets",), _in_base),
    "joint_zero": Fault("a joint's zero 1.5 deg off", _joint(_zero), ("joint_zero",)),
    "joint_sign": Fault("a joint's sign", _joint(_reversed), ("joint_sign",)),
    "joint_order": Fault("two joints exchanged", _joint(_exchanged), ("joint_order",)),
    "order": Fault("readings of the pose before", of_data(_shifted), ("order",)),
    "names_once": Fault(
        "two targets' names exchanged in one pose", of_data(_names_once), ("pose",), _several
    ),
    "one_pose": Fault("a joint angle of one pose 0.15 rad off", of_data(_one_pose), ("pose",)),
    "one_reading": Fault("an unloaded reading 2 mm off", of_data(_one_reading), ("reading", "run"), _several),
    "longer": Fault("another arm's folder, a link 150 mm longer", _longer, ("link",)),
    "equal": Fault("after equals before", of_data(_equal), ("equal",)),
    "equal_once": Fault("after equals before in one run", of_data(_equal_once), ("equal",)),
    "swapped": Fault("before and after exchanged", of_data(_swapped), ("sign",)),
    "swapped_once": Fault(
        "before and after exchanged in one run", of_data(_swapped_once), ("run", "run_load", "reading")
    ),
    "after_order": Fault("loaded readings of the pose before", of_data(_after_shifted), ("order",)),
    "copied": Fault("loaded readings of another pose in one run", of_data(_copied), ("repeated",)),
    "after_unit": Fault("loaded readings in millimetres", of_data(_after_mm), ("unit",)),
    "tracker_moved": Fault(
        "tracker touched between the readings: 3 mm, 1 mrad", of_data(_tracker_moved), ("tracker_moved",)
    ),
    "bumped": Fault("tracker moved by 0.5 mm between two poses", of_data(_bumped), ("tracker_moved",), _long),
    "touched": Fault("a target touched in one run: 2 mm", of_data(_touched), ("reading", "run"), _several),
    "slipped": Fault("the tool slipped in one run: 2 mm", of_data(_slipped), ("run", "reading"), _several),
}
"""Mistakes by name."""
