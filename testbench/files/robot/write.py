"""Writer of an imported robot's rigid.xml in the strict dialect, and of its meshes.

Each part has few small files: one mesh that is drawn, and hulls and primitives that collide.

Estimates of masses that a file does not state, from the volume of its shapes.
"""

import os
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY, MAX_MJCF_BYTES, asset_paths, read_meshes, read_mjcf
from testbench.errors import Array, BenchError, InputError, read_bytes
from testbench.files.robot.meshes import (
    Weighed,
    combined,
    distinct,
    integrals,
    joined,
    plausible,
    stl_bytes,
    with_area,
)
from testbench.files.robot.robot import (
    Body,
    ImportedChain,
    ImportedShape,
    ImportedSite,
    Note,
    Point,
    pose_of,
    visible_shapes,
)
from testbench.plant.build import COMPILE_ERRORS, check_geoms, elastic_mjcf
from testbench.plant.rigid_cell import compute_contacts
from testbench.plant.shapes import (
    Faces,
    Surface,
    convex_hull,
    convex_hull_vertices,
    decimate,
)
from testbench.runs.whole import whole_files

# --- Writer of an imported robot's rigid.xml in the strict dialect, and of its meshes -----------------------

DENSITY = 1200.0
"""Mass of an arm over the volume of the convex hulls of its colliding shapes [kg/m^3]. Twelve arms of known
mass, 11 to 1310 kg, are between 910 and 1610."""
PLACEHOLDERS = 4
"""Number of links with one and the same mass from which masses count as placeholders."""


def weigh(file: Path, bodies: Sequence[Body], of_arm: Iterable[int]) -> tuple[list[Body], list[Note]]:
    """Estimate the masses of bodies without a stated mass from their geometry.

    Args:
        file: The robot's file, for messages.
        bodies: All bodies.
        of_arm: Places of those that belong to the arm.

    Returns:
        The bodies, and notes on the estimated masses.

    Raises:
        InputError: If the file has neither masses nor shapes.
    """
    own = sorted(of_arm)
    weighed = list(bodies)
    notes = []
    masses = [bodies[k].mass for k in own if bodies[k].weighed and bodies[k].mass > 0]
    if len(masses) >= PLACEHOLDERS and min(masses) == max(masses):
        notes.append(Note("placeholders", (), (masses[0],)))
        for k in own:
            weighed[k] = replace(bodies[k], weighed=False, mass=0.0 if bodies[k].shapes else bodies[k].mass)
    some = any(weighed[k].mass > 0 for k in own)
    seen = any(shape.visual for k in own for shape in bodies[k].shapes)
    missing = [k for k in own if _is_missing(weighed[k], some, seen)]
    if not missing and not some:
        raise InputError(file, "", "expected masses, or shapes to estimate them from; found neither")
    for k in missing:
        volume, centre, inertia = _integrals(bodies[k].shapes)
        weighed[k] = replace(weighed[k], mass=DENSITY * volume, com=centre, inertia=DENSITY * inertia)
    if missing:
        names, total = tuple(bodies[k].name for k in missing), sum(weighed[k].mass for k in missing)
        notes.append(Note("no masses", names, (DENSITY, total)))
    rest = [weighed[k] for k in own if k not in missing]
    if drawn := [body.name for body in rest if not body.weighed and body.mass > 0]:
        notes.append(Note("geoms weigh", tuple(drawn)))
    return weighed, notes


def _is_missing(body: Body, some: bool, seen: bool) -> bool:
    """Tell whether a mass must be estimated.

    A fixed link without mass is a mere frame if other links have mass, and a mere safety hull if others are
    drawn.
    """
    fixed = not body.moves and body.parent >= 0
    frame = some or (seen and not any(shape.visual for shape in body.shapes))
    return not body.weighed and body.mass == 0 and bool(body.shapes) and not (fixed and frame)


def _integrals(shapes: Sequence[ImportedShape]) -> Weighed:
    """Compute volume, centroid and inertia at unit density of the hulls of colliding or drawn shapes."""
    chosen = [s for s in shapes if s.collides] or shapes
    return combined([integrals(hull) for s in chosen if (hull := convex_hull(s.cloud))])


DRAWN_FACES = 1500
"""Most faces of the drawn mesh of a part."""
HULL_FACES = 200
"""Most faces of a hull."""
GRID = 64, 48, 32, 24, 16, 12
"""Cells along the longest side of a surface that cannot be thinned directly."""
MIN_FACES = 5000
"""Most faces that need not form a surface: the time to thin more has no bound."""
MAX_OPEN_SHARE = 0.25
"""Largest share of edges of a surface that belong to one triangle only [1]."""
A_CORNER, AROUND = 4.0, 1000
"""Most triangles of a surface per corner, and around one corner [1]."""
THIN_ENOUGH = 1.2
"""Ratio of faces to the requested number at which a surface is thin enough [1]."""
MAX_HULLS = 8
"""Most hulls of a part; more are joined to one."""


def drawn_mesh(part: Body) -> tuple[Surface, Array] | None:
    """Join the drawn shapes of a part to one mesh.

    Args:
        part: The part.

    Returns:
        The mesh, and the colour of its largest piece, (4,) [1]; None if no shape is a mesh.
    """
    meshes = [s for s in visible_shapes(part.shapes) if s.kind == "mesh"]
    if not meshes:
        return None
    found = [s.surface for s in meshes]
    largest = int(np.argmax([_area(*surface) for surface in found]))
    return _small(joined(found)), meshes[largest].rgba


def _area(vertices: Array, faces: Faces) -> float:
    a, b, c = vertices[faces].swapaxes(0, 1)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _small(surface: Surface) -> Surface:
    """Reduce a surface to few faces: thinned directly, or on a coarser grid first where parts are loose."""
    if len(surface[1]) > MIN_FACES and not _sound(surface[1]):
        surface = convex_hull(convex_hull_vertices(surface[0])) or surface
    thin = decimate(*surface, DRAWN_FACES)
    for cells in GRID:
        if len(thin[1]) <= THIN_ENOUGH * DRAWN_FACES:
            break
        thin = decimate(*_gridded(*surface, cells), DRAWN_FACES)
    return thin


def _sound(faces: Faces) -> bool:
    """Tell whether triangles form a surface: few open edges, and no corner with too many triangles."""
    faces = faces[distinct(np.sort(faces, axis=1))[0]]
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, shared = np.unique(sides @ np.array([1 << 32, 1]), return_counts=True)
    around = np.bincount(faces.ravel())
    few = len(faces) <= A_CORNER * np.count_nonzero(around) and around.max() <= AROUND
    return bool(few and (shared == 1).sum() <= MAX_OPEN_SHARE * len(sides))


def _gridded(vertices: Array, faces: Faces, cells: int) -> Surface:
    """Merge the corners of a surface in each cell of a grid to their mean."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    _, inverse = distinct((vertices - low) * (cells / size))
    count = np.bincount(inverse)
    middle = np.column_stack([np.bincount(inverse, weights=x) for x in vertices.T]) / count[:, None]
    kept = with_area(inverse[faces])
    first, _ = distinct(np.sort(kept, axis=1))
    return middle, kept[np.sort(first)]


def _hulls(shapes: Sequence[ImportedShape]) -> list[Surface]:
    """Compute hulls of meshes, of all together if there are many; flat ones have none."""
    clouds = [s.cloud for s in shapes]
    if len(clouds) > MAX_HULLS:
        clouds = [np.concatenate(clouds)]
    found = []
    for cloud in clouds:
        hull = convex_hull(cloud)
        if hull and len(hull[1]) > HULL_FACES:
            hull = convex_hull(decimate(*hull, HULL_FACES)[0])
        if hull:
            found.append(hull)
    return found


Pair = tuple[str, str]
FRAME = f"""<mujoco>
<compiler angle="radian" autolimits="true" inertiafromgeom="false" meshdir="meshes"/>
<option gravity="0 0 -{GRAVITY}" jacobian="dense"/>
<default>
<default class="visual"><geom contype="0" conaffinity="0" group="2" mass="0"/></default>
<default class="collision">
<geom contype="1" conaffinity="1" group="3" mass="0" rgba="0.2 0.5 0.9 0.4"/></default>
</default>
<asset/><worldbody/><contact/></mujoco>"""
"""What is drawn does not collide and the other way round; nothing that is drawn weighs."""
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2}
"""Count of size numbers of a primitive in MuJoCo, if not three."""
BALL = 0.008
"""Radius of a drawn marker, over the arm's reach [1]."""
MARKER, LOAD = "0.835 0.369 0 1", "0.1 0.1 0.1 1"
CHECKED_POSES = 300
MAX_CONTACT_SHARE = 0.5
"""Share of random poses beyond which contact of two parts is allowed [1]."""


def rigid_mjcf(
    chain: ImportedChain, tool: ImportedSite, points: Sequence[Point]
) -> tuple[ET.Element, dict[str, bytes], list[Pair]]:
    """Write the arm's rigid.xml.

    Args:
        chain: The arm.
        tool: Its tool, in the last part.
        points: Markers; the load point is last.

    Returns:
        Its root element, binary STL by file name in the folder `meshes`, and pairs of parts whose contact is
        allowed because they touch in most poses.

    Raises:
        BenchError: If MuJoCo refuses the arm.
    """
    root = ET.fromstring(FRAME)
    root.set("model", chain.name)
    compiler, _, _, asset, parent, contact = root
    meshes: dict[str, bytes] = {}
    for part in chain.parts:
        parent = _body(parent, part.name, part.pose)
        _filled(parent, part)
        meshes |= _shaped(parent, asset, part)
    _tool(parent, chain, tool, points)
    if not meshes:
        root.remove(asset)
        del compiler.attrib["meshdir"]
    ET.SubElement(contact, "exclude", body1=chain.parts[0].name, body2=chain.parts[1].name)
    touching = _always_touching(chain, ET.tostring(root, encoding="unicode"), meshes)
    for one, other in touching:
        ET.SubElement(contact, "exclude", body1=one, body2=other)
    return root, meshes, touching


def _body(parent: ET.Element, name: str, pose: Array) -> ET.Element:
    return ET.SubElement(parent, "body", {"name": name, **_placed(pose)})


def _placed(pose: Array) -> dict[str, str]:
    """Write attributes pos and quat of a pose, if they are not zero."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(pose[:3, :3]).ravel())
    quat *= np.sign(quat[np.argmax(np.abs(quat) > 1e-9)])
    found = {"pos": numbers_text(pose[:3, 3]), "quat": numbers_text(quat)}
    return {key: text for key, text in found.items() if text not in ("0 0 0", "1 0 0 0")}


def numbers_text(values: Array) -> str:
    """Write numbers to 1e-12, as short as that allows.

    Args:
        values: The numbers.

    Returns:
        The numbers, separated by blanks.
    """
    return " ".join(f"{round(float(x), 12) + 0.0:.12g}" for x in values)


def _filled(body: ET.Element, part: Body) -> None:
    """Write the joint and the mass of a part."""
    if (joint := part.joint) is not None:
        own = {"name": joint.name, "type": "slide" if joint.prismatic else "hinge"}
        ends = numbers_text(np.array([joint.lower, joint.upper]))
        ET.SubElement(body, "joint", {**own, "axis": numbers_text(joint.axis), "range": ends})
    inertia = plausible(part.inertia)
    stated = {"pos": numbers_text(part.com), "mass": f"{part.mass:.9g}"}
    if np.abs(inertia - np.diag(np.diag(inertia))).max() < 1e-9 * inertia.max():
        stated["diaginertia"] = _digits(np.diag(inertia))
    else:
        stated["fullinertia"] = _digits(inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)])
    ET.SubElement(body, "inertial", stated)


def _digits(values: Array) -> str:
    return " ".join(f"{x:.9g}" for x in values)


def _shaped(body: ET.Element, asset: ET.Element, part: Body) -> dict[str, bytes]:
    """Write the geoms of a part, and its mesh files.

    If nothing is drawn, colliding shapes are drawn; if nothing collides, the hull of the drawn shapes does.
    Rods do not collide: fixed in the zero pose, they stand in the arm's way.
    """
    drawn = visible_shapes(part.shapes)
    hard = [s for s in part.shapes if s.collides]
    meshes = {}

    def mesh(name: str, surface: Surface, looks: dict[str, str]) -> None:
        meshes[f"{name}.stl"] = stl_bytes(*surface)
        shell = {"inertia": "shell"} if looks["class"] == "visual" else {}
        ET.SubElement(asset, "mesh", {"name": name, "file": f"{name}.stl", **shell})
        ET.SubElement(body, "geom", {**looks, "type": "mesh", "mesh": name})

    if found := drawn_mesh(part):
        mesh(part.name, found[0], {"class": "visual", "rgba": _colour(found[1])})
    for solid in [s for s in drawn if s.kind != "mesh"]:
        ET.SubElement(body, "geom", {"class": "visual", **_solid(solid), "rgba": _colour(solid.rgba)})
    hulls = _hulls([s for s in hard if s.kind == "mesh"] if hard else [s for s in drawn if s.bears])
    for k, hull in enumerate(hulls):
        mesh(f"{part.name}.hull" + (f"_{k + 1}" if k else ""), hull, {"class": "collision"})
    for solid in [s for s in hard if s.kind != "mesh"]:
        ET.SubElement(body, "geom", {"class": "collision", **_solid(solid)})
    return meshes


def _solid(solid: ImportedShape) -> dict[str, str]:
    size = solid.size[: SIZES.get(solid.kind, 3)]
    return {"type": solid.kind, "size": numbers_text(size), **_placed(solid.pose)}


def _colour(rgba: Array) -> str:
    return " ".join(f"{x:.3g}" for x in np.clip(rgba, 0, 1))


def _tool(last: ET.Element, chain: ImportedChain, tool: ImportedSite, points: Sequence[Point]) -> None:
    """Write the tool with its markers and load point."""
    reach = sum(float(np.linalg.norm(part.pose[:3, 3])) for part in chain.parts[1:])
    body = _body(last, tool.name, tool.pose)
    for k, (name, position) in enumerate(points, start=1):
        rgba = LOAD if k == len(points) else MARKER
        looks = {"class": "visual", "type": "sphere", "size": f"{BALL * max(reach, 0.1):.2g}", "rgba": rgba}
        ET.SubElement(_body(body, name, pose_of(np.eye(3), position)), "geom", looks)


def _always_touching(chain: ImportedChain, xml: str, meshes: dict[str, bytes]) -> list[Pair]:
    """Find pairs of parts that touch in more than half of all poses."""
    try:
        model = mujoco.MjModel.from_xml_string(xml, meshes)
    except COMPILE_ERRORS as err:
        raise BenchError(f"{chain.name}: " + " ".join(f"MuJoCo refuses the arm: {err}".split())) from err
    file = Path(chain.name)
    check_geoms(file, model)
    data, seen = mujoco.MjData(model), Counter[tuple[str, str]]()
    lower, upper = np.array([(joint.lower, joint.upper) for joint in chain.joints]).T
    poses = np.random.default_rng(0).uniform(lower, upper, (CHECKED_POSES, chain.n_joints))
    for q in poses if chain.joint_map is None else chain.joint_map.with_dependent_joints(poses):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        compute_contacts(file, model, data)
        pairs = model.geom_bodyid[data.contact.geom[data.contact.dist < 0]]
        seen.update({(model.body(int(a)).name, model.body(int(b)).name) for a, b in np.sort(pairs, axis=1)})
    return sorted(pair for pair, count in seen.items() if count > MAX_CONTACT_SHARE * CHECKED_POSES)


# --- The elastic arm as MJCF: a file with its virtual joints, and copies of its meshes ----------------------


def write_elastic(arm: Arm, file: Path) -> None:
    """Write the elastic arm as plain MJCF that MuJoCo's own viewer opens.

    Mesh files are copied beside it.

    Args:
        arm: The arm.
        file: The MJCF to write; its folder is made where it does not exist.

    Raises:
        InputError: When a file cannot be read or written, or would replace another one.
    """
    source = arm.mjcf_path.parent
    if file.resolve().is_relative_to(source.resolve()):
        raise InputError(file, "", "expected a place outside the arm's own folder")
    text = elastic_mjcf(arm)
    meshes = read_meshes(
        {name: source / name for name in asset_paths(arm.mjcf_path, read_mjcf(arm.mjcf_path))}
    )
    for name, content in meshes.items():
        _check_mesh(content, file.parent / name, file.parent)
    with whole_files([*(file.parent / name for name in meshes), file]) as parts:
        for content, part in zip((*meshes.values(), text.encode()), parts, strict=True):
            part.write_bytes(content)


def _check_mesh(content: bytes, copy: Path, folder: Path) -> None:
    """Refuse a copy of a mesh outside of the folder, or in place of another file."""
    if not Path(os.path.realpath(copy)).is_relative_to(os.path.realpath(folder)):
        raise InputError(copy, "", f"expected a mesh inside of {folder}")
    if os.path.lexists(copy) and not (copy.is_file() and read_bytes(copy, MAX_MJCF_BYTES) == content):
        raise InputError(copy, "", "is not the arm's mesh; choose another folder, or move it away")
