"""Shapes of the arm: geoms of its rigid MJCF, their surfaces and hulls, and poses of all bodies.

Hulls of meshes are computed by Qhull, not by trimesh, which perturbs flat points until they have a hull.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import mujoco
import numpy as np

from testbench.errors import Array, Ids, Mask, check_array
from testbench.plant.build import Plant
from testbench.plant.rigid_cell import VISUAL_GROUPS, RigidCell

if TYPE_CHECKING:  # it takes long to import, and few commands draw
    from scipy.spatial import ConvexHull

GeomKind = Literal["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]  #: Kinds of geoms.

GEOM_KINDS: dict[int, GeomKind] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}
"""Kinds of geoms that are drawn, by MuJoCo's geom type; planes are not drawn."""

Faces = Ids  #: Corner indices of triangles, (f, 3).
Surface = tuple[Array, Faces]  #: Corners, (v, 3) [m], and triangles of a surface.
#: Area of a triangle over the largest one of its surface, below which it is dropped [1].
MIN_TRIANGLE_AREA_RATIO = 1e-9
#: Radius of the sticks of an arm without visual geoms, over the length of its chain [1].
STICK_RADIUS_RATIO = 0.02


@dataclass(frozen=True)
class Mesh:
    """Hold a triangle mesh with one normal per corner."""

    vertices: Array  #: Corners, (v, 3) [m].
    normals: Array  #: Unit normal of every corner, (v, 3) [1].
    faces: Ids  #: Corner indices of every triangle, (f, 3).


@dataclass(frozen=True)
class Shape:
    """Describe a geom of the arm, fixed in a body: kind, size, pose and colour."""

    kind: GeomKind  #: MuJoCo's geom type.
    body: int  #: MuJoCo's id of its body.
    #: Half sizes along the shape's axes, (3,) [m]; of a capsule or cylinder radius, radius and half length
    #: without caps.
    half_sizes: Array
    centre: Array  #: Position of its centre in the body's frame, (3,) [m].
    rotation: Array  #: Body from shape, (3, 3) [1].
    rgba: Array  #: Red, green, blue and opacity, (4,) [1].
    mesh: Mesh | None = None  #: Mesh in the shape's axes; None for other kinds.


@dataclass(frozen=True)
class BodyFrames:
    """Hold poses of all bodies of the rigid MJCF, in MuJoCo's order: the world itself is first."""

    positions: Array  #: Origins, (runs, bodies, 3) [m].
    rotations: Array  #: World from body, (runs, bodies, 3, 3) [1].


def select_frames(frames: BodyFrames, pose_indices: Ids) -> BodyFrames:
    """Select the frames of all bodies in some of the poses.

    Args:
        frames: Frames of all bodies in all poses.
        pose_indices: Indices of the poses, (k,), in any order; an index may occur more than once.

    Returns:
        Frames of all bodies in these poses.
    """
    return BodyFrames(frames.positions[pose_indices], frames.rotations[pose_indices])


def body_origins(rigid_cell: RigidCell, names: Sequence[str], frames: BodyFrames) -> Array:
    """Return the world positions of the origins of named bodies.

    Args:
        rigid_cell: The rigid cell, for the order of its bodies.
        names: Names of the bodies, k of them.
        frames: Frames of all bodies.

    Returns:
        Origins, world, (runs, k, 3) [m].
    """
    return np.asarray(frames.positions[:, [rigid_cell.body_names.index(name) for name in names]])


def mjcf_visual_shapes(rigid_cell: RigidCell) -> list[Shape]:
    """List the visual geoms of the rigid MJCF; the list is empty if it has none."""
    return _shapes(rigid_cell.model, rigid_cell.model.geom_group < VISUAL_GROUPS)


def visual_shapes(rigid_cell: RigidCell) -> list[Shape]:
    """List the visual geoms of the rigid MJCF, or sticks from body to body if it has none."""
    return mjcf_visual_shapes(rigid_cell) or _sticks(rigid_cell.model)


def collision_shapes(rigid_cell: RigidCell) -> list[Shape]:
    """List the geoms of the rigid MJCF that take part in collisions."""
    return _shapes(rigid_cell.model, rigid_cell.model.geom_contype != 0)


def _shapes(model: mujoco.MjModel, wanted: Mask) -> list[Shape]:
    """List the drawable geoms under a mask, (geoms,)."""
    return [
        _shape(model, g) for g in np.flatnonzero(wanted & np.isin(model.geom_type, list(GEOM_KINDS))).tolist()
    ]


def _shape(model: mujoco.MjModel, g: int) -> Shape:
    """Describe geom g of a MuJoCo model."""
    kind = GEOM_KINDS[int(model.geom_type[g])]
    return Shape(
        kind=kind,
        body=int(model.geom_bodyid[g]),
        half_sizes=half_sizes(kind, model.geom_size[g]),
        centre=model.geom_pos[g].copy(),
        rotation=rotation_from_quaternion(model.geom_quat[g]),
        rgba=geom_rgba(model, g),
        mesh=_mesh(model, int(model.geom_dataid[g])) if kind == "mesh" else None,
    )


def half_sizes(kind: GeomKind, mujoco_size: Array) -> Array:
    """Compute the half sizes of a geom along its axes from MuJoCo's size parameters.

    Args:
        kind: Kind of the geom.
        mujoco_size: MuJoCo's size parameters, (3,) [m].

    Returns:
        Half sizes along x, y and z, (3,) [m]; those of a capsule are without its caps along z.
    """
    places = {"sphere": [0, 0, 0], "capsule": [0, 0, 1], "cylinder": [0, 0, 1]}
    return mujoco_size[places.get(kind, [0, 1, 2])]


def geom_rgba(model: mujoco.MjModel, geom: int) -> Array:
    """Return the colour of a geom, or that of its material if the geom has MuJoCo's default colour.

    Args:
        model: The MuJoCo model.
        geom: Id of the geom.

    Returns:
        Red, green, blue and opacity, (4,) [1].
    """
    material, rgba = int(model.geom_matid[geom]), model.geom_rgba[geom]
    has_own_colour = material < 0 or not np.array_equal(rgba, [0.5, 0.5, 0.5, 1])
    return np.asarray(rgba if has_own_colour else model.mat_rgba[material], dtype=float)


def _mesh(model: mujoco.MjModel, k: int) -> Mesh:
    """Convert a mesh to one normal per corner: corners that share vertex and normal are merged.

    MuJoCo has separate indices for vertices and normals.
    """
    face = slice(model.mesh_faceadr[k], model.mesh_faceadr[k] + model.mesh_facenum[k])
    corners = np.stack([model.mesh_face[face], model.mesh_facenormal[face]], axis=-1).reshape(-1, 2)
    pairs, inverse = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(
        vertices=np.asarray(model.mesh_vert[model.mesh_vertadr[k] + pairs[:, 0]], dtype=float),
        normals=np.asarray(model.mesh_normal[model.mesh_normaladr[k] + pairs[:, 1]], dtype=float),
        faces=np.asarray(inverse, dtype=int).reshape(-1, 3),
    )


def join_meshes(shapes: Sequence[Shape]) -> tuple[Mesh, list[int]]:
    """Join the meshes of one body to one mesh in the body's axes.

    Args:
        shapes: Shapes of the body, at least one with a mesh; those without a mesh are skipped.

    Returns:
        The joined mesh, and the number of vertices of each of its parts.
    """
    pairs = [(shape, shape.mesh) for shape in shapes if shape.mesh is not None]
    counts = [len(mesh.vertices) for _, mesh in pairs]
    first = np.cumsum([0, *counts])
    joined = Mesh(
        vertices=np.concatenate([s.centre + mesh.vertices @ s.rotation.T for s, mesh in pairs]),
        normals=np.concatenate([mesh.normals @ s.rotation.T for s, mesh in pairs]),
        faces=np.concatenate([mesh.faces + first[k] for k, (_, mesh) in enumerate(pairs)]),
    )
    return joined, counts


def _sticks(model: mujoco.MjModel) -> list[Shape]:
    """Make a capsule in every body, from its origin to the origin of each of its children."""
    length = np.linalg.norm(model.body_pos, axis=1)
    radius = STICK_RADIUS_RATIO * length[model.body_parentid > 0].sum()  # wherever the base is
    children = [i for i in range(1, model.nbody) if model.body_parentid[i] and length[i] > 0]
    sticks = []
    for i in children:
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, model.body_pos[i])
        sticks.append(
            Shape(
                kind="capsule",
                body=int(model.body_parentid[i]),
                half_sizes=np.array([radius, radius, length[i] / 2]),
                centre=model.body_pos[i] / 2,
                rotation=rotation_from_quaternion(turn),
                rgba=np.array([0.6, 0.6, 0.6, 1.0]),
            )
        )
    return sticks


def rotation_from_quaternion(quaternion: Array) -> Array:
    """Convert MuJoCo's quaternion (w, x, y, z), (4,) [1], to a rotation matrix, (3, 3)."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quaternion, dtype=float))
    return rotation.reshape(3, 3)


def quaternions_from_rotations(rotations: Array) -> Array:
    """Convert rotation matrices to unit quaternions.

    Args:
        rotations: Rotation matrices, (..., 3, 3) [1].

    Returns:
        Quaternions (x, y, z, w), (..., 4) [1].
    """
    quaternions = np.empty((*rotations.shape[:-2], 4))
    for quaternion, R in zip(quaternions.reshape(-1, 4), rotations.reshape(-1, 9), strict=True):
        mujoco.mju_mat2Quat(quaternion, R)
    return quaternions[..., [1, 2, 3, 0]]


def rigid_frames(rigid_cell: RigidCell, q: Array) -> BodyFrames:
    """Compute the frames of all bodies of the rigid arm in some poses.

    Args:
        rigid_cell: The rigid cell.
        q: Actuated joints, (runs, n) [rad, m].

    Returns:
        Frames of all bodies.

    Raises:
        BenchError: When q has another shape or is not finite.
    """
    q = check_array(q, (None, rigid_cell.arm.n_joints), "q [rad, m]")
    return _frames(rigid_cell.model, rigid_cell.joint_addresses, q, np.arange(rigid_cell.model.nbody))


def elastic_frames(plant: Plant, q: Array, theta: Array) -> BodyFrames:
    """Compute the frames of the bodies of the deflected arm, in the order of the rigid MJCF's bodies.

    Args:
        plant: The true arm.
        q: Actuated joints, (runs, n) [rad, m].
        theta: Virtual joint coordinates, (runs, n_theta) [m, rad]; they may be magnified for a drawing.

    Returns:
        Frames of all bodies.

    Raises:
        BenchError: When an array has another shape or is not finite.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    theta = check_array(theta, (len(q), plant.arm.n_theta), "theta [m, rad]")
    model = plant.model
    carriers = model.dof_bodyid[plant.theta_indices[: 6 * len(plant.arm.links)]]
    bodies = np.setdiff1d(np.arange(model.nbody), carriers)
    address = np.concatenate([plant.joint_indices, plant.theta_indices])
    return _frames(model, address, np.hstack([q, theta]), bodies)


def undeflected_body_poses(plant: Plant, q: Array, names: Sequence[str]) -> list[tuple[Array, Array]]:
    """Compute the poses of named bodies of the elastic arm by MuJoCo, without deflection.

    Args:
        plant: The true arm.
        q: Actuated joints, (runs, n) [rad, m].
        names: Names of the bodies.

    Returns:
        For every body its origin in the world, (runs, 3) [m], and its orientation, world from body,
        (runs, 3, 3) [1].
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    bodies = np.array([plant.model.body(name).id for name in names])
    frames = _frames(plant.model, plant.joint_indices, q, bodies)
    return [(frames.positions[:, k], frames.rotations[:, k]) for k in range(len(names))]


def _frames(
    model: mujoco.MjModel,
    address: Ids,
    values: Array,
    bodies: Ids,
) -> BodyFrames:
    """Compute the frames of bodies in all poses, pose by pose."""
    data = mujoco.MjData(model)
    positions = np.empty((len(values), len(bodies), 3))
    rotations = np.empty((len(values), len(bodies), 3, 3))
    for i, value in enumerate(values):
        data.qpos[address] = value
        mujoco.mj_kinematics(model, data)
        positions[i] = data.xpos[bodies]
        rotations[i] = data.xmat[bodies].reshape(-1, 3, 3)
    return BodyFrames(positions, rotations)


_angles = 2 * np.pi * np.arange(24) / 24
UNIT_CIRCLE = np.column_stack([np.cos(_angles), np.sin(_angles), np.zeros_like(_angles)])
"""Points on the circle of radius 1 in the xy plane, (24, 3) [1]."""
UNIT_SPHERE_RINGS = np.array(
    [np.cos(t) * UNIT_CIRCLE + [0, 0, np.sin(t)] for t in np.linspace(-np.pi / 2, np.pi / 2, 13)]
)
"""Rings of points on the sphere of radius 1, from pole to pole, (13, 24, 3) [1]."""
UNIT_CUBE_FACES = np.array([[[-1.0, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]] for z in (-1, 1)])
"""Corners of the lower and of the upper face of the cube from -1 to 1, (2, 4, 3) [1]."""


def _capped_ends(size: Array, lower: Array, upper: Array) -> Array:
    """Put rings of the shape's radius at the ends of its half length."""
    return np.concatenate([size[0] * lower - [0, 0, size[2]], size[0] * upper + [0, 0, size[2]]])


PRIMITIVE_RINGS: dict[GeomKind, Callable[[Array], Array]] = {
    "box": lambda size: UNIT_CUBE_FACES * size,
    "cylinder": lambda size: _capped_ends(size, UNIT_CIRCLE[None], UNIT_CIRCLE[None]),
    "capsule": lambda size: _capped_ends(size, UNIT_SPHERE_RINGS[:7], UNIT_SPHERE_RINGS[6:]),
    "sphere": lambda size: UNIT_SPHERE_RINGS * size,
    "ellipsoid": lambda size: UNIT_SPHERE_RINGS * size,
}
"""Function by kind of geom: corners from half sizes, in the geom's axes, (rings, corners, 3) [m].

Rings go from below to above; the corners of a ring are counterclockwise as seen from above.
"""


def primitive_surface(kind: GeomKind, half_sizes: Array) -> Surface:
    """Triangulate the surface of a sphere, capsule, ellipsoid, cylinder or box, in its own axes.

    Args:
        kind: Kind of the geom, not "mesh".
        half_sizes: Half sizes of the geom, (3,) [m]; those of a capsule are without its caps.

    Returns:
        Corners, (v, 3) [m], and triangles, (f, 3), counterclockwise as seen from outside.
    """
    rings = PRIMITIVE_RINGS[kind](half_sizes)
    count, around, _ = rings.shape
    low = np.arange((count - 1) * around).reshape(count - 1, around)
    beside, high = np.roll(low, -1, axis=1), low + around
    above = np.roll(high, -1, axis=1)
    sides = np.stack([low, beside, above, low, above, high], axis=-1).reshape(-1, 3)
    k = np.arange(1, around - 1)
    bottom = np.column_stack([np.zeros_like(k), k + 1, k])
    top = np.column_stack([np.zeros_like(k), k, k + 1]) + (count - 1) * around
    corners, faces = rings.reshape(-1, 3), np.concatenate([bottom, sides, top])
    a, b, c = corners[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return corners, faces[
        area > MIN_TRIANGLE_AREA_RATIO * area.max()
    ]  # at a pole all corners of a ring are one


def hull_points(shape: Shape) -> Array:
    """Compute points whose convex hull is that of a shape, in the axes of its body, (points, 3) [m]."""
    points = (
        PRIMITIVE_RINGS[shape.kind](shape.half_sizes).reshape(-1, 3)
        if shape.mesh is None
        else shape.mesh.vertices
    )
    return np.asarray(shape.centre + points @ shape.rotation.T)


# --- Surfaces of triangles: convex hulls of points, and fewer triangles -------------------------------------

PLAUSIBLE_DENSITY = 300.0, 4000.0
"""Range of the mass of an arm over the volume of its hulls; a mass beyond it raises a warning [kg/m^3]."""
HULL_TOLERANCE = 5e-4
"""Distance by which points may be outside a hull, over the extent of all points [1]."""
MAX_KEPT_FRACTION = 0.9
"""Largest fraction of points that a round of hulls of subsets may keep to be worth it [1]."""
POINTS_PER_HULL = 20_000
"""Most points of which one hull is computed; more points are split into subsets first."""


def convex_hull(vertices: Array) -> Surface | None:
    """Compute the surface of the convex hull of points, to within `HULL_TOLERANCE`.

    Args:
        vertices: The points, (v, 3) [m].

    Returns:
        Corners, (h, 3) [m], and triangles, (f, 3), counterclockwise as seen from outside; None if the points
        lie in a plane.
    """
    hull = _hull(vertices, _slack(vertices))
    if hull is None:
        return None
    used, faces = np.unique(hull.simplices, return_inverse=True)
    corners = vertices[used]
    return corners, _orient_outward(corners, faces.reshape(-1, 3))


def hull_volume(shape: Shape) -> float:
    """Compute the volume of the convex hull of a shape, by the divergence theorem.

    Args:
        shape: The shape.

    Returns:
        The volume [m^3]; 0 for a flat mesh.
    """
    own = shape.mesh
    hull = primitive_surface(shape.kind, shape.half_sizes) if own is None else convex_hull(own.vertices)
    if hull is None:
        return 0.0
    a, b, c = hull[0][hull[1]].transpose(1, 0, 2)
    return float(np.vecdot(a, np.cross(b, c)).sum() / 6)


def convex_hull_vertices(vertices: Array) -> Array:
    """Select the vertices of the convex hull of many points.

    Hulls of subsets are computed first if there are many points: the time of one hull grows faster than the
    number of its points.

    Args:
        vertices: The points, (v, 3) [m].

    Returns:
        The selected points, (h, 3) [m]; all if they lie in a plane.
    """
    slack = _slack(vertices)
    while (groups := -(-len(vertices) // POINTS_PER_HULL)) > 1:
        kept = np.concatenate([_outer(vertices[k::groups], slack) for k in range(groups)])
        if len(kept) > MAX_KEPT_FRACTION * len(vertices):
            break
        vertices = kept
    return _outer(vertices, slack)


def _outer(vertices: Array, slack: float) -> Array:
    hull = _hull(vertices, slack)
    return vertices if hull is None else np.asarray(vertices[hull.vertices])


def _slack(vertices: Array) -> float:
    return HULL_TOLERANCE * float(np.ptp(vertices, axis=0).max(initial=0.0))


def _hull(vertices: Array, slack: float) -> "ConvexHull | None":
    """Compute the hull without points outside by less than the slack: a fine cylinder would take minutes."""
    from scipy.spatial import ConvexHull, QhullError

    if len(vertices) < 4:
        return None
    try:
        return ConvexHull(vertices, qhull_options=f"W{slack:.17f}")
    except QhullError:
        return None


def _orient_outward(corners: Array, faces: Faces) -> Faces:
    """Order the corners of a convex body's triangles counterclockwise as seen from outside.

    Args:
        corners: Corners of the body, (v, 3) [m].
        faces: Corner indices of every triangle, (f, 3).

    Returns:
        The triangles with ordered corners, (f, 3).
    """
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces).astype(int)


def decimate(vertices: Array, faces: Faces, max_triangles: int) -> Surface:
    """Reduce the number of triangles of a surface by fast_simplification.

    Args:
        vertices: Corners, (v, 3) [m].
        faces: Corner indices of every triangle, (f, 3).
        max_triangles: Number of triangles of the result, approximately; a surface with fewer is returned
            unchanged.

    Returns:
        Corners, (w, 3) [m], and triangles, (g, 3).
    """
    if len(faces) <= max_triangles:
        return vertices, faces
    import fast_simplification

    thin, kept = fast_simplification.simplify(
        np.ascontiguousarray(vertices, dtype=np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
        target_count=max_triangles,
    )
    return np.asarray(thin, dtype=float), np.asarray(kept, dtype=int)
