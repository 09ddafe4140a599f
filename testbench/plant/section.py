"""Thin-walled sections of one cell: compliance of a short piece of a hollow link in all six directions.

Axial force and bending are those of plane sections, torsion is Bredt's. The shear flow is that of bending
stress, closed so that the section does not twist (Megson, Aircraft Structures, 2012, chapters 16 to 18). Its
energy gives Timoshenko's shear coefficients, Cowper's of 1966 at a Poisson's ratio of 0.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.arm.stiffness import Material
from testbench.errors import Array

BEND = np.array([0.5, 0.5]), np.array([0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)])
"""Weights and nodes of Gaussian quadrature on a wall, exact for the squares of distances."""
FLOW = np.array([5, 8, 5]) / 18, np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
"""Weights and nodes for the squares of shear flows, which are parabolas."""


@dataclass(frozen=True, eq=False)
class Sections:
    """Describe midlines of sections along a beam; wall k leads from corner k to the next one.

    Corners are counterclockwise.
    """

    corners: Array  #: In the section's axes y and z, (sections, walls, 2) [m].
    thickness: Array  #: Thickness that carries normal stress, (sections, walls) [m].
    shear_thickness: Array  #: Thickness that carries shear [m]: less if ribs with gaps replace a wall.

    @cached_property
    def edges(self) -> Array:
        """Compute the vectors from corner to corner, (sections, walls, 2) [m]."""
        return np.roll(self.corners, -1, axis=1) - self.corners

    @cached_property
    def lengths(self) -> Array:
        """Compute the lengths of the walls, (sections, walls) [m]."""
        return np.asarray(np.linalg.norm(self.edges, axis=2))

    @cached_property
    def area(self) -> Array:
        """Compute the area of the walls that carry normal stress, (sections,) [m^2]."""
        return np.asarray((self.thickness * self.lengths).sum(axis=1))

    @cached_property
    def centroid(self) -> Array:
        """Compute the centroid of these walls, (sections, 2) [m]."""
        middle = self.corners + self.edges / 2
        weighted = (self.thickness * self.lengths)[:, :, None] * middle
        return np.asarray(weighted.sum(axis=1) / self.area[:, None])

    @cached_property
    def second_moments(self) -> Array:
        """Compute second moments about the centroid, (y y, y z; y z, z z), (sections, 2, 2) [m^4]."""
        weights, at = BEND
        p = self._places(at)
        return np.asarray(np.einsum("sw,g,swgi,swgj->sij", self.thickness * self.lengths, weights, p, p))

    @cached_property
    def torsion_constant(self) -> Array:
        """Compute the torsion constant, 4 A_m^2 / sum l / t + sum l t^3 / 3 [m^4] (Bredt, Saint-Venant)."""
        a, b = self.corners, np.roll(self.corners, -1, axis=1)
        enclosed = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1) / 2
        bredt = 4 * enclosed**2 / (self.lengths / self.shear_thickness).sum(axis=1)
        return np.asarray(bredt + (self.lengths * self.thickness**3).sum(axis=1) / 3)

    @cached_property
    def flow(self) -> Array:
        """Compute the shear flow of unit forces along y and z without twist, (sections, walls, 3, 2) [1/m].

        dq/ds = -t p^T I^-1 V, and the integral of q / t around the cell is zero. It is evaluated at the nodes
        of FLOW.
        """
        weights, at = FLOW
        p, d = (self.corners - self.centroid[:, None])[:, :, None], self.edges[:, :, None]
        x = at[:, None]
        static = self.thickness[..., None, None] * self.lengths[..., None, None] * (x * p + x**2 * d / 2)
        whole = (self.thickness * self.lengths)[..., None] * (p + d / 2)[:, :, 0]
        before = np.cumsum(whole, axis=1) - whole
        free = -(before[:, :, None] + static) @ np.linalg.inv(self.second_moments)[:, None]
        ease = self.lengths / self.shear_thickness
        turn = np.einsum("sw,g,swgv->sv", ease, weights, free) / ease.sum(axis=1)[:, None]
        return np.asarray(free - turn[:, None, None])

    @cached_property
    def shear_centre(self) -> Array:
        """Compute the shear centre from the centroid, (sections, 2) [m]: a force there does not twist."""
        weights, _ = FLOW
        p, d = self.corners - self.centroid[:, None], self.edges
        lever = p[..., 0] * d[..., 1] - p[..., 1] * d[..., 0]
        torque = np.einsum("sw,g,swgv->sv", lever, weights, self.flow)
        return np.stack([torque[:, 1], -torque[:, 0]], axis=1)

    @cached_property
    def shear_flexibility(self) -> Array:
        """Compute the integral of q q^T / t, the inverse of a shear area, (sections, 2, 2) [1/m^2]."""
        weights, _ = FLOW
        ease = self.lengths / self.shear_thickness
        return np.asarray(np.einsum("sw,g,swgi,swgj->sij", ease, weights, self.flow, self.flow))

    def compliance(self, material: Material) -> Array:
        """Compute the strain of the section per force and moment at its centroid, (sections, 6, 6).

        (stretch, shear y, z, twist, curvature y, z) = c (N, V_y, V_z, T, M_y, M_z), per metre of beam. The
        twist follows the torque about the shear centre e, T - (e_y V_z - e_z V_y).
        """
        E, G = material.E, material.G
        c = np.zeros((len(self.corners), 6, 6))
        c[:, 0, 0] = 1 / (E * self.area)
        c[:, 1:3, 1:3] = self.shear_flexibility / G
        yy, yz, zz = (self.second_moments[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
        c[:, 4:, 4:] = np.linalg.inv(E * np.array([[zz, -yz], [-yz, yy]]).transpose(2, 0, 1))
        e, zero = self.shear_centre, np.zeros(len(c))
        torque = np.stack([zero, e[:, 1], -e[:, 0], zero + 1, zero, zero], axis=1)
        twist = torque / np.sqrt(G * self.torsion_constant)[:, None]
        return np.asarray(c + twist[:, :, None] * twist[:, None, :])

    def _places(self, at: Array) -> Array:
        """Places on every wall from the centroid, (sections, walls, places, 2) [m]."""
        p = self.corners - self.centroid[:, None]
        return np.asarray(p[:, :, None] + at[:, None] * self.edges[:, :, None])


def rib_thickness(material: Material, width: Array, pitch: Array, rib: Array, thickness: Array) -> Array:
    """Compute the thickness of a plate that is as stiff in shear as ribs with gaps between them.

    As for battened columns with stiff chords: shear angle over force a b / (12 E I) + 1.2 a / (b G A)
    (Timoshenko and Gere, Theory of Elastic Stability, 1961, section 2.18).

    Args:
        material: Material of the ribs.
        width: Width b of the wall that they replace [m].
        pitch: Distance a of the ribs [m].
        rib: Width of a rib along the beam [m].
        thickness: Thickness of a rib [m].

    Returns:
        Thickness [m].
    """
    bending = pitch * width / (material.E * thickness * rib**3)
    shear = 1.2 * pitch / (width * material.G * thickness * rib)
    return np.asarray(1 / (material.G * width * (bending + shear)))
