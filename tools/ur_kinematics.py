"""Write the identified geometry of a UR into the kinematics file of its ROS driver.

    python tools/ur_kinematics.py MODEL my_robot.yaml [--out my_robot_calibrated.yaml] [--force]

The file is the one that `ur_calibration` extracts: `kinematics`, the pose of every joint's frame in the one
before, its z axis the joint's [m, rad], in block or flow style. Only these 36 numbers change; `hash` names
the controller's own calibration and stays. What the file cannot hold goes into JSON beside it, as of
`testbench export`. Read back, the tool is within 1 um of the model.
"""

import argparse
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from testbench.arm.document import parse_xml
from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError, InputError, read_bytes
from testbench.files.export import BEGINS, MAX_BYTES, STAMP, Draft, companion_path, export, six_axes
from testbench.files.export_own import chain_of, identified_rigid, place_frames, robot_origins, rpy_of
from testbench.identify.absolute.state import ArmState
from testbench.runs.whole import Kind, check_file
from testbench.workflows.arm_models import load_model

BYTES = "latin-1"  #: A byte a character, whatever the encoding is.
TITLE = "kinematics of a UR driver"
FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = tuple(f"{frame}.{key}" for frame in FRAMES for key in ("x", "y", "z", "roll", "pitch", "yaw"))
NUMBER = r"(?P<number>[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)(?![\w.])"
LINE = re.compile(
    r"(?m)(?:^[ \t]++|(?<=[{,])[ \t]*+)[\"']?(?P<key>\w++)[\"']?:[ \t]*+"
    rf"(?:{NUMBER}[ \t]*+(?=[,}}#\r]|$)|(?=\{{)|(?=[ \t]*(?:#|\r?$)))"
)
"""A line `x: 0.1` of YAML in block style, or the same between braces; and a head of keys, in either style."""


def find(file: Path, text: str) -> Mapping[str, re.Match[str]]:
    """Find the 36 numbers in a text by their keys; InputError where one is missing or stands twice."""
    start = re.search(r"(?m)^kinematics:", text)
    found: dict[str, re.Match[str]] = {}
    above = ""
    for match in LINE.finditer(text, start.start()) if start else ():
        if match["number"] is None:
            above = f"{match['key']}."
        elif (key := above + match["key"]) in found:
            raise InputError(file, key, "is there twice")
        else:
            found[key] = match
    for key in KEYS:
        if key not in found or not math.isfinite(float(found[key]["number"])):
            raise InputError(file, "", f"expected {TITLE} with a number at {key}")
    return {key: found[key] for key in KEYS}


def draft(state: ArmState, file: Path) -> Draft:
    """Draft the driver's file with the identified geometry; InputError when it is not the arm's."""
    arm, text = six_axes(TITLE, state), read_bytes(file, MAX_BYTES).decode(BYTES)
    if STAMP in text:
        raise InputError(file, "", "testbench export wrote it; expected the robot's own file")

    def as_urdf(written: str) -> str:
        numbers = [float(match["number"]) for match in find(file, written).values()]
        return urdf_of(arm, np.reshape(numbers, (6, 6)))

    urdf = as_urdf(text)
    own = chain_of(file, urdf, parse_xml(file, urdf), arm, FRAMES[-1])
    frames, off = place_frames(own, state)
    poses = robot_origins(own, frames, identified_rigid(state))
    names = tuple(joint.name for joint in arm.joints)
    rows = [x for name in names for x in (*poses[name][:3, 3], *rpy_of(poses[name][:3, :3]))]
    new = text
    for match, value in sorted(zip(find(file, text).values(), rows, strict=True), key=lambda p: -p[0].end()):
        start, end = match.span("number")
        new = f"{new[:start]}{round(value, 12) + 0.0:.12f}{new[end:]}"
    newline = "\r\n" if "\r\n" in text else "\n"
    return Draft(f"# {STAMP}{newline}{new}", names, frames, off, as_urdf=as_urdf, encoding=BYTES)


def urdf_of(arm: Arm, values: Array) -> str:
    """Make the chain that ur_description makes of the numbers, (6, 6) [m, rad], without shapes."""
    links = ["base_link_inertia", *FRAMES]
    parts = [f'<link name="{name}"/>' for name in links]
    for k, (joint, row) in enumerate(zip(arm.joints, values.tolist(), strict=True)):
        xyz, rpy = (" ".join(map(repr, three)) for three in (row[:3], row[3:]))
        ends = f'<parent link="{links[k]}"/><child link="{links[k + 1]}"/><axis xyz="0 0 1"/>'
        origin = f'<origin xyz="{xyz}" rpy="{rpy}"/>'
        parts.append(f'<joint name={quoteattr(joint.name)} type="continuous">{origin}{ends}</joint>')
    return f'<robot name="ur">{"".join(parts)}</robot>'


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of a calibrated UR")
    parser.add_argument("file", type=Path, help="the robot's own file")
    parser.add_argument("--out", type=Path, help="file to write; default: NAME_calibrated here")
    parser.add_argument("--force", action="store_true", help="replace any file")
    asked = parser.parse_args()
    out = asked.out or Path(f"{asked.file.stem}_calibrated{asked.file.suffix}")
    kinds = {
        out: Kind("such a file", rb"(?s).*?" + STAMP.encode()),
        companion_path(out): Kind("its JSON", BEGINS),
    }
    try:
        for path, kind in kinds.items():
            check_file(path, kind, inputs=[asked.model, asked.file], force=asked.force)
        state = load_model(asked.model).state
        done = export(state, draft(state, asked.file), out)
    except BenchError as err:
        sys.exit(f"error: {err}")
    print(f"{out}, and {companion_path(out)}: read back within {done.read_back.position_um:.3g} um")


if __name__ == "__main__":
    main()
