"""A stranger's MJCF, read as text: what an arm may contain, and where its chain is.

MJCF can include any file of the disk, replicate without end and crash a reader; so an arm's file
passes an allow-list of elements before MuJoCo or Pinocchio see it.
"""

import math
import os
import xml.etree.ElementTree as ET
from pathlib import Path

from testbench.arm.document import parse_xml
from testbench.arm.lines import xml_place
from testbench.errors import InputError, read_text

MAX_BYTES = 4_000_000
MAX_DEPTH = 64
ELEMENTS = frozenset(
    "mujoco compiler option flag visual global headlight quality map rgba scale statistic asset "
    "material mesh default worldbody body inertial joint geom light camera contact exclude".split()
)
ATTRIBUTES = {
    "compiler": frozenset("angle autolimits inertiafromgeom meshdir".split()),
    "option": frozenset("gravity jacobian timestep integrator cone solver iterations tolerance".split()),
    "flag": frozenset("contact filterparent midphase nativeccd multiccd energy".split()),
    "body": frozenset("name childclass pos quat axisangle euler xyaxes zaxis".split()),
    "joint": frozenset("name type axis pos range limited armature damping group".split()),
}
"""What may be said of the elements that statics depends on: no wind, no gravcomp, gravity never off."""
NUMBERS = {
    **{"pos": 3, "quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3},
    **{"diaginertia": 3, "fullinertia": 6},
}
"""How many numbers place a body or give its inertia."""
LARGEST = 1e6  #: Largest length, angle, mass or inertia of an arm; beyond it an exponent is a slip.
GRAVITY = 9.81  #: Gravitational acceleration along -z of every cell [m/s^2]; MuJoCo's default.


def read_mjcf(path: Path) -> ET.Element:
    """The root element of an arm's MJCF, after the allow-list.

    Raises:
        InputError: When it is missing, too large, not well-formed, or holds what an arm may not.
    """
    root = parse_xml(path, read_text(path, MAX_BYTES))
    if root.tag != "mujoco":
        raise InputError(path, "", f"expected <mujoco> at the top, got <{root.tag}>")
    _check_elements(path, root)
    _check_files(path, root)
    return root


def _check_elements(path: Path, root: ET.Element) -> None:
    level = [root]
    for _ in range(MAX_DEPTH + 1):
        for e in level:
            if e.tag not in ELEMENTS:
                raise InputError(path, f"<{e.tag}>", f"not allowed in an arm; allowed are {sorted(ELEMENTS)}")
            _check_attributes(path, e)
        level = [child for e in level for child in e]
    if level:
        raise InputError(path, "", f"expected at most {MAX_DEPTH} nested elements")


def _check_attributes(path: Path, e: ET.Element) -> None:
    for key, value in e.attrib.items():
        if not all(map(_finite, value.split())):
            raise InputError(path, xml_place(path, e), f"{key}: expected finite numbers, got {value!r}")
    known = ATTRIBUTES.get(e.tag)
    if known and not set(e.attrib) <= known:
        extra = sorted(set(e.attrib) - known)
        raise InputError(path, xml_place(path, e), f"not allowed: {extra}; allowed are {sorted(known)}")
    if e.tag == "default" and e.find("joint") is not None:
        raise InputError(path, xml_place(path, e), "no defaults for joints: write them at the joint")
    _check_values(path, e)


def _check_values(path: Path, e: ET.Element) -> None:
    if e.tag == "option" and "gravity" in e.attrib:
        gravity = numbers(path, e, "gravity", 3)
        if gravity != [0.0, 0.0, -GRAVITY]:
            raise InputError(path, xml_place(path, e), f"gravity: expected '0 0 -{GRAVITY}', got {gravity}")
    if e.tag == "compiler" and e.get("angle", "degree") not in ("degree", "radian"):
        raise InputError(
            path, xml_place(path, e), f"angle: expected 'degree' or 'radian', got {e.get('angle')!r}"
        )
    if e.tag == "inertial":
        [mass], _ = numbers(path, e, "mass", 1), numbers(path, e, "pos", 3)
        if not mass > 0:
            raise InputError(path, xml_place(path, e), f"mass: expected more than 0 kg, got {mass}")
    for key, count in NUMBERS.items() if e.tag in ("body", "inertial") else ():
        if key in e.attrib:
            numbers(path, e, key, count)


def _check_files(path: Path, root: ET.Element) -> None:
    """Every file that the MJCF names lies in the arm's folder, symbolic links followed."""
    folder = path.parent
    meshdir = folder.joinpath(*(c.get("meshdir", "") for c in root.iter("compiler")))
    for e in root.iter():
        for key in [key for key in ("file", "meshdir") if key in e.attrib]:
            for base in (folder, meshdir):
                real = os.path.realpath(base / e.attrib[key])
                if not Path(real).is_relative_to(os.path.realpath(folder)):
                    raise InputError(
                        path, xml_place(path, e), f"{key}: expected a file inside the arm's folder"
                    )


def assets(path: Path, root: ET.Element) -> list[str]:
    """Files that the MJCF names, such as meshes, by their paths from its folder.

    Raises:
        InputError: When one is named by a path that no copy of the folder has.
    """
    folder, found = path.parent.absolute(), set()
    meshdir = ([c.attrib["meshdir"] for c in root.iter("compiler") if "meshdir" in c.attrib] or [""])[-1]
    for e in root.iter():
        if "file" not in e.attrib:
            continue
        name = os.path.normpath(folder / meshdir / e.attrib["file"])
        if Path(e.attrib["file"]).is_absolute() or not Path(name).is_relative_to(folder):
            raise InputError(path, xml_place(path, e), "file: expected a path from the arm's folder")
        found.add(Path(name).relative_to(folder).as_posix())
    return sorted(found)


def _finite(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return True  # a word


def numbers(path: Path, e: ET.Element, key: str, count: int) -> list[float]:
    """An attribute of an element as so many numbers, finite and of a size that an arm can have.

    Raises:
        InputError: When it is missing, is something else, or is larger than LARGEST.
    """
    text = e.get(key)
    if text is None:
        raise InputError(path, xml_place(path, e), f"expected an attribute {key} of {count} number(s)")
    try:
        values = [] if "_" in text else [float(word) for word in text.split()]  # Python reads 1_0 as 10
    except ValueError:
        values = []
    if len(values) != count or not all(abs(x) <= LARGEST for x in values):
        problem = f"expected {count} number(s) up to {LARGEST:g}, got {text!r}"
        raise InputError(path, xml_place(path, e), f"{key}: {problem}")
    return values


def angle_unit(root: ET.Element) -> float:
    """Radians in one unit of the file's angles: MJCF's default is the degree."""
    angle = "degree"
    for compiler in root.iter("compiler"):
        angle = compiler.get("angle", angle)
    return 1.0 if angle == "radian" else math.pi / 180


def find_body(path: Path, root: ET.Element, name: str) -> ET.Element:
    """The body of that name.

    Raises:
        InputError: When there is none, or more than one.
    """
    names = [b.get("name") for b in root.iter("body")]
    found = [b for b in root.iter("body") if b.get("name") == name]
    if len(found) != 1:
        what = "no body" if not found else f"{len(found)} bodies"
        raise InputError(path, "", f"{what} {name!r}; bodies are {names}")
    return found[0]
