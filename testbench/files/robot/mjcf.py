"""MJCF compiled by MuJoCo, so that defaults, frames, classes and trees have MuJoCo's meaning.

MuJoCo opens none of the files itself: includes and meshes are read here, up to a size, and only elements that
an arm's statics needs are compiled.
"""

import math
import os
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from testbench.arm.document import MAX_ELEMENTS, path_inside, xml_place
from testbench.arm.mjcf import attribute_numbers
from testbench.errors import Array, InputError
from testbench.files.robot.meshes import MAX_ALL_FACES, MeshError, Meshes, check_size, primitive, stl_bytes
from testbench.files.robot.robot import (
    Body,
    ImportedJoint,
    ImportedMesh,
    ImportedShape,
    ImportedSite,
    Note,
    Robot,
    couplings_of,
    pose_of,
    read_xml,
    substitute_limits,
)
from testbench.plant.build import COMPILE_ERRORS, MAX_HULL_CORNERS
from testbench.plant.rigid_cell import VISUAL_GROUPS, body_name
from testbench.plant.shapes import (
    GEOM_KINDS,
    convex_hull,
    convex_hull_vertices,
    decimate,
    geom_rgba,
    rotation_from_quaternion,
)

KEPT = frozenset(
    "mujoco compiler default worldbody body frame inertial joint freejoint geom site".split()
    + "asset mesh material equality connect weld tendon fixed spatial pulley".split()
)
"""Elements that are compiled."""
COUPLED = {"equality", "tendon"}
"""Elements read for the couplings of the arm's joints, and otherwise left out."""
SILENT = frozenset("option visual statistic size light camera texture layer custom extension".split())
"""Elements that are dropped without a note, because an arm needs none of them."""
REFUSED_TAGS = frozenset("replicate attach model".split())
MAX_FILES = 50
"""Most included files, each counted once."""
MAX_FACES = 200_000
"""Most faces of a mesh that MuJoCo reads."""
ODD = {int(mujoco.mjtJoint.mjJNT_FREE): "is free", int(mujoco.mjtJoint.mjJNT_BALL): "is a ball"}
NO_GEOMS = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
SLIDES = int(mujoco.mjtJoint.mjJNT_SLIDE)
GRAVITY_RANGE = 9.5, 10.5
"""Gravity that a file in metres may state [m/s^2]."""
NOTHING = 1e-14
"""Mass below which a body counts as massless [kg]."""


def read_mjcf(file: Path, root: ET.Element) -> Robot:
    """Read all bodies of a robot.

    Args:
        file: The MJCF, for messages and as the place from which its files are found.
        root: Its root element; it is changed.

    Returns:
        The robot.

    Raises:
        InputError: If the MJCF includes files from outside its folder, or elements that no arm can have.
    """
    _include(file, root)
    _check_gravity(file, root)
    driven = {e.get("joint", "") for actuators in root.findall("actuator") for e in actuators} - {""}
    left_out = _keep(root) | {tag for tag in COUPLED if root.find(tag) is not None}
    meshes = Meshes()
    model, stated = _compile(file, root, meshes)
    surfaces = _surfaces(file, model)
    bodies: list[Body] = []
    index = {0: -1}  # of MuJoCo's body the last of ours, whose origin may lie on a joint
    origins = {0: np.zeros(3)}  # that origin in MuJoCo's body
    for b in range(1, model.nbody):
        parent = int(model.body_parentid[b])
        before = pose_of(np.eye(3), -origins[parent]) @ _pose(model.body_pos[b], model.body_quat[b])
        split, origins[b] = _split(model, b, index[parent], before, len(bodies))
        split[-1] = replace(_filled(model, b, split[-1], origins[b], surfaces), weighed=stated[b])
        bodies += split
        index[b] = len(bodies) - 1
    named = {j: _joint_name(model, j) for j in range(model.njnt)}
    notes = ((Note("left out", tuple(sorted(left_out))),) if left_out else ()) + tuple(meshes.notes())
    notes += tuple(_springs(model))
    couplings = tuple(couplings_of(model, named, index))
    return Robot(root.get("model") or file.stem, tuple(bodies), notes, couplings, frozenset(driven))


def _include(file: Path, root: ET.Element) -> None:
    """Replace every <include> by the children of the file that it names; each file once, as in MuJoCo."""
    seen = {os.path.realpath(file)}
    while pair := next(((p, c) for p in root.iter() for c in p if c.tag == "include"), None):
        parent, e = pair
        name = e.get("file", "")
        path = path_inside(file.parent, Path(name))
        if path is None:
            raise InputError(file, "<include>", f"expected a file inside of {file.parent}, got {name!r}")
        if str(path) in seen:
            raise InputError(file, "<include>", f"expected each file once, got {name!r} again")
        if len(seen) > MAX_FILES:
            raise InputError(file, "<include>", f"expected at most {MAX_FILES} files, got more")
        seen.add(str(path))
        place = list(parent).index(e)
        parent[place : place + 1] = list(read_xml(path))
        if sum(1 for _ in root.iter()) > MAX_ELEMENTS:
            raise InputError(file, "<include>", f"expected at most {MAX_ELEMENTS} elements in all")
    if refused := [e.tag for e in root.iter() if e.tag in REFUSED_TAGS]:
        problem = "not read; save the compiled model as one MJCF file first"
        raise InputError(file, f"<{refused[0]}>", problem)


def _check_gravity(file: Path, root: ET.Element) -> None:
    """Refuse gravity that is not along -z of the world, or is in another unit; zero is accepted."""
    stated = [e for e in root.findall("option") if "gravity" in e.attrib]
    if not stated:
        return
    x, y, z = attribute_numbers(file, stated[-1], "gravity", 3)
    if (x or y or z) and not (x == y == 0 and GRAVITY_RANGE[0] <= -z <= GRAVITY_RANGE[1]):
        problem = f"gravity: expected 0 0 -9.81 [m/s^2], or zeros, got {stated[-1].get('gravity')!r}"
        hint = "turn the body of the base instead, or scale the lengths to metres"
        raise InputError(file, xml_place(stated[-1]), f"{problem}; {hint}")


def _springs(model: mujoco.MjModel) -> Iterator[Note]:
    """Note what carries weight in the file, and is left out: springs, and gravity that is compensated."""
    joints = [_joint_name(model, j) for j in np.flatnonzero(model.jnt_stiffness).tolist()]
    tendons = [
        model.tendon(k).name or f"tendon_{k + 1}" for k in np.flatnonzero(model.tendon_stiffness).tolist()
    ]
    if joints or tendons:
        yield Note("springs", (*joints, *tendons))
    if floating := [body_name(model, b) for b in np.flatnonzero(model.body_gravcomp).tolist()]:
        yield Note("gravcomp", tuple(floating))


def _keep(root: ET.Element) -> set[str]:
    """Remove elements that are not compiled; return those of them that a user might miss."""
    left_out, within = set(), [root]
    while within:
        parent = within.pop()
        parent.attrib.pop("texture", None)
        for child in list(parent):
            if child.tag not in KEPT:
                parent.remove(child)
                if child.tag not in SILENT and parent.tag != "default":
                    left_out.add(str(child.tag))
            elif child.tag == "geom" and (child.get("type") in ("hfield", "sdf") or "hfield" in child.attrib):
                parent.remove(child)
            else:
                within.append(child)
    return left_out


def _compile(file: Path, root: ET.Element, meshes: Meshes) -> tuple[mujoco.MjModel, list[bool]]:
    """Compile MuJoCo's model; also tell for every body whether the file states its mass."""
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        spec.compiler.balanceinertia, spec.compiler.fusestatic = True, False
        spec.compiler.discardvisual = False
        spec.assets = _assets(file, spec, meshes)
        with warnings.catch_warnings(action="ignore"):  # of masses and motors, which statics does not ask
            model = spec.compile()
        weighs = spec.compiler.inertiafromgeom != NO_GEOMS  # what no geom gives a mass is meant to have none
        stated = [bool(body.explicitinertial) for body in spec.bodies]
        light = model.body_mass <= NOTHING
    except COMPILE_ERRORS as err:
        problem = re.sub(r",? line [0-9]+", "", " ".join(f"MuJoCo refuses it: {err}".split()))
        raise InputError(file, "", problem) from err  # lines are of the text above, not of the file
    return model, [own or (weighs and bool(none)) for own, none in zip(stated, light, strict=True)]


def _assets(file: Path, spec: mujoco.MjSpec, meshes: Meshes) -> dict[str, bytes]:
    """Read the meshes; one that cannot be read is dropped, with the geoms that use it."""
    folder, found = file.parent / spec.meshdir, dict[str, bytes]()
    spec.meshdir = ""
    for mesh in list(spec.meshes):
        mesh.maxhullvert = MAX_HULL_CORNERS
        if not mesh.file:
            continue
        try:
            path = path_inside(file.parent, (folder / mesh.file).absolute())
            if path is None:
                raise MeshError(f"lies outside of {file.parent}")
            imported_mesh = meshes.load(path)
            check_size(imported_mesh.vertices * mesh.scale)
        except MeshError as err:
            meshes.failed[mesh.file] = str(err)
            for geom in [g for g in spec.geoms if g.meshname == mesh.name]:
                spec.delete(geom)
            spec.delete(mesh)
            continue
        if convex_hull(imported_mesh.outer) is None:  # MuJoCo needs to know that it is flat
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        mesh.file, mesh.content_type = f"{len(found)}.stl", ""
        found[mesh.file] = stl_bytes(*decimate(imported_mesh.vertices, imported_mesh.faces, MAX_FACES))
    return found


def _surfaces(file: Path, model: mujoco.MjModel) -> list[ImportedMesh]:
    """Return the triangles of every mesh in MuJoCo's mesh frame [m]."""
    shown = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    faces = int(model.mesh_facenum[shown].astype(int).sum())
    if faces > MAX_ALL_FACES:
        raise InputError(file, "<geom>", f"expected at most {MAX_ALL_FACES} triangles in all, got {faces}")
    imported_meshes = []
    for k in range(model.nmesh):
        vertex, face = int(model.mesh_vertadr[k]), int(model.mesh_faceadr[k])
        corners = np.asarray(model.mesh_vert[vertex : vertex + int(model.mesh_vertnum[k])], dtype=float)
        triangles = model.mesh_face[face : face + int(model.mesh_facenum[k])].astype(int)
        imported_meshes.append(ImportedMesh(corners, triangles, convex_hull_vertices(corners)))
    return imported_meshes


def _split(model: mujoco.MjModel, b: int, parent: int, before: Array, count: int) -> tuple[list[Body], Array]:
    """Split a body of MuJoCo into bodies of one joint each, with their origins on the joints.

    Args:
        model: MuJoCo's model.
        b: MuJoCo's body.
        parent: Our body before it; -1 for the world.
        before: Pose of MuJoCo's body in the parent, (4, 4) [m].
        count: Number of our bodies so far.

    Returns:
        The bodies, and the origin of the last one in MuJoCo's body, (3,) [m].
    """
    name = body_name(model, b)
    joints = range(int(model.body_jntadr[b]), int(model.body_jntadr[b] + model.body_jntnum[b]))
    if not joints:
        return [Body(name, parent, before)], np.zeros(3)
    if odd := next((ODD[kind] for j in joints if (kind := int(model.jnt_type[j])) in ODD), ""):
        return [Body(name, parent, before, odd=odd)], np.zeros(3)
    bodies = []
    if parent < 0:  # an arm that moves against the world itself
        bodies.append(Body(f"{name}_base", -1, np.eye(4)))
        parent = count
    origin = np.zeros(3)
    for j in joints:
        pose = before @ pose_of(np.eye(3), model.jnt_pos[j] - origin) @ _at_zero(model, j)
        own = name if j == joints[-1] else f"{name}_{len(bodies) + 1}"
        bodies.append(Body(own, parent, pose, joint=_joint(model, j)))
        parent = count + len(bodies) - 1
        origin = model.jnt_pos[j]
        before = np.eye(4)
    return bodies, origin


def _at_zero(model: mujoco.MjModel, j: int) -> Array:
    """Compute how a joint at q = 0 moves its body from the drawn pose at q = ref, (4, 4)."""
    axis, back = model.jnt_axis[j], -float(model.qpos0[model.jnt_qposadr[j]])
    if int(model.jnt_type[j]) == SLIDES:
        return pose_of(np.eye(3), axis * back)
    quat = np.array([math.cos(back / 2), *(math.sin(back / 2) * axis)])
    return _pose(np.zeros(3), quat)


def _joint_name(model: mujoco.MjModel, j: int) -> str:
    return model.joint(j).name or f"joint_{j + 1}"


def _joint(model: mujoco.MjModel, j: int) -> ImportedJoint:
    slides, limited = int(model.jnt_type[j]) == SLIDES, bool(model.jnt_limited[j])
    lower, upper = map(float, model.jnt_range[j]) if limited else substitute_limits(prismatic=slides)
    return ImportedJoint(_joint_name(model, j), model.jnt_axis[j].copy(), slides, lower, upper, limited)


def _filled(
    model: mujoco.MjModel, b: int, body: Body, origin: Array, surfaces: Sequence[ImportedMesh]
) -> Body:
    """Add mass, shapes and sites to a body, relative to an origin in MuJoCo's body."""
    mass = float(model.body_mass[b])
    mass = mass if mass > NOTHING else 0.0
    axes = rotation_from_quaternion(model.body_iquat[b])
    sites = [s for s in range(model.nsite) if model.site_bodyid[s] == b and model.site(s).name]
    geoms = np.flatnonzero(model.geom_bodyid == b).tolist()
    return replace(
        body,
        mass=mass,
        com=model.body_ipos[b] - origin if mass else np.zeros(3),
        inertia=axes @ np.diag(model.body_inertia[b]) @ axes.T,
        shapes=tuple(shape for g in geoms if (shape := _shape(model, surfaces, g, origin))),
        sites=tuple(
            ImportedSite(model.site(s).name, _pose(model.site_pos[s] - origin, model.site_quat[s]))
            for s in sites
        ),
    )


def _shape(
    model: mujoco.MjModel, surfaces: Sequence[ImportedMesh], g: int, origin: Array
) -> ImportedShape | None:
    """Convert a geom to a surface; None for a plane."""
    kind, size = GEOM_KINDS.get(int(model.geom_type[g])), model.geom_size[g].copy()
    if kind is None:
        return None
    return ImportedShape(
        kind=kind,
        size=size,
        pose=_pose(model.geom_pos[g] - origin, model.geom_quat[g]),
        mesh=surfaces[int(model.geom_dataid[g])] if kind == "mesh" else primitive(kind, size),
        rgba=geom_rgba(model, g),
        visual=int(model.geom_group[g]) < VISUAL_GROUPS,
        collides=bool(model.geom_contype[g] | model.geom_conaffinity[g]),
    )


def _pose(position: Array, quat: Array) -> Array:
    return pose_of(rotation_from_quaternion(quat), position)
