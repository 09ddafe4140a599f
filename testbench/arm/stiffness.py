"""Compliances of links and joints: beam formulas and the check for conservativeness.

Six-vectors are translation first, rotation second; SI units. `folder` uses both for elastic.toml.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, check_array

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
    """Express the compliance of a turned beam in the axes before the turn, diag(R, R) C diag(R, R)^T.

    R is the rotation about the axis by the angle (Rodrigues).

    Mathematics: `vjm-10`.

    Args:
        C: Compliance in the beam's own axes, (6, 6) [m/N, rad/N, rad/(N m)].
        axis: Axis of the rotation, of any length but zero, (3,) [1].
        angle: Angle of the rotation [rad].

    Returns:
        Compliance in the axes before, (6, 6) [m/N, rad/N, rad/(N m)].
    """
    x, y, z = axis / np.linalg.norm(axis)
    W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.kron(np.eye(2), np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W)
    return np.asarray(R @ C @ R.T)


def eigenvalue_scale(C: Array) -> Array:
    """Compute scales that make eigenvalues of a compliance independent of units: the roots of its diagonal.

    Eigenvalues of a matrix that mixes m/N with rad/(N m) depend on the unit of length. Those of D^-1/2 C
    D^-1/2 with D = abs(diag C) do not, and have the same signs (Sylvester).

    Args:
        C: Symmetric compliance, (n, n).

    Returns:
        Positive scales, (n,); 1 where the diagonal is zero.
    """
    d = np.sqrt(np.abs(np.diag(C)))
    return np.where(d > 0, d, 1.0)


def check_compliance(value: object, what: str) -> Array:
    """Check that a value is a conservative, invertible compliance: symmetric and positive definite.

    Args:
        value: Anything that numpy can read as an array.
        what: Name of the quantity, for messages.

    Returns:
        Its symmetric part, (6, 6) [m/N, rad/N, rad/(N m)].

    Raises:
        BenchError: When it is not 6x6, outside COMPLIANCE_RANGE, not symmetric or not positive definite.
    """
    C = check_array(value, (6, 6), what)
    low, high = COMPLIANCE_RANGE
    for row, c in enumerate(np.diag(C), start=1):
        if not low <= c <= high:
            raise BenchError(f"{what}: expected {low:g} to {high:g} on the diagonal, got {c:g} in row {row}")
    if np.abs(C).max() > high:
        raise BenchError(f"{what}: expected entries up to {high:g}, got {np.abs(C).max():g}")
    # symmetry and definiteness of the matrix scaled to unit diagonal, which has no units
    scale = eigenvalue_scale(C)
    unitless = C / np.outer(scale, scale)
    asymmetry = np.abs(unitless - unitless.T)
    if asymmetry.max() > SYMMETRY_TOLERANCE:
        i, j = np.unravel_index(np.argmax(asymmetry), C.shape)
        raise BenchError(
            f"{what}: expected a symmetric matrix, got {C[i, j]:.6g} at row {i + 1}, column "
            f"{j + 1} against {C[j, i]:.6g} at row {j + 1}, column {i + 1}"
        )
    smallest = float(np.linalg.eigvalsh((unitless + unitless.T) / 2)[0])
    if smallest <= 1e-12:
        raise BenchError(
            f"{what}: expected a positive definite matrix, got smallest eigenvalue {smallest:.3g} "
            "(of the matrix scaled to unit diagonal)"
        )
    return (C + C.T) / 2
