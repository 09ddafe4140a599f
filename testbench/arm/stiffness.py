"""Compliances of links and joints: beam formulas, conservativeness.

Six-vectors are translation first, rotation second; SI units.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, check_array

SYMMETRY_TOLERANCE = 1e-9
"""Relative asymmetry up to which a matrix read from a file counts as symmetric (rounding)."""

COMPLIANCE_RANGE = 1e-18, 1e3
"""Compliances of links and joints [m/N, rad/(N m)]; beyond it unit or exponent is a slip."""

TUBE_RANGES = {"length": (1e-3, 100.0), "outer_diameter": (1e-3, 100.0), "youngs_modulus": (1e6, 1e13)}
"""Range of each dimension [m] and of Young's modulus [Pa]: millimetres and GPa are refused."""


@dataclass(frozen=True)
class Material:
    """An elastic material."""

    E: float  #: Young's modulus [Pa].
    nu: float  #: Poisson's ratio [1].

    @property
    def G(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2 * (1 + self.nu))


@dataclass(frozen=True)
class Tube:
    """A straight hollow circular beam, the equivalent of a link."""

    length: float  #: Length L along the beam's x axis [m].
    outer_diameter: float  #: D [m].
    inner_diameter: float  #: d, 0 <= d < D [m].
    youngs_modulus: float  #: E [Pa].
    poissons_ratio: float  #: nu [1].

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
    """Compliance of a clamped Euler-Bernoulli tube, read at its free end, (6, 6) [m/N, rad/(N m)].

    The beam template of the field (Klimchik et al.): c11 = L/EA, c22 = c33 = L^3/(3 E I),
    c44 = L/GJ, c55 = c66 = L/(E I), c26 = +L^2/(2 E I), c35 = -L^2/(2 E I), the beam along x;
    [displacement; rotation] = C @ [force; moment].
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


def turned(C: Array, axis: Array, angle: float) -> Array:
    """Compliance of a beam whose axes are turned, in the axes of before (Rodrigues).

    Args:
        C: In the beam's own axes, (6, 6) [m/N, rad/(N m)].
        axis: About which, of any length, (3,) [1].
        angle: By which [rad].
    """
    x, y, z = axis / np.linalg.norm(axis)
    W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.kron(np.eye(2), np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W)
    return np.asarray(R @ C @ R.T)


def eigenvalue_scale(C: Array) -> Array:
    """Units in which eigenvalues of a compliance mean something: the square root of its diagonal.

    Eigenvalues of a matrix that mixes m/N with rad/(N m) depend on the unit of length; those of
    D^-1/2 C D^-1/2 with D = |diag C| do not, and have the same signs (Sylvester). C is symmetric, (n, n);
    the scales are positive, (n,), 1 where the diagonal is zero.
    """
    d = np.sqrt(np.abs(np.diag(C)))
    return np.where(d > 0, d, 1.0)


def check_compliance(value: object, what: str) -> Array:
    """What numpy can read as a conservative compliance with an inverse, (6, 6) [m/N, rad/(N m)].

    Raises:
        BenchError: When it is not 6x6, out of COMPLIANCE_RANGE, not symmetric or not positive definite.
    """
    C = check_array(value, (6, 6), what)
    low, high = COMPLIANCE_RANGE
    for row, c in enumerate(np.diag(C), start=1):
        if not low <= c <= high:
            raise BenchError(f"{what}: expected {low:g} to {high:g} on the diagonal, got {c:g} in row {row}")
    if np.abs(C).max() > high:
        raise BenchError(f"{what}: expected entries up to {high:g}, got {np.abs(C).max():g}")
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
