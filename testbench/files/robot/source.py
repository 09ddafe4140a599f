"""XML of a robot's file, whatever its format: limited in size, well-formed, with finite numbers."""

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

from testbench.arm.document import parse_xml
from testbench.errors import InputError, read_text, shell_word

MAX_BYTES = 16_000_000
MAX_ELEMENTS = 20_000
MAX_DEPTH = 150
MOST_OF = {"geometry": 2000, "geom": 2000, "joint": 500, "body": 500}
"""Most elements of a kind: MuJoCo's time grows with the cube of bodies in a row."""
MAX_PACKAGE = 1_000_000
"""Largest package.xml [byte]."""
UP = 8
"""Folders above the URDF in which a package is searched."""
FIND = re.compile(r"\$\(find ([\w-]+)\)")
"""Reference to a package in xacro."""


def read_xml(file: Path) -> ET.Element:
    """Read the root element of a file.

    Args:
        file: The URDF or MJCF.

    Returns:
        The root element.

    Raises:
        InputError: If the file is missing, too large, not well-formed, or has more elements than a robot can.
    """
    text = read_text(file, MAX_BYTES)
    if (start := text.strip("\ufeff \t\r\n")) and not start.startswith("<"):
        problem = "expected a URDF or MJCF, which begin with <; how to write a DH table as URDF is in"
        raise InputError(file, "", f"{problem} docs/robot_files.md")
    if "<xacro:" in re.sub("<!--.*?-->", "", text, flags=re.DOTALL) or file.suffix == ".xacro":
        raise InputError(file, "", f"this is xacro; expand it first: {_expand(file, text)}")
    root = parse_xml(file, text)
    level, count = [root], 0
    for _ in range(MAX_DEPTH):
        count += len(level)
        level = [child for e in level for child in e]
    if level or count > MAX_ELEMENTS:
        raise InputError(file, "", f"expected at most {MAX_ELEMENTS} elements, {MAX_DEPTH} deep")
    for tag, most in MOST_OF.items():
        if (count := sum(1 for _ in root.iter(tag))) > most:
            raise InputError(file, f"<{tag}>", f"expected at most {most} in a robot, got {count}")
    return root


def _expand(file: Path, text: str) -> str:
    """Write the command that expands xacro without ROS, with the folders of the packages in the file."""
    target = file.with_name(f"{file.name.split('.')[0]}_expanded.urdf")
    found = [packages(Path(os.path.realpath(file)).parent, name) for name in FIND.findall(text)]
    where = dict.fromkeys(f" -d {shell_word(roots[0].parent)}" for roots in found if roots)
    done = f"xacrodoc {shell_word(file)}{''.join(where)} -o {shell_word(target)}"
    return f"pip install xacrodoc; {done}; arguments of the file follow as NAME:=VALUE"


def packages(folder: Path, name: str) -> list[Path]:
    """Find the folders of a ROS package, searching from the URDF's folder upwards.

    A folder counts if it has the package's name, or if its package.xml states that name.

    Args:
        folder: Folder of the URDF.
        name: Name of the package.

    Returns:
        The folders, nearest first; empty if there are none.
    """
    if name in ("", ".", ".."):
        return []
    paths = []
    for above in [folder, *folder.parents][:UP]:
        paths += [root for root in (above, above / name) if root.name == name and root.is_dir()]
        if _package_name(above / "package.xml") == name:
            paths.append(above)
    return paths


def _package_name(file: Path) -> str:
    try:
        return (parse_xml(file, read_text(file, MAX_PACKAGE)).findtext("name") or "").strip()
    except InputError:  # there is none, or it is none
        return ""
