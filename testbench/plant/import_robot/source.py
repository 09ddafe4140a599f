"""A stranger's XML, as far as any format goes: a file that is small, well-formed and of numbers."""

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from testbench.arm.decimal import WRITTEN, read_decimals
from testbench.arm.document import parse_xml
from testbench.errors import Array, InputError, read_text, word
from testbench.plant.import_robot.chain import pose_of, turned

MAX_BYTES = 16_000_000
MAX_ELEMENTS = 20_000
MAX_DEPTH = 150
MAX_SHAPES = 2000  #: Of a robot: every <geometry> of URDF, every <geom> of MJCF.
LARGEST = 1e9  #: Of any number that is read; what an arm can have is checked on the whole tree.


def read_xml(file: Path) -> ET.Element:
    """The root element of a file.

    Raises:
        InputError: When it is missing, too large, not well-formed, or says more than a robot can have.
    """
    text = read_text(file, MAX_BYTES)
    if "<xacro:" in re.sub("<!--.*?-->", "", text, flags=re.DOTALL) or file.suffix == ".xacro":
        new = ".urdf" if file.suffix == ".xacro" else "_expanded.urdf"  # a shell empties what it writes first
        target = file.name.removesuffix(".xacro").removesuffix(".urdf") + new
        done = f"xacro {word(Path(file.name))} > {word(Path(target))}"
        raise InputError(file, "", f"this is xacro; expand it first: {done}")
    root = parse_xml(file, text)
    level, count = [root], 0
    for _ in range(MAX_DEPTH):
        count += len(level)
        level = [child for e in level for child in e]
    if level or count > MAX_ELEMENTS:
        raise InputError(file, "", f"expected at most {MAX_ELEMENTS} elements, {MAX_DEPTH} deep")
    return root


def check_shapes(file: Path, root: ET.Element, tag: str) -> None:
    """Refuse a robot of more shapes than any has with an InputError."""
    count = sum(1 for _ in root.iter(tag))
    if count > MAX_SHAPES:
        raise InputError(file, f"<{tag}>", f"expected at most {MAX_SHAPES} shapes, got {count}")


def where(e: ET.Element) -> str:
    """An element, for a message."""
    return f"<{e.tag} name={e.get('name')!r}>" if e.get("name") else f"<{e.tag}>"


def read_numbers(file: Path, e: ET.Element, key: str, default: str, count: int) -> Array:
    """An attribute as so many numbers, (count,).

    Raises:
        InputError: When it is something else.
    """
    text = e.get(key, default)
    try:
        values = read_decimals(text.split())
    except ValueError:
        values = []
    if len(values) != count or not all(abs(x) <= LARGEST for x in values):
        problem = f"{key}: expected {count} number(s) up to {LARGEST:g}, got {text[:80]!r}"
        raise InputError(file, where(e), problem)
    return np.array(values)


def check_numbers(file: Path, e: ET.Element, key: str) -> None:
    """Refuse an attribute that Python reads as numbers if one of them is no decimal, or too large."""
    text = e.get(key, "")
    try:
        list(map(float, text.split()))
    except ValueError:
        return  # words
    try:
        sound = all(abs(x) <= LARGEST for x in read_decimals(text.split()))
    except ValueError:
        sound = False
    if not sound:
        problem = f"{key}: expected numbers up to {LARGEST:g}, {WRITTEN}, got {text[:80]!r}"
        raise InputError(file, where(e), problem)


def read_number(file: Path, e: ET.Element, key: str, default: float) -> float:
    """An attribute as a number; the default where it is missing."""
    return float(read_numbers(file, e, key, repr(default), 1)[0])


def need(file: Path, e: ET.Element, key: str) -> str:
    """An attribute that must be there.

    Raises:
        InputError: When it is not, or is empty.
    """
    text = e.get(key, "")
    if not text.strip():
        raise InputError(file, where(e), f"expected an attribute {key}")
    return text


def read_origin(file: Path, e: ET.Element) -> Array:
    """The pose of an element's <origin>, (4, 4) [m]; the identity where it has none."""
    origin = e.find("origin")
    if origin is None:
        return np.eye(4)
    rpy = read_numbers(file, origin, "rpy", "0 0 0", 3)
    return pose_of(turned(rpy), read_numbers(file, origin, "xyz", "0 0 0", 3))


def inside(folder: Path, file: Path) -> Path | None:
    """A file of a folder, symbolic links followed; None where it lies elsewhere."""
    home = os.path.realpath(folder)
    try:
        real = Path(os.path.realpath(Path(home) / file))
    except ValueError:  # a zero byte
        return None
    return real if real.is_relative_to(home) else None
