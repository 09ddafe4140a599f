"""A stranger's MJCF, read as text: what an arm may contain, and where its chain is.

MJCF can include any file of the disk, replicate without end and crash a reader; so an arm's file
passes an allow-list of elements before MuJoCo or Pinocchio see it.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from testbench.errors import InputError

MAX_BYTES = 4_000_000
MAX_DEPTH = 64
ELEMENTS = frozenset(
    "mujoco compiler option flag size visual global headlight quality map rgba scale statistic asset "
    "material mesh default worldbody body inertial joint geom light camera contact exclude".split()
)
COMPILER = frozenset("angle autolimits inertiafromgeom meshdir".split())
JOINT = frozenset("name type axis pos range limited armature damping group".split())
GRAVITY = 9.81
"""Gravitational acceleration along -z of every cell [m/s^2]; MuJoCo's default."""


def read_mjcf(path: Path) -> ET.Element:
    """The root element of an arm's MJCF, after the allow-list.

    Args:
        path: The file.

    Raises:
        InputError: When it is missing, too large, not well-formed, or holds what an arm may not.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(path, "", f"expected at most {MAX_BYTES} bytes")
        text = path.read_bytes()
    except OSError as err:
        raise InputError(path, "", f"cannot be read: {err.strerror}") from err
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise InputError(path, "", "document types and entities are not allowed")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, UnicodeDecodeError, LookupError, ValueError) as err:
        raise InputError(path, "", f"not well-formed XML: {err}") from err
    if root.tag != "mujoco":
        raise InputError(path, "", f"expected <mujoco> at the top, got <{root.tag}>")
    _check_elements(path, root)
    return root


def _check_elements(path: Path, root: ET.Element) -> None:
    level = [root]
    for depth in range(MAX_DEPTH + 1):
        for e in level:
            if e.tag not in ELEMENTS:
                raise InputError(
                    path, f"<{e.tag}>", f"not allowed in an arm; allowed are {sorted(ELEMENTS)}"
                )
            _check_attributes(path, e)
        level = [child for e in level for child in e]
        if not level:
            return
        if depth == MAX_DEPTH:
            raise InputError(path, "", f"expected at most {MAX_DEPTH} nested elements")


def _check_attributes(path: Path, e: ET.Element) -> None:
    where = f"<{e.tag} name={e.get('name')!r}>" if e.get("name") else f"<{e.tag}>"
    for key, value in e.attrib.items():
        if any(word.lower() in ("nan", "inf", "-inf", "+inf", "infinity") for word in value.split()):
            raise InputError(path, where, f"{key}: expected finite numbers, got {value!r}")
    known = {"compiler": COMPILER, "joint": JOINT}.get(e.tag)
    if known and not set(e.attrib) <= known:
        extra = sorted(set(e.attrib) - known)
        raise InputError(path, where, f"not allowed: {extra}; allowed are {sorted(known)}")
    if e.tag == "default" and e.find("joint") is not None:
        raise InputError(path, where, "no defaults for joints: write them at the joint")
    if e.tag == "option" and "gravity" in e.attrib:
        gravity = numbers(path, e, "gravity", 3)
        if gravity != [0.0, 0.0, -GRAVITY]:
            raise InputError(path, where, f"gravity: expected '0 0 -{GRAVITY}', got {gravity}")
    for key in ("file", "meshdir"):
        inside = (path.parent / e.get(key, "")).resolve()
        if not inside.is_relative_to(path.parent.resolve()):
            raise InputError(path, where, f"{key}: expected a file inside the arm's folder")
    if e.tag == "inertial":
        mass = numbers(path, e, "mass", 1)[0]
        if not mass > 0:
            raise InputError(path, where, f"mass: expected more than 0 kg, got {mass}")
        numbers(path, e, "pos", 3)


def numbers(path: Path, e: ET.Element, key: str, count: int) -> list[float]:
    """An attribute as finite numbers.

    Args:
        path: The file, for the message.
        e: The element.
        key: The attribute.
        count: How many numbers it must hold.

    Raises:
        InputError: When it is missing or is something else.
    """
    where = f"<{e.tag} name={e.get('name')!r}>" if e.get("name") else f"<{e.tag}>"
    text = e.get(key)
    if text is None:
        raise InputError(path, where, f"expected an attribute {key} of {count} number(s)")
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(path, where, f"{key}: expected {count} finite number(s), got {text!r}")
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
    found = [b for b in root.iter("body") if b.get("name") == name]
    if len(found) != 1:
        names = [b.get("name") for b in root.iter("body")]
        what = "no body" if not found else f"{len(found)} bodies"
        raise InputError(path, "", f"{what} {name!r}; bodies are {names}")
    return found[0]
