"""The data model of elastic.toml: every number with its unit, its origin and a note.

`read_elastic` checks all that can be checked without the MJCF; `folder.load_arm` checks the rest.
"""

from pathlib import Path
from typing import Annotated, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from testbench.arm.document import Name, Strict, parse_toml, toml_place
from testbench.arm.stiffness import COMPLIANCE_RANGE
from testbench.errors import Array, InputError, read_text

MAX_TOML_BYTES = 100_000  #: Largest size of elastic.toml [byte].
MAX_DOTS = 200
"""Most dots in one line of elastic.toml: tomllib's time grows with the square of a dotted key's length."""
PAYLOAD_RANGE = 1e-3, 1e4
"""Least and largest payload of an arm [kg]; beyond it a unit is wrong."""

COMPENSATOR_RANGES = {
    "foot": (-100.0, 100.0),
    "head": (-100.0, 100.0),
    "rate": (0.0, 1e9),
    "rest_length": (0.0, 100.0),
}
"""Least and largest value of each quantity of a compensator [m, N/m]."""

Origin = Literal["published", "inferred", "assumed", "estimated"]
"""Origin of a number in elastic.toml."""

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Value = TypeVar("Value")
Unit = TypeVar("Unit")


class Quantity(Strict, Generic[Value, Unit]):
    """Hold a number with its unit, its origin and a note."""

    value: Value
    origin: Origin
    note: str = ""
    unit: Unit


Metre = Quantity[float, Literal["m"]]


class TubeEntry(Strict):
    """Describe a straight hollow circular beam."""

    length: Metre
    outer_diameter: Metre
    inner_diameter: Metre
    youngs_modulus: Quantity[float, Literal["Pa"]]
    poissons_ratio: Quantity[float, Literal["1"]]


class LinkEntry(Strict):
    """Describe a link: its body, its beam axes, and either a tube or a compliance."""

    name: Name
    axis: Vector
    normal: Vector
    tube: TubeEntry | None = None
    compliance: Quantity[list[list[float]], Literal["m/N, rad/(N m)"]] | None = None


class JointEntry(Strict):
    """Describe an actuated joint and its compliance."""

    name: Name
    compliance: Quantity[float, Literal["rad/(N m)", "m/N"]]


class CompensatorEntry(Strict):
    """Describe a gas or coil spring between points of link 1 and link 2 that helps joint 2."""

    foot: Quantity[Vector, Literal["m"]]
    head: Quantity[Vector, Literal["m"]]
    rate: Quantity[float, Literal["N/m"]]
    rest_length: Metre


class Elastic(Strict):
    """Describe the whole file elastic.toml."""

    format: Literal[1]
    title: str
    tool: Name
    load: Name
    markers: list[Name] = Field(min_length=1)
    #: Names out of tool, load point and markers whose positions are not confirmed yet.
    to_confirm: list[Name] = Field(default_factory=list)
    payload: Quantity[float, Literal["kg"]] | None = None
    compensator: CompensatorEntry | None = None
    link: list[LinkEntry] = Field(min_length=1)
    joint: list[JointEntry] = Field(default_factory=list)
    #: Rows of q_model = L q_file + q_0 by the chain joint's name: coefficients of file joints [1], and
    #: offset_deg or offset_mm.
    joints: dict[Name, dict[Name, float]] = Field(default_factory=dict)


def read_elastic(path: Path) -> Elastic:
    """Read elastic.toml and check what can be checked without the arm's MJCF.

    Args:
        path: The file.

    Returns:
        Its content.

    Raises:
        InputError: When the file cannot be read, is not TOML, or a value is wrong; the message names the
            place.
    """
    text = read_text(path, MAX_TOML_BYTES)
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MAX_DOTS:
            raise InputError(path, f"line {number}", f"expected at most {MAX_DOTS} dots in a line")
    data = parse_toml(path, text)
    try:
        elastic = Elastic.model_validate(data)
    except ValidationError as err:
        raise InputError(path, *_first(path, err)) from err
    _check_values(path, elastic)
    return elastic


def _check_values(path: Path, elastic: Elastic) -> None:
    links, joints = [x.name for x in elastic.link], [x.name for x in elastic.joint]
    if len(links) != len(joints) + 1:
        problem = f"expected one link more than joints, got {len(links)} links and {len(joints)} joints"
        raise InputError(path, toml_place(path, ["link"]), problem)
    for key, names in (("link", links), ("joint", joints), ("markers", elastic.markers)):
        if len(set(names)) != len(names):
            raise InputError(path, toml_place(path, [key]), f"expected different names, got {names}")
    points = [elastic.tool, elastic.load, *elastic.markers]
    if unknown := [name for name in elastic.to_confirm if name not in points]:
        raise InputError(
            path, toml_place(path, ["to_confirm"]), f"expected some of {points}, got {unknown[0]!r}"
        )
    if (payload := elastic.payload) is not None:
        _check_range(path, toml_place(path, ["payload"]), payload.value, payload.unit, PAYLOAD_RANGE)
    if (spring := elastic.compensator) is not None:
        for name, span in COMPENSATOR_RANGES.items():
            own, place = getattr(spring, name), toml_place(path, ["compensator", name])
            for value in np.ravel(own.value).tolist():
                _check_range(path, place, value, own.unit, span)
    for k, joint in enumerate(elastic.joint):
        own, place = joint.compliance, f"{toml_place(path, ['joint', k, 'compliance'])} ({joint.name})"
        _check_range(path, place, own.value, own.unit, COMPLIANCE_RANGE)


def _check_range(path: Path, place: str, value: float, unit: str, span: tuple[float, float]) -> None:
    low, high = span
    if not low <= value <= high:
        raise InputError(path, place, f"expected {low:g} to {high:g} {unit}, got {value}")


def link_place(path: Path, index: int, link: LinkEntry, *keys: str) -> str:
    """Name the place of a link, or of a value of it, for a message.

    Args:
        path: The file elastic.toml.
        index: Index of the link, from 0.
        link: The link, for its name.
        *keys: Keys inside the link's table that lead to the value.

    Returns:
        Line, column, keys and name of the link.
    """
    return f"{toml_place(path, ['link', index, *keys])} ({link.name})"


def beam_frame(path: Path, index: int, link: LinkEntry) -> Array:
    """Compute the beam axes of a link from its axis and normal, exactly orthonormal.

    Args:
        path: The file elastic.toml, for messages.
        index: Index of the link, from 0.
        link: The link with its axis x and normal y.

    Returns:
        Beam axes x, y and z = x cross y as columns, in the body's axes, (3, 3) [1].

    Raises:
        InputError: When axis and normal are not unit vectors at right angles within 1e-6.
    """
    x, y = np.array(link.axis), np.array(link.normal)
    orthonormal = max(abs(x).max(), abs(y).max()) < 2 and np.allclose(
        [x @ x, y @ y, x @ y], [1, 1, 0], rtol=0, atol=1e-6
    )
    if not orthonormal:
        problem = f"expected unit vectors at right angles, got {link.axis} and {link.normal}"
        raise InputError(path, link_place(path, index, link, "axis"), f"axis and normal: {problem}")
    # Gram and Schmidt
    x = x / np.linalg.norm(x)  # written to six digits or more; exact from here on
    y = y - (x @ y) * x
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _first(path: Path, err: ValidationError) -> tuple[str, str]:
    """Place and problem of the first finding of pydantic, in one line."""
    try:
        first = err.errors(include_url=False, include_context=False)[0]
        got = repr(first["input"])
    except (RecursionError, ValueError):  # too deep, or of too many digits, to be shown
        first = err.errors(include_url=False, include_context=False, include_input=False)[0]
        got = "something too long to show"
    place = toml_place(path, first["loc"])
    problem = f"{first['msg']}, got {got if len(got) < 80 else got[:77] + '...'}"
    return place, problem
