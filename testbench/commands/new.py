"""testbench new: what an engineer says of an arm that its file does not: payload, tool, markers, load."""

import re
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.arm.decimal import read_decimals
from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.campaign.propose import Wishes
from testbench.errors import Array, BenchError, check_array
from testbench.plant.import_robot.robot import pose_of

LARGEST = 10.0  #: Farthest point from the tip that can be meant in metres [m].
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,62}")


def read_wishes(
    payload_kg: float | None, tool: str | None, markers: Sequence[str], load: str | None
) -> Wishes:
    """The flags as numbers.

    Args:
        payload_kg: Rated payload [kg].
        tool: x,y,z of the tool from the tip in m; or with rx,ry,rz in degrees, turns about the tip's x, y, z.
        markers: NAME=x,y,z in the tool's frame in m, each.
        load: x,y,z of the load point in the tool's frame in m.

    Raises:
        BenchError: Names the flag and what was expected.
    """
    low, high = PAYLOAD_RANGE
    if payload_kg is not None and not low <= payload_kg <= high:
        raise BenchError(f"--payload-kg: expected {low:g} to {high:g} kg, got {payload_kg}")
    named = tuple(_marker(text) for text in markers)
    names = [name for name, _ in named]
    if len(set(names)) < len(names):
        raise BenchError(f"--marker: expected different names, got {', '.join(names)}")
    if 0 < len(named) < 3:
        raise BenchError(f"--marker: expected three markers or more, got {len(named)}")
    return Wishes(
        payload=payload_kg,
        tool=None if tool is None else _pose(tool),
        markers=named,
        load=None if load is None else _numbers("--load", load, (3,)),
    )


def _pose(text: str) -> Array:
    values = _numbers("--tool", text, (3, 6))
    turned = Rotation.from_euler(
        "xyz", [*values[3:], 0, 0, 0][:3], degrees=True
    )  # about the fixed x, then y, then z
    return pose_of(turned.as_matrix(), values[:3])


def _marker(text: str) -> tuple[str, Array]:
    name, equals, place = text.partition("=")
    if not equals or not NAME.fullmatch(name):
        raise BenchError(f"--marker: expected NAME=x,y,z with a name of letters and digits, got {text!r}")
    return name, _numbers(f"--marker {name}", place, (3,))


def _numbers(flag: str, text: str, counts: tuple[int, ...]) -> Array:
    try:
        values = check_array(read_decimals(word.strip() for word in text.split(",")), (None,), flag)
    except ValueError as err:
        raise BenchError(f"{flag}: expected numbers with commas between, got {text!r}") from err
    if len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise BenchError(f"{flag}: expected {wanted} numbers, got {len(values)} in {text!r}")
    if np.abs(values[:3]).max() > LARGEST:
        raise BenchError(f"{flag}: expected metres up to {LARGEST:g}, got {text!r}")
    return values
