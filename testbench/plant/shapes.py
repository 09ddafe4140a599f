"""Appearance of the arm: geoms of its rigid MJCF, their surfaces, and poses of all bodies.

Hulls of meshes are computed by Qhull, not by trimesh, which perturbs flat points until they have a hull.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import mujoco
import numpy as np

from testbench.errors import Array, Ids, Mask, check_array
from testbench.plant.build import Plant
from testbench.plant.site import VISUAL_GROUPS, Site

if TYPE_CHECKING:  # it takes long to import, and few commands draw
    from scipy.spatial import ConvexHull

GeomKind = Literal["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]

GEOM_KINDS: dict[int, GeomKind] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}
"""Geoms that are drawn; a plane is the floor."""

Faces = Ids
Surface = tuple[Array, Faces]
"""Corners, (v, 3) [m], and three of them a triangle, (f, 3)."""
FLAT_TRIANGLE_AREA = (
    1e-9  #: Area of a triangle over the largest one of its surface below which it has none [1].
)
STICK_RADIUS = 0.02  #: Radius of the sticks of an arm without visual geoms, over the length of its chain [1].


@dataclass(frozen=True)
class Mesh:
    """Hold a triangle mesh."""

    vertices: Array  #: Corners, each once, (v, 3) [m].
    normals: Array  #: Unit normal of every corner, (v, 3) [1].
    faces: Ids  #: Corner indices of every triangle, (f, 3).


@dataclass(frozen=True)
class Shape:
    """Describe one visual geom, fixed in a body."""

    kind: GeomKind  #: MuJoCo's geom type.
    body: int  #: Index of its body.
    #: Half sizes of the shape along its own axes, (3,) [m]: of a capsule or cylinder (radius, radius, half
    #: length without caps).
    size: Array
    position: Array  #: Position of its centre in the body, (3,) [m].
    rotation: Array  #: Body from shape, (3, 3) [1].
    rgba: Array  #: Colour, (4,) [1].
    mesh: Mesh | None = None  #: For kind "mesh", in the shape's axes.


@dataclass(frozen=True)
class BodyFrames:
    """Hold the poses of the bodies of the rigid MJCF, the world first, as in `Site.names`."""

    positions: Array  #: Origins, (runs, bodies, 3) [m].
    rotations: Array  #: World from body, (runs, bodies, 3, 3) [1].


def select_frames(frames: BodyFrames, rows: Ids) -> BodyFrames:
    """Select poses of bodies.

    Args:
        frames: Places of all bodies.
        rows: Numbers of the poses, (rows,), in the order wanted; one may occur more than once.
    """
    return BodyFrames(frames.positions[rows], frames.rotations[rows])


def body_origins(site: Site, names: Sequence[str], frames: BodyFrames) -> Array:
    """Return the origins of named bodies.

    Args:
        site: The site.
        names: Names of the bodies.
        frames: Places of all bodies.

    Returns:
        Origins, (rows, len(names), 3) [m].
    """
    return np.asarray(frames.positions[:, [site.names.index(name) for name in names]])


def drawn_shapes(site: Site) -> list[Shape]:
    """List the visual geoms of an arm; none if it has none."""
    return _shapes(site.model, site.model.geom_group < VISUAL_GROUPS)


def visual_shapes(site: Site) -> list[Shape]:
    """List the visual geoms of an arm, or sticks from body to body if it has none."""
    return drawn_shapes(site) or _sticks(site.model)


def solid_shapes(site: Site) -> list[Shape]:
    """List the colliding geoms of an arm."""
    return _shapes(site.model, site.model.geom_contype != 0)


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
        size=half_sizes(kind, model.geom_size[g]),
        position=model.geom_pos[g].copy(),
        rotation=rotation_of(model.geom_quat[g]),
        rgba=geom_rgba(model, g),
        mesh=_mesh(model, int(model.geom_dataid[g])) if kind == "mesh" else None,
    )


def half_sizes(kind: GeomKind, size: Array) -> Array:
    """Compute the half sizes of a geom along its axes from MuJoCo's size; see `Shape.size`.

    Args:
        kind: Kind of the geom.
        size: MuJoCo's size, (3,) [m].

    Returns:
        Half sizes, (3,) [m].
    """
    places = {"sphere": [0, 0, 0], "capsule": [0, 0, 1], "cylinder": [0, 0, 1]}
    return size[places.get(kind, [0, 1, 2])]


def geom_rgba(model: mujoco.MjModel, g: int) -> Array:
    """Return the colour of a geom, or of its material if the geom has MuJoCo's default.

    Args:
        model: The MuJoCo model.
        g: Number of the geom.

    Returns:
        Red, green, blue and opacity, (4,) [1].
    """
    material, rgba = int(model.geom_matid[g]), model.geom_rgba[g]
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
    """Join the meshes of one body, in its axes [m], to one mesh; shapes without a mesh are skipped.

    Returns:
        The mesh, and the number of vertices of each part.
    """
    pairs = [(shape, shape.mesh) for shape in shapes if shape.mesh is not None]
    counts = [len(mesh.vertices) for _, mesh in pairs]
    first = np.cumsum([0, *counts])
    joined = Mesh(
        vertices=np.concatenate([s.position + mesh.vertices @ s.rotation.T for s, mesh in pairs]),
        normals=np.concatenate([mesh.normals @ s.rotation.T for s, mesh in pairs]),
        faces=np.concatenate([mesh.faces + first[k] for k, (_, mesh) in enumerate(pairs)]),
    )
    return joined, counts


def _sticks(model: mujoco.MjModel) -> list[Shape]:
    """Make a capsule in every body, from its origin to the origin of each of its children."""
    length = np.linalg.norm(model.body_pos, axis=1)
    radius = STICK_RADIUS * length[model.body_parentid > 0].sum()  # wherever the base is
    children = [i for i in range(1, model.nbody) if model.body_parentid[i] and length[i] > 0]
    sticks = []
    for i in children:
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, model.body_pos[i])
        sticks.append(
            Shape(
                kind="capsule",
                body=int(model.body_parentid[i]),
                size=np.array([radius, radius, length[i] / 2]),
                position=model.body_pos[i] / 2,
                rotation=rotation_of(turn),
                rgba=np.array([0.6, 0.6, 0.6, 1.0]),
            )
        )
    return sticks


def rotation_of(quaternion: Array) -> Array:
    """Convert MuJoCo's quaternion (w, x, y, z), (4,) [1], to a rotation matrix, (3, 3)."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quaternion, dtype=float))
    return rotation.reshape(3, 3)


def quaternions(R: Array) -> Array:
    """Convert rotation matrices to quaternions q, each with a positive largest component.

    Every row of the symmetric matrix 4 q q^T is q times one of its components; the row of the largest one is
    normalised.

    Args:
        R: Rotation matrices, (..., 3, 3) [1].

    Returns:
        Quaternions (x, y, z, w), (..., 4) [1].
    """
    xx, yy, zz = (R[..., k, k] for k in range(3))
    xy, yz, zx = (R[..., j, i] + R[..., i, j] for i, j in ((0, 1), (1, 2), (2, 0)))
    xw, yw, zw = (R[..., j, i] - R[..., i, j] for i, j in ((1, 2), (2, 0), (0, 1)))
    products = [
        [1 + xx - yy - zz, xy, zx, xw],
        [xy, 1 - xx + yy - zz, yz, yw],
        [zx, yz, 1 - xx - yy + zz, zw],
        [xw, yw, zw, 1 + xx + yy + zz],
    ]
    outer = np.moveaxis(np.array(products), (0, 1), (-2, -1))
    largest = np.diagonal(outer, axis1=-2, axis2=-1).argmax(axis=-1)
    q = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def rigid_frames(site: Site, q: Array) -> BodyFrames:
    """Compute the places of the bodies of the rigid arm.

    Args:
        site: The site.
        q: Joint angles, (rows, n) [rad, m].
    """
    q = check_array(q, (None, site.arm.n_joints), "q [rad, m]")
    return _frames(site.model, site.joints, q, np.arange(site.model.nbody))


def elastic_frames(plant: Plant, q: Array, theta: Array) -> BodyFrames:
    """Compute the places of the bodies of the elastic arm, in the order of the rigid arm's.

    Args:
        plant: The plant.
        q: Joint angles, (rows, n) [rad, m].
        theta: Deflection of the virtual joints, (rows, n_theta) [m, rad]; it may be magnified.
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    theta = check_array(theta, (len(q), plant.arm.n_theta), "theta [m, rad]")
    model = plant.model
    carriers = model.dof_bodyid[plant.theta[: 6 * len(plant.arm.links)]]
    bodies = np.setdiff1d(np.arange(model.nbody), carriers)
    address = np.concatenate([plant.joints, plant.theta])
    return _frames(model, address, np.hstack([q, theta]), bodies)


def unloaded_body_poses(plant: Plant, q: Array, names: Sequence[str]) -> list[tuple[Array, Array]]:
    """Compute where MuJoCo places bodies of the elastic arm at theta = 0.

    Args:
        plant: The plant.
        q: Joint angles, (runs, n) [rad, m].
        names: Names of the bodies.

    Returns:
        Of each body its origin in the world, (runs, 3) [m], and world from body, (runs, 3, 3) [1].
    """
    q = check_array(q, (None, plant.arm.n_joints), "q [rad, m]")
    bodies = np.array([plant.model.body(name).id for name in names])
    frames = _frames(plant.model, plant.joints, q, bodies)
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


CIRCLE_ANGLES = 2 * np.pi * np.arange(24) / 24
CIRCLE = np.column_stack([np.cos(CIRCLE_ANGLES), np.sin(CIRCLE_ANGLES), np.zeros_like(CIRCLE_ANGLES)])
SPHERE = np.array([np.cos(t) * CIRCLE + [0, 0, np.sin(t)] for t in np.linspace(-np.pi / 2, np.pi / 2, 13)])
"""Rings of a sphere of radius 1 from pole to pole, (13, 24, 3)."""
CUBE = np.array([[[-1.0, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]] for z in (-1, 1)])
"""Corners of the lower and of the upper face of a cube, (2, 4, 3)."""


def _capped_ends(size: Array, lower: Array, upper: Array) -> Array:
    """Put rings of the shape's radius at the ends of its half length."""
    return np.concatenate([size[0] * lower - [0, 0, size[2]], size[0] * upper + [0, 0, size[2]]])


PRIMITIVE_RINGS: dict[GeomKind, Callable[[Array], Array]] = {
    "box": lambda size: CUBE * size,
    "cylinder": lambda size: _capped_ends(size, CIRCLE[None], CIRCLE[None]),
    "capsule": lambda size: _capped_ends(size, SPHERE[:7], SPHERE[6:]),
    "sphere": lambda size: SPHERE * size,
    "ellipsoid": lambda size: SPHERE * size,
}
"""Corners of a primitive by its half sizes, in its own axes: rings from below to above, counterclockwise."""


def primitive_surface(kind: GeomKind, size: Array) -> Surface:
    """Triangulate a primitive in its own axes: between its rings, and across the first and the last one.

    Args:
        kind: Kind of the geom, not a mesh.
        size: Its half sizes, see `Shape.size`, (3,) [m].

    Returns:
        Corners and triangles, counterclockwise as seen from outside.
    """
    rings = PRIMITIVE_RINGS[kind](size)
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
    return corners, faces[area > FLAT_TRIANGLE_AREA * area.max()]  # at a pole all corners of a ring are one


def corners(shape: Shape) -> Array:
    """Compute points whose convex hull is that of a shape, in the axes of its body, (points, 3) [m]."""
    points = (
        PRIMITIVE_RINGS[shape.kind](shape.size).reshape(-1, 3) if shape.mesh is None else shape.mesh.vertices
    )
    return np.asarray(shape.position + points @ shape.rotation.T)


# --- Surfaces of triangles: convex hulls of points, and fewer triangles -------------------------------------

PLAUSIBLE_DENSITY = 300.0, 4000.0
"""Range of the mass of an arm over the volume of its hulls; stated masses beyond it are doubtful [kg/m^3]."""
HULL_TOLERANCE = 5e-4
"""Distance by which points may be outside a hull, over the extent of all points [1]."""
MAX_KEPT_SHARE = 0.9
"""Share of points below which the next hull is computed of the points that are left [1]."""
POINTS_PER_HULL = 20_000
"""Most points of a hull that is computed in one step."""


def hull_of(vertices: Array) -> Surface | None:
    """Compute the convex hull of points, to within HULL_TOLERANCE.

    Args:
        vertices: The points, (v, 3) [m].

    Returns:
        Corners and faces of the hull; None if the points are flat.
    """
    hull = _hull(vertices, _slack(vertices))
    if hull is None:
        return None
    used, faces = np.unique(hull.simplices, return_inverse=True)
    corners = vertices[used]
    return corners, orient_outward(corners, faces.reshape(-1, 3))


def hull_volume(shape: Shape) -> float:
    """Compute the volume of the convex hull of a shape, by the divergence theorem.

    Args:
        shape: The shape.

    Returns:
        The volume [m^3]; 0 of a flat mesh.
    """
    own = shape.mesh
    hull = primitive_surface(shape.kind, shape.size) if own is None else hull_of(own.vertices)
    if hull is None:
        return 0.0
    a, b, c = hull[0][hull[1]].transpose(1, 0, 2)
    return float(np.vecdot(a, np.cross(b, c)).sum() / 6)


def convex_hull_vertices(vertices: Array) -> Array:
    """Select the vertices of the convex hull of many points.

    For many corners, hulls of subsets are computed first: the time of one hull grows faster than their
    number.

    Args:
        vertices: The corners, (v, 3) [m].

    Returns:
        The selected corners, (h, 3) [m]; all if they are flat.
    """
    slack = _slack(vertices)
    while (groups := -(-len(vertices) // POINTS_PER_HULL)) > 1:
        kept = np.concatenate([_outer(vertices[k::groups], slack) for k in range(groups)])
        if len(kept) > MAX_KEPT_SHARE * len(vertices):
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


def orient_outward(corners: Array, faces: Faces) -> Faces:
    """Orient the faces of a convex body counterclockwise as seen from outside.

    Args:
        corners: Corners of the body, (v, 3) [m].
        faces: Corner indices of every triangle, (f, 3).

    Returns:
        The triangles in that order, (f, 3).
    """
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces).astype(int)


def decimate(vertices: Array, faces: Faces, most: int) -> Surface:
    """Reduce a surface to at most about a given number of triangles.

    Uses fast_simplification, which trimesh uses too.

    Args:
        vertices: Corners, (v, 3) [m].
        faces: Corner indices of every triangle, (f, 3).
        most: Number of triangles to keep.

    Returns:
        Corners and triangles; the surface itself if it is small enough.
    """
    if len(faces) <= most:
        return vertices, faces
    import fast_simplification

    thin, kept = fast_simplification.simplify(
        np.ascontiguousarray(vertices, dtype=np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
        target_count=most,
    )
    return np.asarray(thin, dtype=float), np.asarray(kept, dtype=int)
