"""Cast links as true arms: hollow, tapered, bowed, offset from their joints, closed or open on one side.

A link is a chain of Timoshenko segments at the nodes of Gaussian quadrature. Its compliance at the end sums
those of its sections along the line,

    C = sum Ad(s)^T c(s) Ad(s) ds.

c(s) is the compliance of a thin-walled section of one cell (`Sections`). Axial force and bending are those of
plane sections, torsion is Bredt's. The shear flow is that of bending stress, closed so that the section does
not twist (Megson, Aircraft Structures, 2012, chapters 16 to 18). Its energy gives Timoshenko's shear
coefficients, Cowper's of 1966 at a Poisson's ratio of 0.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.arm.elastic import Material, check_compliance
from testbench.arm.folder import Link
from testbench.errors import Array

BENDING_QUADRATURE = np.array([0.5, 0.5]), np.array([0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)])
"""Weights and nodes of Gaussian quadrature on a wall, exact for the squares of distances."""
SHEAR_QUADRATURE = np.array([5, 8, 5]) / 18, np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
"""Weights and nodes for the squares of shear flows, which are parabolas."""


@dataclass(frozen=True, eq=False)
class Sections:
    """Describe midlines of sections along a beam; wall k leads from corner k to the next one.

    Corners are counterclockwise.
    """

    corners: Array  #: Corners in the section's axes y and z, (sections, walls, 2) [m].
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
        weights, at = BENDING_QUADRATURE
        p = self._wall_points(at)
        return np.asarray(np.einsum("sw,g,swgi,swgj->sij", self.thickness * self.lengths, weights, p, p))

    @cached_property
    def torsion_constant(self) -> Array:
        """Compute the torsion constant, 4 A_m^2 / sum l / t + sum l t^3 / 3 [m^4] (Bredt, Saint-Venant)."""
        a, b = self.corners, np.roll(self.corners, -1, axis=1)
        enclosed = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1) / 2
        bredt = 4 * enclosed**2 / (self.lengths / self.shear_thickness).sum(axis=1)
        return np.asarray(bredt + (self.lengths * self.thickness**3).sum(axis=1) / 3)

    @cached_property
    def shear_flow(self) -> Array:
        """Compute the shear flow of unit forces along y and z without twist, (sections, walls, 3, 2) [1/m].

        dq/ds = -t p^T I^-1 V, and the integral of q / t around the cell is zero. It is evaluated at the nodes
        of SHEAR_QUADRATURE.
        """
        weights, at = SHEAR_QUADRATURE
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
        weights, _ = SHEAR_QUADRATURE
        p, d = self.corners - self.centroid[:, None], self.edges
        lever = p[..., 0] * d[..., 1] - p[..., 1] * d[..., 0]
        torque = np.einsum("sw,g,swgv->sv", lever, weights, self.shear_flow)
        return np.stack([torque[:, 1], -torque[:, 0]], axis=1)

    @cached_property
    def shear_flexibility(self) -> Array:
        """Compute the integral of q q^T / t, the inverse of a shear area, (sections, 2, 2) [1/m^2]."""
        weights, _ = SHEAR_QUADRATURE
        ease = self.lengths / self.shear_thickness
        return np.asarray(np.einsum("sw,g,swgi,swgj->sij", ease, weights, self.shear_flow, self.shear_flow))

    def compliance(self, material: Material) -> Array:
        """Compute the strain of the sections per force and moment at their centroids, per metre of beam.

        (stretch, shear y, z, twist, curvature y, z) = c (N, V_y, V_z, T, M_y, M_z). The twist follows the
        torque about the shear centre e: T - (e_y V_z - e_z V_y).

        Args:
            material: Material of the beam.

        Returns:
            Compliance c per metre, (sections, 6, 6) [1/N, 1/(N m), 1/(N m^2)].
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

    def _wall_points(self, at: Array) -> Array:
        """Compute points on every wall, from the centroid, (sections, walls, points, 2) [m]."""
        p = self.corners - self.centroid[:, None]
        return np.asarray(p[:, :, None] + at[:, None] * self.edges[:, :, None])


def rib_thickness(material: Material, width: Array, pitch: Array, rib: Array, thickness: Array) -> Array:
    """Compute the thickness of a plate that is as stiff in shear as ribs with gaps between them.

    As for battened columns with stiff chords: shear angle over force a b / (12 E I) + 1.2 a / (b G A)
    (Timoshenko and Gere, Theory of Elastic Stability, 1961, section 2.18).

    Args:
        material: Material of the ribs.
        width: Width b of the wall that they replace, (sections,) [m].
        pitch: Distance a of the ribs, (sections,) [m].
        rib: Width of a rib along the beam, (sections,) [m].
        thickness: Thickness of a rib, (sections,) [m].

    Returns:
        Thickness, (sections,) [m].
    """
    bending = pitch * width / (material.E * thickness * rib**3)
    shear = 1.2 * pitch / (width * material.G * thickness * rib)
    return np.asarray(1 / (material.G * width * (bending + shear)))


CAST_IRON = Material(1.1e11, 0.26)  #: Grey cast iron.
QUADRATURE_NODES = 16
WALL_ITERATIONS = 5
"""Corrections of the wall thickness: bending is inversely proportional to it, except for the torsion of a
bow."""
CLOSED_SHARE = 0.5
"""Share of links without an open side [1]."""
DIAMETER_OVER_WALL = 20.0
"""Diameter over wall of the tube of equal bending compliance that gives a link its size [1]."""
CASTING_RANGES = {
    "size": (0.9, 1.3),  # width and height at the root, over the diameter of that tube
    "taper": (0.6, 1.0),  # width and height at the tip over those at the root
    "trapezium": (0.7, 1.0),  # length of the top over that of the bottom
    "wall": (0.7, 1.4),  # thickness of each wall over a common one
    "thinning": (0.7, 1.0),  # thickness at the tip over that at the root
    "section_angle": (-0.3, 0.3),  # section about the line [rad]
    "line_offset": (-0.5, 0.5),  # offset of the line to y and z over the diameter of that tube
    "bow": (-0.05, 0.05),  # height of the line's arc to y and z over the length
    "pitch": (0.5, 1.0),  # from rib to rib on an open side over its width
    "rib": (0.3, 0.6),  # width of a rib over the pitch
}
"""Ranges of the dimensions, each drawn uniformly [1, rad]."""


@dataclass(frozen=True)
class BeamSegments:
    """Hold the segments of a beam."""

    points: Array  #: Points where force and moment of a segment act, in the link's beam frame, (k, 3) [m].
    frames: Array  #: Axes of each section, x along the line, as columns, (k, 3, 3).
    steps: Array  #: Lengths of the segments, (k,) [m].


def beam_compliance(line: BeamSegments, c: Array, tip: Array) -> Array:
    """Compute the compliance of a clamped beam at its tip, C = sum Ad^T c Ad ds.

    Args:
        line: The segments.
        c: Compliances of the sections per metre, (k, 6, 6).
        tip: Point where it is loaded and read, rigidly joined to the last segment, (3,) [m].

    Returns:
        C, (6, 6) [m/N, rad/(N m)].
    """
    x, y, z = (tip - line.points).T
    zero = np.zeros_like(x)
    lever = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)  # r x F
    Ad = np.zeros((len(x), 6, 6))
    back = line.frames.swapaxes(1, 2)
    Ad[:, :3, :3] = Ad[:, 3:, 3:] = back
    Ad[:, 3:, :3] = back @ lever
    return np.asarray((line.steps[:, None, None] * Ad.swapaxes(1, 2) @ c @ Ad).sum(axis=0))


@dataclass(frozen=True)
class Casting:
    """Describe the dimensions of a cast link; `thickness` scales all walls."""

    length: float  #: From joint to joint [m].
    size: Array  #: Width and height at the root, (2,) [m].
    taper: Array  #: Width and height at the tip over those at the root, (2,) [1].
    trapezium: float  #: Length of the top over that of the bottom [1].
    thickness: float  #: Thickness of the walls at the root [m].
    wall: Array  #: Thickness of bottom, right, top and left over that, (4,) [1].
    thinning: float  #: Thickness at the tip over that at the root [1].
    section_angle: float  #: Angle of the sections about the line [rad].
    line_offset: Array  #: Offset of the line to y and z, (2,) [m].
    bow: Array  #: Height of its arc to y and z, (2,) [m].
    open_side: int | None  #: Wall that is ribs with gaps between them; None for a closed box.
    pitch: float  #: Distance of the ribs over the width of that wall [1].
    rib: float  #: Width of a rib over the pitch [1].

    def sections(self, s: Array) -> Sections:
        """Compute the cross sections of the link at some places along it.

        Args:
            s: Distances from the root over the length of the link, (k,) [1].

        Returns:
            The k cross sections.
        """
        width, height = (self.size * (1 + s[:, None] * (self.taper - 1))).T / 2
        top = self.trapezium * width
        y, z = np.array([-width, width, top, -top]).T, np.array([-height, -height, height, height]).T
        cos, sin = np.cos(self.section_angle), np.sin(self.section_angle)
        corners = np.stack([cos * y - sin * z, sin * y + cos * z], axis=2)
        thickness = self.thickness * (1 + s[:, None] * (self.thinning - 1)) * self.wall
        whole = Sections(corners, thickness, thickness.copy())
        if self.open_side is None:
            return whole
        k = self.open_side
        b, t = whole.lengths[:, k], whole.thickness[:, k].copy()
        whole.shear_thickness[:, k] = rib_thickness(
            CAST_IRON, b, self.pitch * b, self.rib * self.pitch * b, t
        )
        whole.thickness[:, k] = 0
        return whole

    def compliance(self, segments: int = QUADRATURE_NODES) -> Array:
        """Compute the compliance at the link's end by Gauss-Legendre quadrature along the link.

        Args:
            segments: Number of nodes of the quadrature.

        Returns:
            Compliance in the beam frame, (6, 6) [m/N, rad/N, rad/(N m)].
        """
        nodes, weights = np.polynomial.legendre.leggauss(segments)
        s = (1 + nodes) / 2
        sections = self.sections(s)
        slope = 4 * (1 - 2 * s)[:, None] * self.bow
        tangent = np.column_stack([np.full(segments, self.length), slope])
        frames = _frames(tangent)
        place = np.column_stack([self.length * s, self.line_offset + 4 * (s * (1 - s))[:, None] * self.bow])
        points = place + np.einsum("kxi,ki->kx", frames[:, :, 1:], sections.centroid)
        line = BeamSegments(points, frames, weights / 2 * np.linalg.norm(tangent, axis=1))
        return beam_compliance(line, sections.compliance(CAST_IRON), np.array([self.length, 0.0, 0.0]))


def cast_link(link: Link, rng: np.random.Generator) -> Link:
    """Replace a tube by a cast link with random dimensions from CASTING_RANGES.

    Its length is that of the tube, twice c26 over c66. Its wall thickness is chosen so that its mean
    compliance under moments, (c55 + c66) / 2, is that of the tube.

    Args:
        link: The tube.
        rng: Source of the dimensions.

    Returns:
        The link with the compliance of the casting.
    """
    C = link.compliance
    bending = float(C[4, 4] + C[5, 5]) / 2
    casting = scale_walls(draw_casting(float(C[1, 5] - C[2, 4]) / bending, bending, rng), bending)
    return replace(link, compliance=check_compliance(casting.compliance(), f"cast {link.name}"))


def scale_walls(casting: Casting, bending: float) -> Casting:
    """Scale the walls of a casting to a given mean of c55 and c66.

    Args:
        casting: The casting.
        bending: Mean of c55 and c66 [rad/(N m)].
    """
    for _ in range(WALL_ITERATIONS):
        C = casting.compliance()
        casting = replace(casting, thickness=casting.thickness * (C[4, 4] + C[5, 5]) / (2 * bending))
    return casting


def draw_casting(length: float, bending: float, rng: np.random.Generator) -> Casting:
    """Draw the dimensions of a casting, of the size of a tube with given length and bending compliance.

    Args:
        length: Length of the tube [m].
        bending: Mean of its c55 and c66 [rad/(N m)].
        rng: Source of the dimensions.
    """
    # I = pi D^3 t / 8, t = D / 20
    wide = (8 * DIAMETER_OVER_WALL * length / (np.pi * CAST_IRON.E * bending)) ** 0.25

    def one(name: str) -> float:
        return float(rng.uniform(*CASTING_RANGES[name]))

    return Casting(
        length=length,
        size=wide * rng.uniform(*CASTING_RANGES["size"], 2),
        taper=rng.uniform(*CASTING_RANGES["taper"], 2),
        trapezium=one("trapezium"),
        thickness=wide / DIAMETER_OVER_WALL,
        wall=rng.uniform(*CASTING_RANGES["wall"], 4),
        thinning=one("thinning"),
        section_angle=one("section_angle"),
        line_offset=wide * rng.uniform(*CASTING_RANGES["line_offset"], 2),
        bow=length * rng.uniform(*CASTING_RANGES["bow"], 2),
        open_side=int(rng.integers(4)) if rng.random() > CLOSED_SHARE else None,
        pitch=one("pitch"),
        rib=one("rib"),
    )


def _frames(tangent: Array) -> Array:
    """Compute axes along a line, y level with the beam frame's, as columns, (k, 3, 3)."""
    x = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y, axis=1)[:, None]
    return np.stack([x, y, np.cross(x, y)], axis=2)
