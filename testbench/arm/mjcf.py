"""Untrusted MJCF and mesh files of an arm: checked before MuJoCo reads them.

MJCF can include any file of the disk, replicate without end and crash a reader. So an arm's file may contain
only listed elements, with only listed attributes where the model reads them or gravity could change.
"""

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from testbench.arm.document import (
    MAX_SHOWN_LENGTH,
    NUMBER_EXAMPLES,
    parse_xml,
    path_inside,
    read_decimals,
    xml_place,
)
from testbench.errors import InputError, read_bytes, read_text, some_of

# --- MJCF: allowed elements and attributes, and their values ------------------------------------------------

PLACEMENT_ATTRIBUTES = "pos quat axisangle euler xyaxes zaxis"  #: Attributes that place an element.
ALLOWED_ELEMENTS = frozenset(
    "mujoco compiler option flag visual global quality headlight map scale rgba statistic asset material mesh"
    " default worldbody body inertial joint geom light camera contact exclude".split()
)
"""Elements that an arm's MJCF may contain: rigid bodies on joints, and meshes; no springs, motors or wind."""
ALLOWED_ATTRIBUTES = {
    element: frozenset(attributes.split())
    for element, attributes in {
        "compiler": "angle autolimits inertiafromgeom meshdir",
        "option": "gravity jacobian timestep integrator cone solver iterations tolerance",
        "flag": "contact filterparent midphase nativeccd multiccd energy",
        "mesh": "name class file scale refpos refquat inertia smoothnormal maxhullvert vertex normal face",
        "body": f"name childclass {PLACEMENT_ATTRIBUTES}",
        "inertial": f"mass diaginertia fullinertia {PLACEMENT_ATTRIBUTES}",
        "joint": "name type axis pos range limited armature damping group",
    }.items()
}
"""Attributes that an element may have, by its tag: the model would miss others, such as gravity off. Elements
that are not listed may have any."""
ATTRIBUTE_SIZES = {
    **{"pos": 3, "quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3},
    **{"diaginertia": 3, "fullinertia": 6},
}
"""Count of numbers in each attribute that places a body or gives its inertia."""
MAX_ATTRIBUTE_VALUE = 1e6
"""Largest angle, mass or inertia of an arm [deg, rad, kg, kg m^2]; beyond it an exponent is wrong."""
MAX_LENGTH = 1000.0  #: Largest length [m].
MAX_MJCF_BYTES = 4_000_000  #: Largest size of an arm's MJCF [byte].
GRAVITY = 9.81  #: Gravitational acceleration along -z of every cell [m/s^2]; MuJoCo's default.


def read_mjcf(path: Path) -> ET.Element:
    """Read the MJCF of an arm, and check that it contains allowed elements and attributes only.

    Args:
        path: The file.

    Returns:
        Root element of the MJCF.

    Raises:
        InputError: When it is missing, too large, not well-formed, or has an element or attribute that is not
            allowed.
    """
    root = parse_xml(path, read_text(path, MAX_MJCF_BYTES))
    if root.tag != "mujoco":
        raise InputError(path, "", f"expected <mujoco> at the top, got <{root.tag}>")
    _check_elements(path, root)
    _check_files(path, root)
    return root


def _check_elements(path: Path, root: ET.Element) -> None:
    for e in root.iter():
        if e.tag not in ALLOWED_ELEMENTS:
            allowed = f"not allowed in an arm; allowed are {', '.join(sorted(ALLOWED_ELEMENTS))}"
            if e.tag in ("equality", "tendon"):
                allowed = "not allowed in rigid.xml; describe dependent joints in [joints] of elastic.toml"
            raise InputError(path, f"<{e.tag}>", allowed)
        _check_values(path, e)


def _parse_numbers(text: str, count: int, largest: float) -> list[float] | None:
    """Read at most so many numbers, none of them larger; None where the text is something else."""
    try:
        values = read_decimals(text.split(maxsplit=count))
    except ValueError:
        return None
    return values if len(values) <= count and all(abs(x) <= largest for x in values) else None


def _check_values(path: Path, e: ET.Element) -> None:
    known = ALLOWED_ATTRIBUTES.get(e.tag)
    if known is not None and (extra := [key for key in e.attrib if key not in known]):
        problem = f"{extra[0][:MAX_SHOWN_LENGTH]!r} is not allowed; allowed are {', '.join(sorted(known))}"
        raise InputError(path, xml_place(e), problem)
    if e.tag == "default" and e.find("joint") is not None:
        raise InputError(
            path, xml_place(e), "joint defaults are not allowed; write these attributes at each joint"
        )
    if e.tag == "option" and "gravity" in e.attrib:
        gravity = attribute_numbers(path, e, "gravity", 3)
        if gravity != [0.0, 0.0, -GRAVITY]:
            raise InputError(path, xml_place(e), f"gravity: expected '0 0 -{GRAVITY}', got {gravity}")
    if e.tag == "compiler" and e.get("angle", "degree") not in ("degree", "radian"):
        problem = f"angle: expected 'degree' or 'radian', got {e.get('angle')!r}"
        raise InputError(path, xml_place(e), problem)
    if e.tag == "inertial":
        [mass], _ = attribute_numbers(path, e, "mass", 1), attribute_numbers(path, e, "pos", 3)
        if not mass > 0:
            raise InputError(path, xml_place(e), f"mass: expected more than 0 kg, got {mass}")
    for key, count in ATTRIBUTE_SIZES.items() if e.tag in ("body", "inertial") else ():
        if key in e.attrib:
            attribute_numbers(path, e, key, count, MAX_LENGTH if key == "pos" else MAX_ATTRIBUTE_VALUE)


def _check_files(path: Path, root: ET.Element) -> None:
    """Check that every file that the MJCF names lies in the arm's folder, symbolic links followed."""
    folder = _mesh_folder(path, root)
    for e in root.iter():
        for key in [key for key in ("file", "meshdir") if key in e.attrib]:
            bases = (path.parent.absolute(), folder.absolute())
            if not all(path_inside(path.parent, base / e.attrib[key]) for base in bases):
                problem = f"{key}: expected a file inside the arm's folder"
                raise InputError(path, xml_place(e), problem)


def _mesh_folder(path: Path, root: ET.Element) -> Path:
    """Return the folder of meshes: the last <compiler> with a meshdir counts."""
    folders = [c.attrib["meshdir"] for c in root.iter("compiler") if "meshdir" in c.attrib]
    return path.parent / (folders[-1] if folders else "")


def mesh_files(path: Path, root: ET.Element) -> dict[str, Path]:
    """List the mesh files that an MJCF names.

    Args:
        path: Path of the MJCF.
        root: Its root element.

    Returns:
        Path of every file, by the file's name in the MJCF.
    """
    folder = _mesh_folder(path, root)
    return {name: folder / name for e in root.iter("mesh") if (name := e.get("file"))}


def asset_paths(path: Path, root: ET.Element) -> list[str]:
    """List the paths of the mesh files that an MJCF names, for a copy of the arm's folder.

    Args:
        path: Path of the MJCF.
        root: Its root element.

    Returns:
        Paths relative to the folder of the MJCF, sorted.

    Raises:
        InputError: When a path is absolute or leads out of the folder, so that a copy of the folder lacks the
            file.
    """
    folder, paths = path.parent.absolute(), set()
    for name, file in mesh_files(path, root).items():
        real = os.path.normpath(file.absolute())
        if Path(name).is_absolute() or not Path(real).is_relative_to(folder):
            raise InputError(
                path, f"<mesh file={name!r}>", "file: expected a path relative to the arm's folder"
            )
        paths.add(Path(real).relative_to(folder).as_posix())
    return sorted(paths)


def attribute_numbers(
    path: Path,
    element: ET.Element,
    attribute: str,
    count: int,
    max_value: float = MAX_ATTRIBUTE_VALUE,
    ancestor: ET.Element | None = None,
) -> list[float]:
    """Read an attribute of an MJCF or URDF element that consists of a fixed count of numbers.

    Args:
        path: Path of the file, for messages.
        element: The element.
        attribute: Name of the attribute.
        count: Count of numbers.
        max_value: Largest absolute value of a number, in units of the file.
        ancestor: A named element that contains it, for messages; None for none.

    Returns:
        The numbers, in units of the file.

    Raises:
        InputError: When the attribute is missing, has another count, or a number is larger or not finite.
    """
    text = element.get(attribute)
    if text is None:
        raise InputError(
            path,
            xml_place(element, ancestor),
            f"expected an attribute {attribute} of {count} number(s)",
        )
    values = _parse_numbers(text, count, max_value)
    if values is None or len(values) != count:
        most = f" up to {max_value:g}" if math.isfinite(max_value) else ""
        problem = f"expected {count} number(s){most}, {NUMBER_EXAMPLES}, got {text[:MAX_SHOWN_LENGTH]!r}"
        raise InputError(path, xml_place(element, ancestor), f"{attribute}: {problem}")
    return values


def angle_unit(root: ET.Element) -> float:
    """Return the unit of the angles in an MJCF [rad], given its root element: pi / 180 by default."""
    angle = "degree"
    for compiler in root.iter("compiler"):
        angle = compiler.get("angle", angle)
    return 1.0 if angle == "radian" else math.pi / 180


def find_body(path: Path, root: ET.Element, name: str) -> ET.Element:
    """Find the <body> element of an MJCF that has a given name.

    Args:
        path: Path of the MJCF, for messages.
        root: Its root element.
        name: Name of the body.

    Returns:
        The element.

    Raises:
        InputError: When no body, or more than one, has this name.
    """
    names = [b.get("name") for b in root.iter("body")]
    matches = [b for b in root.iter("body") if b.get("name") == name]
    if len(matches) != 1:
        what = "no body" if not matches else f"{len(matches)} bodies"
        raise InputError(path, "", f"{what} {name!r}; bodies are {some_of(names)}")
    return matches[0]


# --- Mesh files: checked for kind and size, and read --------------------------------------------------------

MESH_SUFFIXES = ("stl", "obj", "msh")  #: Suffixes of mesh files that MuJoCo reads.
MAX_MESH_BYTES = 64_000_000  #: Largest mesh file [byte].
MAX_ALL_MESH_BYTES = 256_000_000  #: Largest size of all mesh files of an arm together [byte].


def read_meshes(files: Mapping[str, Path]) -> dict[str, bytes]:
    """Read the mesh files of an arm.

    Args:
        files: Path of every file, by the file's name in the MJCF.

    Returns:
        Content of every file, by the same names.

    Raises:
        InputError: When a file is a folder or device, of a kind that MuJoCo does not read, or too large; or
            when all files together are too large.
    """
    contents: dict[str, bytes] = {}
    for name, file in files.items():
        if file.suffix[1:].lower() not in MESH_SUFFIXES:
            raise InputError(file, "", f"expected a mesh: {', '.join(MESH_SUFFIXES)}")
        contents[name] = read_bytes(file, MAX_MESH_BYTES)
        if sum(map(len, contents.values())) > MAX_ALL_MESH_BYTES:
            raise InputError(
                file, "", f"expected at most {MAX_ALL_MESH_BYTES} bytes in all meshes of an arm together"
            )
    return contents
