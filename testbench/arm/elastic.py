"""Compliances of links and joints, and elastic.toml, which states them with unit, origin and note.

Here are the compliance of a tube by beam theory, the check that a compliance is conservative, and the reader
of elastic.toml. `read_elastic` checks all that can be checked without the MJCF; `folder.load_arm` checks the
rest. Six-vectors have the translation first; units are SI.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from testbench.arm.document import Name, StrictModel, first_invalid_value, parse_toml, toml_place
from testbench.errors import Array, BenchError, InputError, check_array, read_text, some_of

# --- Compliances of links and joints: beam formulas and the check for conservativeness ----------------------

SYMMETRY_TOLERANCE = 1e-9
"""Relative asymmetry up to which a matrix read from a file counts as symmetric (rounding)."""

COMPLIANCE_RANGE = 1e-18, 1e3
"""Least and largest compliance of links and joints [m/N, rad/(N m)]; beyond it a unit is wrong."""

TUBE_RANGES = {"length": (1e-3, 100.0), "outer_diameter": (1e-3, 100.0), "youngs_modulus": (1e6, 1e13)}
"""Least and largest dimension [m] and Young's modulus [Pa]: values in millimetres or GPa are refused."""


@dataclass(frozen=True)
class Material:
    """Describe an isotropic elastic material."""

    E: float  #: Young's modulus [Pa].
    nu: float  #: Poisson's ratio [1].

    @property
    def G(self) -> float:
        """Compute the shear modulus G = E / (2 (1 + nu)) [Pa]."""
        return self.E / (2 * (1 + self.nu))


@dataclass(frozen=True)
class Tube:
    """Describe a straight hollow circular beam, the equivalent of a link."""

    length: float  #: Length L along the beam's x axis [m].
    outer_diameter: float  #: Outer diameter D [m].
    inner_diameter: float  #: Inner diameter d, 0 <= d < D [m].
    youngs_modulus: float  #: Young's modulus E [Pa].
    poissons_ratio: float  #: Poisson's ratio nu [1].

    def __post_init__(self) -> None:
        """Refuse a tube that cannot exist: BenchError."""
        for name, (low, high) in TUBE_RANGES.items():
            if not low <= getattr(self, name) <= high:
                unit = "Pa" if name == "youngs_modulus" else "m"
                raise BenchError(f"{name}: expected {low:g} to {high:g} {unit}, got {getattr(self, name)}")
        if not 0 <= self.inner_diameter < self.outer_diameter:
            raise BenchError(
                f"inner_diameter: expected 0 to below outer_diameter {self.outer_diameter} m, "
                f"got {self.inner_diameter}"
            )
        if not -1 < self.poissons_ratio < 0.5:
            raise BenchError(f"poissons_ratio: expected between -1 and 0.5, got {self.poissons_ratio}")


def tube_compliance(tube: Tube) -> Array:
    """Compute the compliance of a clamped Euler-Bernoulli tube at its free end.

    This is the beam template of Klimchik et al.: c11 = L/EA, c22 = c33 = L^3/(3 E I), c44 = L/GJ, c55 = c66 =
    L/(E I), c26 = +L^2/(2 E I), c35 = -L^2/(2 E I), with the beam along x, A = pi (D^2 - d^2)/4, I = pi (D^4
    - d^4)/64 and J = 2 I.

    Mathematics: `vjm-9`.

    Args:
        tube: Dimensions and material.

    Returns:
        C with [displacement; rotation] = C @ [force; moment], (6, 6) [m/N, rad/N, rad/(N m)].
    """
    L, E = tube.length, tube.youngs_modulus
    D, d = tube.outer_diameter, tube.inner_diameter
    area = np.pi * (D**2 - d**2) / 4
    inertia = np.pi * (D**4 - d**4) / 64
    G = Material(E, tube.poissons_ratio).G
    bending = L / (E * inertia)
    across = bending * L**2 / 3
    C = np.diag([L / (E * area), across, across, L / (G * 2 * inertia), bending, bending])
    C[1, 5] = C[5, 1] = bending * L / 2
    C[2, 4] = C[4, 2] = -bending * L / 2
    return C


def rotated_compliance(C: Array, axis: Array, angle: float) -> Array:
    """Rotate a compliance, C' = diag(R, R) C diag(R, R)^T, with the rotation R about an axis by an angle.

    Mathematics: `vjm-10`.

    Args:
        C: Compliance of a beam in its own axes, (6, 6) [m/N, rad/N, rad/(N m)].
        axis: Axis by which the beam is rotated, of any length but zero, (3,) [1].
        angle: Angle by which the beam is rotated [rad].

    Returns:
        Compliance of the rotated beam, in the axes before the rotation, (6, 6) [m/N, rad/N, rad/(N m)].
    """
    x, y, z = axis / np.linalg.norm(axis)
    W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.kron(np.eye(2), np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W)
    return np.asarray(R @ C @ R.T)


def unit_diagonal_scale(C: Array) -> Array:
    """Compute s = sqrt(diag(C)), by which C / (s s^T) has a unit diagonal.

    Eigenvalues of a matrix that mixes m/N with rad/(N m) depend on the unit of length. Those of the scaled
    matrix do not, and have the same signs (Sylvester).

    Args:
        C: Symmetric compliance, (n, n) [m/N, rad/N, rad/(N m)].

    Returns:
        Positive scale s, (n,); 1 where the diagonal is zero.
    """
    d = np.sqrt(np.abs(np.diag(C)))
    return np.where(d > 0, d, 1.0)


def check_compliance(value: object, name: str) -> Array:
    """Check that a value is a conservative, invertible compliance: symmetric and positive definite.

    Args:
        value: Anything that numpy can read as an array.
        name: Name of the quantity, for messages.

    Returns:
        Its symmetric part, (6, 6) [m/N, rad/N, rad/(N m)].

    Raises:
        BenchError: When it is not 6x6, outside `COMPLIANCE_RANGE`, not symmetric or not positive definite.
    """
    C = check_array(value, (6, 6), name)
    low, high = COMPLIANCE_RANGE
    for row, c in enumerate(np.diag(C), start=1):
        if not low <= c <= high:
            raise BenchError(f"{name}: expected {low:g} to {high:g} on the diagonal, got {c:g} in row {row}")
    if np.abs(C).max() > high:
        raise BenchError(f"{name}: expected entries up to {high:g}, got {np.abs(C).max():g}")
    # symmetry and definiteness of the matrix scaled to unit diagonal, which has no units
    scale = unit_diagonal_scale(C)
    unitless = C / np.outer(scale, scale)
    asymmetry = np.abs(unitless - unitless.T)
    if asymmetry.max() > SYMMETRY_TOLERANCE:
        i, j = np.unravel_index(np.argmax(asymmetry), C.shape)
        raise BenchError(
            f"{name}: expected a symmetric matrix, got {C[i, j]:.6g} at row {i + 1}, column "
            f"{j + 1} against {C[j, i]:.6g} at row {j + 1}, column {i + 1}"
        )
    smallest = float(np.linalg.eigvalsh((unitless + unitless.T) / 2)[0])
    if smallest <= 1e-12:
        raise BenchError(
            f"{name}: expected a positive definite matrix, got smallest eigenvalue {smallest:.3g} "
            "(of the matrix scaled to unit diagonal)"
        )
    return (C + C.T) / 2


# --- The data model of elastic.toml: every number with its unit, its origin and a note ----------------------

MAX_ELASTIC_BYTES = 100_000  #: Largest size of elastic.toml [byte].
MAX_DOTS_PER_LINE = 200
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

NumberOrigin = Literal["published", "inferred", "assumed", "estimated"]
"""Origin of a number in elastic.toml."""

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]  #: List of three numbers.
Value = TypeVar("Value")
Unit = TypeVar("Unit")


class Quantity(StrictModel, Generic[Value, Unit]):
    """Hold a number of elastic.toml with its unit, its origin and a note."""

    value: Value  #: The number, or a nested list of numbers.
    origin: NumberOrigin  #: Where the number comes from.
    note: str = ""  #: Remark for people.
    unit: Unit  #: Unit of the number, as text.


Length = Quantity[float, Literal["m"]]  #: Length in metres.


class TubeEntry(StrictModel):
    """Describe the table `tube` of a link in elastic.toml: a straight hollow circular beam."""

    length: Length  #: Length along the beam's x axis.
    outer_diameter: Length
    inner_diameter: Length  #: 0 for a solid beam.
    youngs_modulus: Quantity[float, Literal["Pa"]]
    poissons_ratio: Quantity[float, Literal["1"]]


class LinkEntry(StrictModel):
    """Describe one table [[link]] of elastic.toml: an elastic link, given as a tube or by its compliance."""

    name: Name  #: Name of the link's body in rigid.xml.
    axis: Vector3  #: Beam axis x in the body's axes, a unit vector.
    normal: Vector3  #: Beam axis y in the body's axes, a unit vector.
    tube: TubeEntry | None = None  #: Equivalent tube; None if a compliance is given.
    #: Compliance in the beam frame at the link's end, 6 rows of 6; None if a tube is given.
    compliance: Quantity[list[list[float]], Literal["m/N, rad/(N m)"]] | None = None


class JointEntry(StrictModel):
    """Describe one table [[joint]] of elastic.toml: an actuated joint and its compliance."""

    name: Name  #: Name of the joint in rigid.xml.
    compliance: Quantity[float, Literal["rad/(N m)", "m/N"]]  #: Compliance of the joint's spring.


class CompensatorEntry(StrictModel):
    """Describe the table [compensator] of elastic.toml: a spring between links 1 and 2."""

    foot: Quantity[Vector3, Literal["m"]]  #: Hinge point on link 1, in that body's frame.
    head: Quantity[Vector3, Literal["m"]]  #: Hinge point on link 2, in that body's frame.
    rate: Quantity[float, Literal["N/m"]]  #: Change of force over change of length as joint 2 turns.
    rest_length: Length  #: Length without force.


class ElasticDocument(StrictModel):
    """Describe the whole file elastic.toml; every field has the name of its key in the file."""

    format: Literal[1]  #: Version of the format.
    title: str  #: Title of the arm, for people.
    tool: Name  #: Body whose origin is the tool centre point.
    load: Name  #: Body whose origin is the load point.
    markers: list[Name] = Field(min_length=1)  #: Bodies whose origins are the markers.
    #: Names out of tool, load point and markers whose positions are not confirmed yet.
    to_confirm: list[Name] = Field(default_factory=list)
    payload: Quantity[float, Literal["kg"]] | None = None  #: Rated payload.
    compensator: CompensatorEntry | None = None  #: Gravity compensator of joint 2.
    link: list[LinkEntry] = Field(min_length=1)  #: Links from the base to the flange, n + 1.
    joint: list[JointEntry] = Field(default_factory=list)  #: Joints from the base to the flange, n.
    #: Rows of q_model = L q_file + q_0 by the chain joint's name: coefficients of file joints [1], and
    #: offset_deg or offset_mm.
    joints: dict[Name, dict[Name, float]] = Field(default_factory=dict)


def read_elastic(path: Path) -> ElasticDocument:
    """Read elastic.toml and check what can be checked without the arm's MJCF.

    Args:
        path: The file.

    Returns:
        Content of the file.

    Raises:
        InputError: When the file cannot be read, is not TOML, or a value is wrong; the message names the
            place.
    """
    text = read_text(path, MAX_ELASTIC_BYTES)
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MAX_DOTS_PER_LINE:
            raise InputError(path, f"line {number}", f"expected at most {MAX_DOTS_PER_LINE} dots in a line")
    data = parse_toml(path, text)
    try:
        elastic = ElasticDocument.model_validate(data)
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        raise InputError(path, toml_place(path, keys), problem) from err
    _check_values(path, elastic)
    return elastic


def _check_values(path: Path, elastic: ElasticDocument) -> None:
    links, joints = [x.name for x in elastic.link], [x.name for x in elastic.joint]
    if len(links) != len(joints) + 1:
        problem = f"expected one link more than joints, got {len(links)} links and {len(joints)} joints"
        raise InputError(path, toml_place(path, ["link"]), problem)
    for key, names in (("link", links), ("joint", joints), ("markers", elastic.markers)):
        if len(set(names)) != len(names):
            raise InputError(path, toml_place(path, [key]), f"expected different names, got {some_of(names)}")
    points = [elastic.tool, elastic.load, *elastic.markers]
    if unknown := [name for name in elastic.to_confirm if name not in points]:
        raise InputError(
            path,
            toml_place(path, ["to_confirm"]),
            f"expected some of {', '.join(points)}, got {unknown[0]!r}",
        )
    if (payload := elastic.payload) is not None:
        _check_range(path, ["payload"], payload, PAYLOAD_RANGE)
    if (spring := elastic.compensator) is not None:
        for name, span in COMPENSATOR_RANGES.items():
            _check_range(path, ["compensator", name], getattr(spring, name), span)
    for k, joint in enumerate(elastic.joint):
        _check_range(path, ["joint", k, "compliance"], joint.compliance, COMPLIANCE_RANGE)


def _check_range(
    path: Path, keys: Sequence[str | int], quantity: Quantity[Value, Unit], span: tuple[float, float]
) -> None:
    """Check every number of a quantity."""
    low, high = span
    for value in np.ravel(np.asarray(quantity.value)).tolist():
        if not low <= value <= high:
            problem = f"expected {low:g} to {high:g} {quantity.unit}, got {value}"
            raise InputError(path, toml_place(path, keys), problem)


def link_place(path: Path, index: int, link: LinkEntry, *keys: str) -> str:
    """Find the place of a link in elastic.toml, or of a value of the link, for an error message.

    Args:
        path: The file elastic.toml.
        index: Index of the link, from 0.
        link: The link, for its name.
        *keys: Keys inside the link's table that lead to the value.

    Returns:
        Line, column, keys and name of the link as text.
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
