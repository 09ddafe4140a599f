"""Instruments around a cell: which of them read which marker, along which line, and the faces they touch."""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.data.dataset import NOMINAL_FIXED_POINT_DEVIATION, NOMINAL_NORMAL_DEVIATION, Series
from testbench.errors import Array, BenchError, Ids, InputError
from testbench.model.vjm import evaluate_chain, marker_positions, tool_points, translational_jacobian
from testbench.plant.tracker import (
    BALLBAR,
    DRAW_WIRE,
    LONG_BAR,
    DistanceMeter,
    Gauge,
    IsotropicTracker,
    PlaneProbe,
)
from testbench.workflows.cell import Cell

MAX_TOUCH_BATCHES, POSES_PER_BATCH, NEWTON_STEPS = 200, 2000, 8
"""Most draws of poses for a plane, poses of each, and steps that take them onto it."""
CAMERA = IsotropicTracker(100e-6)
"""Photogrammetry of the whole cell; a tenth of a millimetre over some metres is usual [assumed]."""
PROBE = IsotropicTracker(50e-6, 5e-5)
"""A probe of six degrees of freedom: position as a tracker, orientation to about 0.003 degrees [assumed]."""


Instrument = IsotropicTracker | Gauge | DistanceMeter | PlaneProbe  #: What reads a marker.
SIZE = re.compile(r"([0-9.]{1,10})(um|mm|deg)")  #: Of an instrument: noise, unknown constant, or tilt.
BLOCK = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")  #: Name of a block of faces.


@dataclass(frozen=True)
class Mounted:
    """Describe an instrument and what it reads."""

    instrument: Instrument
    marker: str = ""  #: Marker that it reads; "" for all, as trackers do.
    #: Direction that a gauge is said to have, world axes: one for all runs, (3,), or one each, (runs, 3) [1];
    #: zero in runs without the gauge.
    direction: Array | None = None
    on_tool: bool = False  #: Whether the direction is in the tool's axes, so that it turns with the pose.
    #: Where the fixed point of a distance meter is said to be, or a point of a plane, (3,) [m].
    fixed: Array | None = None
    block: str = ""  #: Name of the block of which a plane is a face; "" for a face alone.


KINDS: dict[str, Instrument] = {
    "tracker": IsotropicTracker(50e-6),
    "camera": CAMERA,
    "probe": PROBE,
    "gauge": Gauge(),
    "ballbar": BALLBAR,
    "bar": LONG_BAR,
    "wire": DRAW_WIRE,
    "plane": PlaneProbe(),
}
"""Instruments by name."""
AXES = {
    **dict(zip("xyz", np.eye(3), strict=True)),
    **{f"-{name}": -axis for name, axis in zip("xyz", np.eye(3), strict=True)},
}
"""Directions by name."""
PLANNED = "planned"  #: Instrument that stands for the gauges of a plan.
ON_TOOL = "tool_"  #: Before the name of a direction in the tool's axes.
FORMS = (
    "gauge:MARKER:z, ballbar:MARKER:X,Y,Z, bar:MARKER:X,Y,Z, wire:MARKER:X,Y,Z, plane:MARKER:z:X,Y,Z, "
    "plane:MARKER:z:X,Y,Z:BLOCK, tracker, camera or probe, perhaps with :5um, :0.5deg or :1000mm at the end"
)
"""Forms of an instrument's text."""


def mounted(text: str) -> Mounted:
    """Read an instrument from a text, such as "gauge:P1:z:5um:0.5deg" or "wire:P2:1.5,0,0.2".

    Args:
        text: Kind, marker, direction, fixed point in metres, name of the block of a plane, then sigma in um,
            an unknown constant of distances in mm, and a tilt in deg.

    Returns:
        The instrument.

    Raises:
        BenchError: When the text is none of an instrument.
    """
    kind, *parts = (part.strip() for part in text.split(":"))
    try:
        instrument = KINDS[kind]
        places = [part for part in parts if not SIZE.fullmatch(part)]
        for size in filter(None, map(SIZE.fullmatch, parts)):
            instrument = _with_size(instrument, float(size[1]), size[2])
        if isinstance(instrument, IsotropicTracker):
            [marker] = places or [""]
            return Mounted(instrument, marker)
        marker, *where = places
        direction, on_tool = None, False
        if isinstance(instrument, Gauge | PlaneProbe):
            name = where.pop(0)
            on_tool = name.startswith(ON_TOOL) and isinstance(instrument, Gauge)
            name = name.removeprefix(ON_TOOL) if on_tool else name
            direction = AXES[name] if name in AXES else _vector(name)
        fixed = None if isinstance(instrument, Gauge) else _vector(where.pop(0))
        block = where.pop(0) if where and isinstance(instrument, PlaneProbe) else ""
        if where or (block and not BLOCK.fullmatch(block)) or (direction is not None and not direction.any()):
            raise ValueError
    except (KeyError, ValueError, IndexError):
        raise BenchError(f"--instrument: expected {FORMS}, got {text[:80]!r}") from None
    return Mounted(instrument, marker, direction, on_tool, fixed, block)


def _vector(text: str) -> Array:
    """Read three finite numbers; ValueError for anything else."""
    vector = np.array([*map(float, text.split(","))])
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError
    return vector


def _with_size(instrument: Instrument, value: float, unit: str) -> Instrument:
    """Change noise in um, constant in mm or tilt in deg; ValueError for what the instrument does not have."""
    if unit == "um" and value > 0:
        return replace(instrument, sigma=value / 1e6)
    if unit == "mm" and isinstance(instrument, DistanceMeter):
        return replace(instrument, zero_sigma=value / 1e3)
    if unit == "deg" and isinstance(instrument, Gauge | PlaneProbe):
        return replace(instrument, tilt_sigma=math.radians(value))
    raise ValueError


def _planned_gauges(path: Path, markers: Sequence[str]) -> list[Mounted]:
    """Read the gauges of every pose of a plan, the column `gauges` of plan.csv.

    Args:
        path: The plan.
        markers: Those of the arm.

    Returns:
        One gauge per marker, with a direction in each pose where it is used.

    Raises:
        InputError: When there is no such column, or a cell names no marker and axis.
    """
    with path.open(encoding="utf-8", newline="") as file:
        cells = [row.get("gauges") for row in csv.DictReader(file)]
    direction = np.zeros((len(cells), len(markers), 3))
    for k, cell in enumerate(cells):
        for word in (cell or "").split():
            marker, _, axis = word.partition(":")
            if marker not in markers or axis not in AXES:
                problem = f"expected a marker and an axis such as {markers[0]}:z, got {word[:40]!r}"
                raise InputError(path, f"line {k + 2}, column gauges", problem)
            direction[k, markers.index(marker)] = AXES[axis]
    if not direction.any():
        raise InputError(path, "column gauges", "expected gauges, as `plan --gauges` writes them")
    used = [k for k in range(len(markers)) if direction[:, k].any()]
    return [Mounted(Gauge(), markers[k], direction[:, k]) for k in used]


def instruments(texts: Sequence[str], markers: Sequence[str], plan: Path | None, pose: Ids) -> list[Mounted]:
    """Read instruments from texts; "planned" stands for the gauges of a plan.csv.

    Args:
        texts: One per instrument, see `mounted`.
        markers: Those of the arm.
        plan: The plan; None without one.
        pose: Pose of every run, an index, (runs,).

    Returns:
        The instruments.

    Raises:
        BenchError: When a text is none of an instrument, or there is no plan.
    """
    found = list[Mounted]()
    for text in texts:
        if text != PLANNED:
            found.append(mounted(text))
        elif plan is None:
            raise BenchError(f"--instrument {PLANNED}: expected a plan.csv")
        else:
            gauges = _planned_gauges(plan, markers)
            found += [replace(own, direction=np.asarray(own.direction)[pose]) for own in gauges]
    return found


def check_markers(cell: Cell, mounted: Sequence[Mounted]) -> None:
    """Refuse an instrument of a marker that the arm does not have, by BenchError.

    Args:
        cell: The arm.
        mounted: The instruments.
    """
    for own in mounted:
        if own.marker and own.marker not in cell.arm.markers:
            have = ", ".join(cell.arm.markers)
            raise BenchError(f"instrument: no marker {own.marker!r} in {cell.arm.name}; markers are {have}")


def names_of(mounted: Sequence[Mounted]) -> list[str]:
    """Name fixed points and planes by their place among all instruments, from 1."""
    return [f"{'point' if own.direction is None else 'plane'} {k}" for k, own in enumerate(mounted, 1)]


def blocks_of(mounted: Sequence[Mounted]) -> list[list[int]]:
    """Group planes by the block whose faces they are.

    Args:
        mounted: Distance meters and plane probes.

    Returns:
        Places of the planes of every block; a plane alone is a block by itself.

    Raises:
        BenchError: When a named block has one face.
    """
    blocks: dict[str, list[int]] = {}
    for k, (own, name) in enumerate(zip(mounted, names_of(mounted), strict=True)):
        if own.direction is not None:
            blocks.setdefault(own.block or name, []).append(k)
    for name, members in blocks.items():
        if len(members) == 1 and mounted[members[0]].block:
            raise BenchError(f"--instrument: block {name!r} has one face; expected two or more, or no block")
    return [*blocks.values()]


def distances_of(own: Mounted, bare: Series, read: Array) -> Series:
    """Put what one instrument of distances reads into a series.

    Args:
        own: The instrument.
        bare: Poses, loads and markers.
        read: Distances or heights, (rows,) [m]; NaN for lost ones.

    Returns:
        The series; its other markers are lost.
    """
    assert own.fixed is not None
    normal: tuple[float, float, float] | None = None
    tilt, zero = NOMINAL_NORMAL_DEVIATION, 0.0
    if isinstance(own.instrument, PlaneProbe):
        x, y, z = unit_normal(own).tolist()
        normal, tilt = (x, y, z), max(own.instrument.tilt_sigma, NOMINAL_NORMAL_DEVIATION)
        sigma = math.hypot(own.instrument.sigma, own.instrument.flatness_sigma)
    else:
        assert isinstance(own.instrument, DistanceMeter)
        sigma, zero = own.instrument.sigma, own.instrument.zero_sigma
    seen = np.isfinite(read)[:, None] & np.equal(bare.markers, own.marker)
    return replace(
        bare,
        sigma=sigma,
        precision=None if seen.all() else seen[..., None, None] * np.eye(3) / sigma**2,
        distance=np.where(seen, read[:, None], 0.0),
        fixed_point=tuple(own.fixed.tolist()),
        fixed_point_sigma=max(own.instrument.fixed_point_sigma, NOMINAL_FIXED_POINT_DEVIATION),
        plane_normal=normal,
        plane_normal_sigma=tilt,
        distance_offset_sigma=zero,
    )


def poses_on_planes(cell: Cell, planes: Sequence[Mounted], count: int, rng: np.random.Generator) -> Array:
    """Draw poses in which the rigid arm touches plane faces, one after the other.

    Random poses whose marker is near the face are moved onto it by Newton's method. Those are kept that are
    within the joint limits, on the face, clear of collision, and have the tool in front of the face.

    Args:
        cell: The arm.
        planes: Plane probes.
        count: Number of poses of all planes.
        rng: Source of the poses.

    Returns:
        Actuated joints, (count, n) [rad, m].

    Raises:
        BenchError: When too few are found.
    """
    found = np.empty((count, cell.arm.n_joints))
    for k, own in enumerate(planes):
        found[k :: len(planes)] = touch(cell, own, len(range(k, count, len(planes))), rng)
    return found


def touch(cell: Cell, own: Mounted, count: int, rng: np.random.Generator, least: int | None = None) -> Array:
    """Draw poses in which the rigid arm touches one face.

    Args:
        cell: The arm.
        own: The plane probe.
        count: Number of poses.
        rng: Source of the poses.
        least: Number that suffices where no more are found; None for `count`.

    Returns:
        Actuated joints, `least` to `count` of them, (poses, n) [rad, m].

    Raises:
        BenchError: When fewer are found.
    """
    from testbench.plant.rigid_cell import collision_free  # here: few commands need it

    assert isinstance(own.instrument, PlaneProbe)
    assert own.fixed is not None
    normal = unit_normal(own)
    arm = cell.arm
    points = marker_positions(cell.vjm, (own.marker,))
    kept = list[Array]()
    for _ in range(MAX_TOUCH_BATCHES):
        q = arm.draw_poses(rng, POSES_PER_BATCH)
        off = tool_points(cell.vjm, q, points)[:, 0] - own.fixed
        q = q[np.linalg.norm(off, axis=1) <= own.instrument.face_radius]
        for _ in range(NEWTON_STEPS):
            off = tool_points(cell.vjm, q, points)[:, 0] - own.fixed
            q = moved_along_normal(cell, own, q, off @ normal)
        where = evaluate_chain(cell.vjm, q)
        off = where.tool_points_in_world(points)[:, 0] - own.fixed
        on = (np.abs(off @ normal) < 1e-6) & (np.linalg.norm(off, axis=1) <= own.instrument.face_radius)
        on &= (where.tool_position - own.fixed) @ normal > -1e-6
        on &= ((q >= arm.limits[0]) & (q <= arm.limits[1])).all(axis=1)
        kept.extend(q[on][collision_free(cell.room, q[on])])
        if len(kept) >= count:
            break
    if len(kept) >= (count if least is None else least):
        return np.reshape(kept[:count], (-1, arm.n_joints))
    face = f"the plane at {', '.join(f'{x:g}' for x in own.fixed)} m"
    raise BenchError(f"--instrument: found {len(kept)} of {count} poses that touch {face}; is it in reach?")


def moved_along_normal(cell: Cell, own: Mounted, q: Array, height: Array) -> Array:
    """Move poses by the shortest step of the joints that lowers the marker by a height over the plane.

    Args:
        cell: The arm; a linear step by its rigid model.
        own: The plane probe.
        q: Poses, (poses, n) [rad, m].
        height: Heights, (poses,) [m].

    Returns:
        The poses, (poses, n) [rad, m].
    """
    rows = translational_jacobian(evaluate_chain(cell.vjm, q), marker_positions(cell.vjm, (own.marker,)))
    slope = np.einsum("x,xnr->rn", unit_normal(own), rows[:, cell.vjm.joint_spring_slice])
    return cell.arm.with_dependent_joints(q - slope * (height / (slope**2).sum(axis=1))[:, None])


def unit_normal(own: Mounted) -> Array:
    """Return the unit normal of the plane of a probe, as it is stated, (3,)."""
    normal = np.asarray(own.direction, dtype=float)
    return np.asarray(normal / np.linalg.norm(normal)) + 0.0  # no component is -0
