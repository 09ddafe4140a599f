"""A robot's URDF as text: only the origins of joints are replaced, every other character stays."""

from collections.abc import Mapping
from pathlib import Path
from xml.parsers import expat

import numpy as np

from testbench.errors import Array, InputError

DECIMALS = 12  #: Decimals of a metre or radian.
BESIDE = "what a URDF cannot hold is in the JSON beside it -->\n"
STAMP = f"<!-- testbench export: origins as identified; {BESIDE}"
NEW_STAMP = f"<!-- testbench export: a new URDF of an identified arm; {BESIDE}"
"""First line of every URDF that we write: into a robot's own, and from scratch."""
HEAD = rb"\s*(<\?xml[^>]*\?>)?\s*"
BEGINS, BEGINS_NEW = HEAD + rb"<!-- testbench export: ", HEAD + rb"<!-- testbench export: a new URDF"


def rpy_of(R: Array) -> Array:
    """Compute roll, pitch and yaw of a rotation R = Rz Ry Rx, accurate near a pitch of 90 degrees too.

    Args:
        R: Rotation matrix, (3, 3) [1].

    Returns:
        Roll, pitch, yaw, (3,) [rad].
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def words(values: Array) -> str:
    """Write numbers as a URDF has them, with at most `DECIMALS` decimals and no needless zeros.

    Args:
        values: Numbers, (k,).

    Returns:
        The numbers with a space between them.
    """
    texts = (f"{x:.{DECIMALS}f}".rstrip("0").rstrip(".") for x in np.round(values, DECIMALS) + 0.0)
    return " ".join(texts)


def origin_of(pose: Array) -> dict[str, str]:
    """Write the attributes xyz and rpy of an <origin> element.

    Args:
        pose: Homogeneous transform, (4, 4) [1, m].

    Returns:
        Texts by attribute.
    """
    return {"xyz": words(pose[:3, 3]), "rpy": words(rpy_of(pose[:3, :3]))}


def with_origins(path: Path, text: str, poses: Mapping[str, Array]) -> str:
    """Replace the origins of some joints in the text of a URDF, and add our stamp.

    Args:
        path: The file, for messages.
        text: A well-formed URDF.
        poses: New pose of a joint in the link before it, (4, 4) [1, m], by the joint's name.

    Returns:
        The new text.

    Raises:
        InputError: When a joint is not in the URDF.
    """
    data = text.encode()
    spans = _origins(data)
    if missing := [name for name in poses if name not in spans]:
        raise InputError(path, "", f"no joint {missing[0]!r}")
    # from the end of the text on, so that earlier places stay where they are
    for name in sorted(poses, key=spans.__getitem__, reverse=True):
        start, end = spans[name]
        closes = b">" if start < end and data[end - 2 : end - 1] != b"/" else b"/>"
        said = "".join(f' {key}="{value}"' for key, value in origin_of(poses[name]).items())
        data = data[:start] + b"<origin" + said.encode() + closes + data[end:]
    head = data.index(b"?>") + 2 if data.startswith(b"<?xml") else 0
    return (data[:head] + b"\n" * (head > 0) + STAMP.encode() + data[head:].lstrip(b"\r\n")).decode()


def _origins(data: bytes) -> dict[str, tuple[int, int]]:
    """Find the bytes of the <origin> of every joint, or where one can stand if there is none."""
    found: dict[str, tuple[int, int]] = {}
    above: list[tuple[str, str]] = []
    seen: set[str] = set()
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        """Record where an origin begins and ends.

        Args:
            tag: Name of the element that begins.
            attributes: Its attributes.
        """
        at = parser.CurrentByteIndex
        within = [name for name, _ in above]
        if within == ["robot"] and tag == "joint":
            end = _end_of_tag(data, at)
            found.setdefault(attributes.get("name", ""), (end, end))
        elif within == ["robot", "joint"] and tag == "origin" and above[-1][1] not in seen:
            found[above[-1][1]] = at, _end_of_tag(data, at)
            seen.add(above[-1][1])
        above.append((tag, attributes.get("name", "")))

    def end_of(_: str) -> None:
        above.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end_of
    parser.Parse(data, True)
    return found


def _end_of_tag(data: bytes, start: int) -> int:
    """Find the byte behind the `>` that closes a tag; values in quotes may hold one too."""
    quote: bytes = b""
    for at in range(start, len(data)):
        here = data[at : at + 1]
        if quote:
            quote = b"" if here == quote else quote
        elif here in (b'"', b"'"):
            quote = here
        elif here == b">":
            return at + 1
    return len(data)
