"""An arm looked at as a whole: what must be confirmed, by its effect on the sag, and what may be wrong."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.arm.elastic import ElasticDocument, LinkEntry, read_elastic
from testbench.arm.folder import find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array, BenchError, Doubt
from testbench.model.vjm import Vjm, body_poses, evaluate_chain, generalised_load
from testbench.plant.shapes import UNIT_CIRCLE
from testbench.runs.rows import trial_rng
from testbench.workflows.cell import Cell, build_cell, check_agreement
from testbench.workflows.rows import rms

# --- Plausibility of an arm that can be read: the tool's sag under the payload, and likely mistakes ---------

DRAWN_POSES = 96  #: Poses drawn over the joint limits.
#: Clear ones of them; with fewer all count, for the collision shapes do not say which are.
MIN_CLEAR_POSES = 16
FULL_ROTATION = np.pi  #: A joint that turns farther than once is drawn over one turn [rad].
LENGTH = 2.0  #: Of a tube over the distance of its joints, or the other way round [1].
CLOSE = 0.1  #: Distances below this share of the reach say nothing [1].
ANGLE = 45.0  #: Between a beam axis and the way to the next joint [deg].
THICK = 3.0  #: Diameter over length of a tube [1].
MAX_DIAMETER_RATIO = 2.0  #: Diameter of a tube over the width of the drawn link [1].
NEIGHBOURS = 100.0  #: Compliance of a joint over that of the next one [1].
SAGS = 1e-4, 0.03  #: Median deflection of a tool under the rated payload [m].
BEHIND = 0.02  #: Distance of a point behind the flange over the reach [1].
INSIDE = 0.05  #: The same of a tool behind the end of the last link; one between fingers lies there [1].
MAX_POINT_DISTANCE = 0.5  #: Distance of a point of the tool from its origin over the reach [1].
MASS = 0.5, 500.0  #: Of an arm over the cube of its reach [kg/m^3].
NOTHING = 1e-4  #: Mass of a link over that of the arm [1].
ALL = 0.8  #: The same [1].
UPRIGHT = 2.0  #: Angle of the first turning joint against the vertical [deg].
COINCIDE = 0.02
"""Distance of joints below which they coincide, as a share of the reach [1]."""
PARALLEL = 0.1
"""Sine of the angle below which two directions count as parallel [1]."""
FLAT = 0.05  #: Markers on a line: their spread across it is less than this share of that along it [1].
PAYLOAD_OFF = 3.0  #: A guess of a payload misses one arm in ten by more than this factor [1].


@dataclass(frozen=True)
class ToolSag:
    """Hold deflections of the tool under a hung weight, linear and without the arm's own weight."""

    q: Array  #: Poses, (poses, n) [rad, m].
    parts: Array  #: What each link, then each joint, moves the tool, (parts, poses, 3) [m/kg].
    turn: Array  #: Rotation of the tool, (poses, 3) [rad/kg].

    @cached_property
    def whole(self) -> Array:
        """Sum up the deflection, (poses, 3) [m/kg]."""
        return np.asarray(self.parts.sum(axis=0))

    @cached_property
    def size(self) -> Array:
        """Compute the length of the deflection, (poses,) [m/kg]."""
        return np.asarray(np.linalg.norm(self.whole, axis=1))

    @cached_property
    def shares(self) -> Array:
        """Compute the share of each link, then each joint, along the deflection, all poses, (parts,) [1]."""
        along = np.einsum("kpx,px->k", self.parts, self.whole)
        return np.asarray(along / along.sum())


def tool_sag(cell: Cell) -> ToolSag:
    """Compute the sag of an arm per kilogram of payload, at poses drawn evenly over its joint limits."""
    q = work_area(cell)
    where, n = evaluate_chain(cell.vjm, q), len(q)
    wrench = np.tile([0, 0, -GRAVITY, 0, 0, 0], (n, 1))
    load = generalised_load(where, wrench, np.tile(cell.vjm.load_point, (n, 1)))
    theta = cell.arm.C_theta @ load
    links = 6 * len(cell.arm.links)
    parts = [
        *(slice(k, k + 6) for k in range(0, links, 6)),
        *(slice(k, k + 1) for k in range(links, len(theta))),
    ]
    moved = [np.einsum("xtp,tp->px", where.J_theta[:3, own], theta[own]) for own in parts]
    return ToolSag(q, np.array(moved), np.einsum("xtp,tp->px", where.J_theta[3:], theta))


def work_area(cell: Cell) -> Array:
    """Draw poses over the joint limits, clear of collision where shapes can tell, (poses, n) [rad, m]."""
    from testbench.plant.rigid_cell import collision_free

    (lower, upper), turning = cell.arm.limits, cell.arm.hinges
    lower = np.where(turning, np.maximum(lower, np.minimum(upper - FULL_ROTATION, -FULL_ROTATION)), lower)
    upper = np.where(turning, np.minimum(upper, np.maximum(lower + FULL_ROTATION, FULL_ROTATION)), upper)
    q = cell.arm.with_dependent_joints(trial_rng(0).uniform(lower, upper, (DRAWN_POSES, cell.arm.n_joints)))
    clear = q[collision_free(cell.room, q)]
    return np.asarray(clear if len(clear) >= MIN_CLEAR_POSES else q)


@dataclass(frozen=True, eq=False)
class Checked:
    """Hold an arm and what is found of it."""

    cell: Cell  #: The arm.
    elastic: ElasticDocument  #: Its elastic.toml, with the origin of every number.
    sag: ToolSag  #: Of its tool over the work area.

    @property
    def vjm(self) -> Vjm:
        """Return its kinematics."""
        return self.cell.vjm

    @cached_property
    def apart(self) -> float:
        """Compute the largest distance between the two readings of it [m]."""
        return check_agreement(self.vjm, self.cell.plant)

    @cached_property
    def items(self) -> list["Item"]:
        """List what to confirm, the largest effect first."""
        return to_confirm(self)

    @cached_property
    def doubts(self) -> list[Doubt]:
        """List what may be wrong."""
        return arm_warnings(self)

    @cached_property
    def poses(self) -> Array:
        """Choose two poses to draw, (2, n) [rad, m]: zero, or as near as limits let, and that of median sag.

        A first joint about the vertical does not change the sag: both poses have it at the same angle.
        """
        zero = self.cell.arm.clip_to_limits(np.zeros(self.cell.arm.n_joints))
        middle = int(np.argsort(self.sag.size)[len(self.sag.size) // 2])
        poses = np.array([zero, self.sag.q[middle]])
        turning, tilt, _ = base_stance(self.cell)
        if turning == 0 and tilt <= UPRIGHT:
            poses[1, 0] = poses[0, 0]
        return self.cell.arm.with_dependent_joints(poses)

    @cached_property
    def worst(self) -> int:
        """Return the pose of the largest sag."""
        return int(np.argmax(self.sag.size))

    @property
    def beams(self) -> Array:
        """Compute where each link's beam begins and how it lies, in both poses, (2, n + 1, 4, 4) [m]."""
        found = np.tile(np.eye(4), (2, len(self.cell.arm.links), 1, 1))
        bodies = body_poses(self.vjm, self.poses)
        for k, (link, (p, R)) in enumerate(zip(self.cell.arm.links, bodies, strict=False)):
            found[:, k, :3, :3], found[:, k, :3, 3] = R @ link.beam_axes, p
        return found

    @property
    def sizes(self) -> Array:
        """Return length and outer diameter of each tube; of a link without one its way, (n + 1, 2) [m]."""
        tubes, ways = [link.tube for link in self.elastic.link], self.vjm.body_offsets
        return np.array(
            [
                (t.length.value, t.outer_diameter.value) if t else (np.linalg.norm(way), 0.0)
                for t, way in zip(tubes, ways, strict=True)
            ]
        )

    @property
    def tube_lines(self) -> tuple[Array, Array]:
        """Compute where the lines that draw the tubes begin and end, in both poses, (2, k, 3) [m]."""
        beams, (length, diameter) = self.beams, self.sizes.T
        start, along = beams[..., :3, 3], beams[..., :3, 0] * length[:, None]
        rings = 0.5 * diameter[:, None, None] * UNIT_CIRCLE[:, :2]  # (tubes, p, 2)
        near = start[:, :, None] + np.einsum("rkxy,kpy->rkpx", beams[..., :3, 1:3], rings)
        far, step = near + along[:, :, None], len(UNIT_CIRCLE) // SPOKES
        lines = (
            (near, np.roll(near, -1, axis=2)),
            (far, np.roll(far, -1, axis=2)),
            (near[:, :, ::step], far[:, :, ::step]),
        )
        begin, end = (
            np.concatenate([x.reshape(2, -1, 3) for x in ends], axis=1) for ends in zip(*lines, strict=True)
        )
        return begin, end

    @property
    def bending(self) -> Array:
        """Compute virtual joints under the payload, a kilogram if it is not stated, (2, n_theta) [m, rad]."""
        arm, q = self.cell.arm, self.poses
        force = np.array([0, 0, -GRAVITY * (arm.payload or 1.0), 0, 0, 0])
        load = np.tile(force, (len(q), 1)), np.tile(self.vjm.load_point, (len(q), 1))
        return np.asarray((arm.C_theta @ generalised_load(evaluate_chain(self.vjm, q), *load)).T)

    def doubted(self, name: str) -> bool:
        """Tell whether a doubt is about a link, joint or point of that name."""
        said = [doubt.sentence for doubt in self.doubts]
        return any(s.startswith(f"{name} ") or name in s.partition(":")[0].split(", ") for s in said)


def arm_warnings(looked: Checked) -> list[Doubt]:
    """List everything that looks wrong, the geometry first."""
    looks = {
        "tube length": _tube_lengths,
        "beam axis": _beam_axes,
        "tube diameter": _diameters,
        "joint compliance": _neighbours,
        "sag": _sags,
        "payload": _payloads,
        "points of the tool": _points,
        "flange": _behind,
        "mass": _masses,
        "base": _base,
    }
    return [Doubt(name, sentence) for name, look in looks.items() for sentence in look(looked)]


def _tube_lengths(arm: Checked) -> Iterator[str]:
    """A tube as long as the way to the next joint."""
    for link, step in zip(arm.elastic.link, arm.vjm.body_offsets, strict=True):
        if link.tube is not None:
            length, distance = link.tube.length.value, float(np.linalg.norm(step))
            if distance < length <= link.tube.outer_diameter.value:
                continue  # a stub, where joints meet in one point
            small, large = sorted((length, distance))
            if large > LENGTH * small and large - small > CLOSE * arm.vjm.reach:
                yield f"{link.name}: its tube is {length:.3g} m long, its frames are {distance:.3g} m apart"


def _beam_axes(arm: Checked) -> Iterator[str]:
    """A beam that points to the next joint."""
    for link, step in zip(arm.cell.arm.links, arm.vjm.body_offsets, strict=True):
        distance = float(np.linalg.norm(step))
        if distance > CLOSE * arm.vjm.reach:
            cosine = float(np.clip(link.beam_axes[:, 0] @ step / distance, -1, 1))
            angle = np.rad2deg(np.arccos(cosine))
            if angle > ANGLE:
                way = f"{distance:.3g} m away"
                yield f"{link.name}: its beam axis points {angle:.0f} deg off the next frame, {way}"


def _diameters(arm: Checked) -> Iterator[str]:
    """A tube neither a disc nor thicker than the link is drawn."""
    widths = {
        k: float(np.ptp(own @ arm.cell.arm.links[k].beam_axes[:, 1:], axis=0).max())
        for k, own in _drawn(arm.cell).items()
    }
    for k, link in enumerate(arm.elastic.link):
        if link.tube is None:
            continue
        outer, length = link.tube.outer_diameter.value, link.tube.length.value
        if outer > THICK * length:
            yield f"{link.name}: its tube is {outer:.3g} m thick and {length:.3g} m long"
        if k in widths and outer > MAX_DIAMETER_RATIO * widths[k]:
            yield f"{link.name}: its tube is {outer:.3g} m thick, its drawn shape {widths[k]:.3g} m wide"


def _drawn(cell: Cell) -> dict[int, Array]:
    """Corners of every link that is drawn, in its frame, (c, 3) [m]."""
    from testbench.plant.shapes import hull_points, mjcf_visual_shapes

    names = cell.room.body_names
    shapes = mjcf_visual_shapes(cell.room)
    found = {}
    for k, link in enumerate(cell.arm.links):
        own = [hull_points(shape) for shape in shapes if names[shape.body] == link.name]
        if own:
            found[k] = np.concatenate(own)
    return found


def _neighbours(arm: Checked) -> Iterator[str]:
    """Joints of one kind whose compliances are of one class."""
    for a, b in pairwise(arm.elastic.joint):
        if a.compliance.unit != b.compliance.unit:
            continue
        soft, hard = sorted((a, b), key=lambda joint: -joint.compliance.value)
        ratio = soft.compliance.value / hard.compliance.value
        if ratio > NEIGHBOURS:
            yield f"{soft.name} is {ratio:.3g} times as soft as its neighbour {hard.name}"


def _sags(arm: Checked) -> Iterator[str]:
    """A rated payload that moves the tool by what arms do."""
    payload, (low, high) = arm.cell.arm.payload, SAGS
    if payload is not None:
        moved = payload * float(np.median(arm.sag.size))
        if not low <= moved <= high:
            expected = f"{1e3 * low:g} to {1e3 * high:g} mm"
            size = f"{1e3 * moved:.3g} mm (median over the poses)"
            yield f"its {payload:g} kg move the tool by {size}, expected {expected}"


def _payloads(arm: Checked) -> Iterator[str]:
    """A payload that somebody has stated."""
    payload = arm.elastic.payload
    if payload is not None and payload.origin == "estimated":
        off = f"one in ten such estimates is wrong by more than a factor of {PAYLOAD_OFF:g}"
        yield f"its payload of {payload.value:g} kg is only estimated ({off}): enter the rated one"


def _behind(arm: Checked) -> Iterator[str]:
    """Tool beyond the last link as drawn; load point and markers beyond its end, or the tool in it."""
    vjm, links = arm.vjm, arm.cell.arm.links
    if len(links) == 1:
        return
    com = arm.cell.room.model.body(links[-1].name).ipos
    way = flange_axis(
        vjm.joint_axes[-1], vjm.joint_placements[-1], vjm.tool_placement, com, COINCIDE * vjm.reach
    )
    tool, end = float(vjm.body_offsets[-1] @ way), 0.0
    if (drawn := _drawn(arm.cell).get(len(links) - 1)) is not None:
        end = float((drawn @ way).max())
    if end - tool > INSIDE * vjm.reach:
        inside = f"inside {links[-1].name} as drawn, {1e3 * (end - tool):.0f} mm from its end"
        yield f"{arm.cell.arm.tool} is {inside}: is that where the tool is?"
    names = arm.cell.arm.load_point, *arm.cell.arm.markers
    for name, place in zip(names, (vjm.load_point, *vjm.markers), strict=True):
        hidden = min(tool, end) - tool - float(way @ vjm.tool_placement[:3, :3] @ place)
        if hidden > BEHIND * vjm.reach:
            yield f"{name} is {1e3 * hidden:.0f} mm behind the flange: is that where it is on the tool?"


def _points(arm: Checked) -> Iterator[str]:
    """Load point and markers near the tool, markers not on a line."""
    vjm, names = arm.vjm, arm.cell.arm.markers
    for name, place in zip((arm.cell.arm.load_point, *names), (vjm.load_point, *vjm.markers), strict=True):
        distance = float(np.linalg.norm(place))
        if distance > MAX_POINT_DISTANCE * arm.vjm.reach:
            yield f"{name} is {distance:.3g} m from the tool, but the arm reaches only {arm.vjm.reach:.3g} m"
    if len(names) > 1 and on_a_line(vjm.markers):
        yield f"markers {', '.join(names)} lie on a line, so the readings do not determine a turn about it"


def _masses(arm: Checked) -> Iterator[str]:
    """Links that weigh something, an arm that weighs as arms of its size do."""
    model = arm.cell.room.model
    weights = np.array([model.body(link.name).mass[0] for link in arm.cell.arm.links])
    whole, (low, high) = float(weights.sum()), MASS
    if not low <= whole / arm.vjm.reach**3 <= high:
        expected = " to ".join(_kg(limit * arm.vjm.reach**3) for limit in MASS)
        yield f"its links weigh {_kg(whole)} at a reach of {arm.vjm.reach:.3g} m, expected {expected}"
    yield from _densities(arm.cell, weights)
    for link, mass in zip(arm.cell.arm.links[1:], weights[1:], strict=True):
        if mass < NOTHING * whole:
            yield f"{link.name} weighs only {_kg(mass)} of the arm's {_kg(whole)}"
        elif mass > ALL * whole and len(weights) > 3:
            yield f"{link.name} weighs {_kg(mass)} of the arm's {_kg(whole)}"


def _kg(mass: float) -> str:
    """Format a mass for a sentence: "0.35 kg", "19,080 kg"."""
    return f"{mass:,.0f} kg" if mass >= 100 else f"{mass:.3g} kg"


def _densities(cell: Cell, weights: Array) -> Iterator[str]:
    """Masses that fit the hulls of what collides, as far as the links have them."""
    from testbench.plant.shapes import PLAUSIBLE_DENSITY, collision_shapes, hull_volume

    names, volumes = cell.room.body_names, dict.fromkeys((link.name for link in cell.arm.links), 0.0)
    for shape in collision_shapes(cell.room):
        if names[shape.body] in volumes:
            volumes[names[shape.body]] += hull_volume(shape)
    volume = np.array(list(volumes.values()))
    mass, (low, high) = float(weights[volume > 0].sum()), PLAUSIBLE_DENSITY
    if volume.any() and not low <= mass / volume.sum() <= high:
        inside = f"the arm's {_kg(mass)} give {mass / volume.sum():.0f} kg/m^3 in its collision shapes"
        yield f"{inside}, expected {low:g} to {high:g}"


def _base(arm: Checked) -> Iterator[str]:
    """A base that stands upright: gravity acts along the world's -z."""
    turning, tilt, below = base_stance(arm.cell)
    weight = "Weight acts along the world's -z"
    if turning is None:
        return
    if tilt > UPRIGHT:
        yield f"the first turning joint is {tilt:.0f} deg off the vertical: is the base tilted? {weight}"
    elif below > CLOSE * arm.vjm.reach:
        yield f"the arm hangs {below:.2g} m below its base: is it overhead? {weight}"


def base_stance(cell: Cell) -> tuple[int | None, float, float]:
    """Find the first hinge, its angle against the vertical [deg], and how far the arm hangs then [m]."""
    turning = next((k for k, joint in enumerate(cell.arm.joints) if not joint.prismatic), None)
    if turning is None:
        return None, 0.0, 0.0
    bodies = body_poses(cell.vjm, np.zeros((1, cell.arm.n_joints)))
    axis = bodies[turning + 1][1][0] @ cell.vjm.joint_axes[turning]
    tilt = float(np.rad2deg(np.arccos(min(1.0, abs(axis[2])))))
    return turning, tilt, float(bodies[0][0][0, 2] - bodies[turning + 2][0][0, 2])


def flange_axis(axis: Array, pose: Array, tool: Array, com: Array, least: float) -> Array:
    """Find the direction of the flange: along the last joint's axis, away from the joint before.

    If the joints coincide, it points to the tool; if the tool coincides too, along the axis of its frame that
    is parallel to the joint's; else to the part's mass.

    Args:
        axis: Axis of the last joint, in its part, (3,) [1].
        pose: Pose of the part in the one before, (4, 4) [m].
        tool: Pose of the tool in the part, (4, 4) [m].
        com: Centre of mass of the part, (3,) [m].
        least: Distance below which points coincide [m].

    Returns:
        Unit vector, (3,) [1].
    """
    way, distance = tool[:3, 3], float(np.linalg.norm(tool[:3, 3]))
    sides = [float(axis @ pose[:3, :3].T @ pose[:3, 3]), float(axis @ way)]
    side = next((s for s in sides if abs(s) > least), 0.0)
    if not side and distance > least:  # the last joint turns across
        return np.asarray(way / distance)
    if not side:
        along = tool[:3, :3].T @ axis
        side = float(along[np.abs(along).argmax()])
        side = side if abs(side) > 1 - PARALLEL else float(axis @ com)
    return axis if side >= 0 else -axis


def on_a_line(positions: Array) -> bool:
    """Tell whether markers, (m, 3) [m], are fewer than three or lie on a line."""
    if len(positions) < 3:
        return True
    along, across, *_ = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return bool(across <= FLAT * along)


# --- An arm looked at as a whole: what must be confirmed, by its effect on the sag, and what may be wrong ---

UNSURE = ("estimated", "assumed")  #: Origins that want to be confirmed.
SPOKES = 4  #: Lines along a drawn tube.
ASIDE, OF_ASIDE = 0.01, "effect if it is 10 mm elsewhere"
"""A point is moved so far to see what hangs on it [m]."""


class Item(NamedTuple):
    """Hold a number, or the numbers of one tube, to be confirmed."""

    share: float  #: Of the sag that hangs on it [1].
    words: str  #: What it is, its value, where it comes from.


def to_confirm(arm: Checked) -> list[Item]:
    """List everything estimated or assumed, the largest effect on the tool's deflection first."""
    return sorted([*_numbers(arm), *_point_items(arm)], key=lambda item: -item.share)


def _numbers(arm: Checked) -> Iterator[Item]:
    """Payload, compliances of joints, tubes of links."""
    elastic = arm.elastic
    payload = arm.elastic.payload
    shares = arm.sag.shares.tolist()
    if payload is None:
        yield Item(1.0, "payload, not stated: the deflection is proportional to it")
    elif payload.origin in UNSURE:
        yield Item(
            1.0, f"payload {payload.value:g} kg, {payload.origin}: the deflection is proportional to it"
        )
    for joint, share in zip(elastic.joint, shares[len(elastic.link) :], strict=True):
        c = joint.compliance
        if c.origin in UNSURE:
            yield Item(share, f"{joint.name}'s compliance {1e6 * c.value:.3g} u{c.unit}, {c.origin}")
    for link, share in zip(elastic.link, shares, strict=False):
        if words := _tube(link):
            yield Item(share, f"{link.name}'s {words}")


def known_share(arm: Checked) -> float:
    """Compute the share of the deflection that comes from published, measured or inferred numbers [1]."""
    joints = [joint.compliance.origin in UNSURE for joint in arm.elastic.joint]
    unsure = np.array([*(bool(_tube(link)) for link in arm.elastic.link), *joints])
    return float(arm.sag.shares[~unsure].sum())


def _tube(link: LinkEntry) -> str:
    """What of a link is unsure, empty where nothing is."""
    if link.compliance is not None:
        return f"compliance, {link.compliance.origin}" if link.compliance.origin in UNSURE else ""
    assert link.tube is not None  # load_arm has seen one of the two
    t = link.tube
    outer, inner = 1e3 * t.outer_diameter.value, 1e3 * t.inner_diameter.value
    origins = {
        f"length {1e3 * t.length.value:.0f} mm": t.length.origin,
        f"tube diameters {outer:.0f}/{inner:.0f} mm": t.outer_diameter.origin,
        f"E {1e-9 * t.youngs_modulus.value:.0f} GPa": t.youngs_modulus.origin,
    }
    unsure = {words: origin for words, origin in origins.items() if origin in UNSURE}
    if not unsure:
        return ""
    return f"{', '.join(unsure)}, {' and '.join(sorted(set(unsure.values())))}"


def _point_items(arm: Checked) -> Iterator[Item]:
    """Load point and markers: what 10 mm aside change."""
    elastic = arm.elastic
    cell = arm.cell
    names = arm.elastic.to_confirm
    if elastic.load in names:
        # largest change of the sag as the load point moves along an axis of the tool
        moved = [replace(cell.vjm, load_point=cell.vjm.load_point + ASIDE * axis) for axis in np.eye(3)]
        most = max(rms(tool_sag(replace(cell, vjm=vjm)).whole - arm.sag.whole) for vjm in moved)
        yield Item(most / rms(arm.sag.whole), f"load point {elastic.load}, estimated: {OF_ASIDE}")
    asked = [name for name in elastic.markers if name in names]
    if asked:
        # a marker moves with the tool's turn too, and all the more the farther off it is
        share = ASIDE * rms(arm.sag.turn) / rms(arm.sag.whole)
        yield Item(share, f"markers {', '.join(asked)}, estimated: {OF_ASIDE}")
    if elastic.tool in names:
        yield Item(0.0, f"tool {elastic.tool}, estimated: it matters for tasks, not for readings")


def check(folder: str | Path) -> Checked:
    """Read an arm, look for what must be confirmed and what may be wrong; InputError for a wrong folder."""
    cell = build_cell(folder)
    return Checked(cell, read_elastic(find_arm(folder) / "elastic.toml"), tool_sag(cell))


def refuse_warnings(folder: str | Path, doubts: Sequence[Doubt]) -> None:
    """Refuse an arm's folder, or runs of it, that raise a warning.

    Args:
        folder: Of the arm; its own warnings come first.
        doubts: Of the runs.

    Raises:
        BenchError: Lists all warnings in one line.
    """
    if said := (*check(folder).doubts, *doubts):
        count = "1 warning" if len(said) == 1 else f"{len(said)} warnings"
        raise BenchError(f"--strict: {count}: {'; '.join(doubt.sentence for doubt in said)}")
