"""Cast links as true arms: hollow, tapered, bowed, offset from their joints, closed or open on one side.

A link is a chain of Timoshenko segments at the nodes of Gaussian quadrature. Its compliance at the end is the
sum of those of its sections along the centre line,

    C = sum Ad(s)^T c(s) Ad(s) ds.

c(s) is the compliance of a thin-walled section of one cell (`CrossSections`). Under axial force and bending
sections stay plane; torsion follows Bredt. The shear flow balances the bending stress and does not twist the
section (Megson, Aircraft Structures, 2012, chapters 16 to 18). Its energy gives Timoshenko's shear
coefficients, which are Cowper's of 1966 at a Poisson's ratio of 0.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.arm.elastic import Material, check_compliance
from testbench.arm.folder import Link
from testbench.errors import Array

BENDING_QUADRATURE = np.array([0.5, 0.5]), np.array([0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)])
"""Weights and nodes of Gaussian quadrature along a wall, 0 to 1 [1]: exact for squares of distances."""
SHEAR_QUADRATURE = np.array([5, 8, 5]) / 18, np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
"""Weights and nodes of Gaussian quadrature along a wall [1]: exact for squares of parabolic shear flows."""


@dataclass(frozen=True, eq=False)
class CrossSections:
    """Describe thin-walled closed cross sections of a beam by the midlines of their walls.

    Wall k leads from corner k to the next corner, counterclockwise.
    """

    wall_corners: Array  #: Corners in the section's axes y and z, (sections, walls, 2) [m].
    thickness: Array  #: Thickness that carries normal stress, (sections, walls) [m].
    #: Thickness that carries shear, (sections, walls) [m]; smaller if ribs with gaps replace a wall.
    shear_thickness: Array

    @cached_property
    def wall_vectors(self) -> Array:
        """Compute the vector along every wall, from its corner to the next, (sections, walls, 2) [m]."""
        return np.roll(self.wall_corners, -1, axis=1) - self.wall_corners

    @cached_property
    def wall_lengths(self) -> Array:
        """Compute the length of every wall, from corner to corner, (sections, walls) [m]."""
        return np.asarray(np.linalg.norm(self.wall_vectors, axis=2))

    @cached_property
    def area(self) -> Array:
        """Compute, for every section, the area that carries normal stress, (sections,) [m^2]."""
        return np.asarray((self.thickness * self.wall_lengths).sum(axis=1))

    @cached_property
    def centroid(self) -> Array:
        """Compute the centroid of the area that carries normal stress, axes y and z, (sections, 2) [m]."""
        middle = self.wall_corners + self.wall_vectors / 2
        weighted = (self.thickness * self.wall_lengths)[:, :, None] * middle
        return np.asarray(weighted.sum(axis=1) / self.area[:, None])

    @cached_property
    def second_moments(self) -> Array:
        """Compute second moments of area about the centroid, (yy, yz; yz, zz), (sections, 2, 2) [m^4]."""
        weights, at = BENDING_QUADRATURE
        # points on every wall, from the centroid, (sections, walls, points, 2)
        starts = (self.wall_corners - self.centroid[:, None])[:, :, None]
        p = starts + at[:, None] * self.wall_vectors[:, :, None]
        return np.asarray(np.einsum("sw,g,swgi,swgj->sij", self.thickness * self.wall_lengths, weights, p, p))

    @cached_property
    def torsion_constant(self) -> Array:
        """Compute the torsion constant 4 A_m^2 / sum(l / t) + sum(l t^3) / 3, (sections,) [m^4].

        A_m is the area that the walls enclose, l and t their lengths and thicknesses (Bredt, Saint-Venant).
        """
        a, b = self.wall_corners, np.roll(self.wall_corners, -1, axis=1)
        enclosed = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1) / 2
        bredt = 4 * enclosed**2 / (self.wall_lengths / self.shear_thickness).sum(axis=1)
        return np.asarray(bredt + (self.wall_lengths * self.thickness**3).sum(axis=1) / 3)

    @cached_property
    def shear_flow(self) -> Array:
        """Compute the shear flow q in the walls under unit forces V along y and z, without twist.

        It fulfils dq/ds = -t p^T I^-1 V, with p the vector from the centroid. The integral of q / t around
        the section is zero.

        Returns:
            Shear flow per force at the nodes of `SHEAR_QUADRATURE`, (sections, walls, 3, 2) [1/m].
        """
        weights, at = SHEAR_QUADRATURE
        p, d = (self.wall_corners - self.centroid[:, None])[:, :, None], self.wall_vectors[:, :, None]
        x = at[:, None]
        static = self.thickness[..., None, None] * self.wall_lengths[..., None, None] * (x * p + x**2 * d / 2)
        whole = (self.thickness * self.wall_lengths)[..., None] * (p + d / 2)[:, :, 0]
        before = np.cumsum(whole, axis=1) - whole
        free = -(before[:, :, None] + static) @ np.linalg.inv(self.second_moments)[:, None]
        ease = self.wall_lengths / self.shear_thickness
        turn = np.einsum("sw,g,swgv->sv", ease, weights, free) / ease.sum(axis=1)[:, None]
        return np.asarray(free - turn[:, None, None])

    @cached_property
    def shear_centre(self) -> Array:
        """Compute the vector from the centroid to the shear centre, (sections, 2) [m].

        A force at the shear centre does not twist the section.
        """
        weights, _ = SHEAR_QUADRATURE
        p, d = self.wall_corners - self.centroid[:, None], self.wall_vectors
        lever = p[..., 0] * d[..., 1] - p[..., 1] * d[..., 0]
        torque = np.einsum("sw,g,swgv->sv", lever, weights, self.shear_flow)
        return np.stack([torque[:, 1], -torque[:, 0]], axis=1)

    @cached_property
    def shear_flexibility(self) -> Array:
        """Compute the inverse shear area, the integral of q q^T / t, (sections, 2, 2) [1/m^2].

        q is the shear flow in the walls under unit forces, and t their thickness.
        """
        weights, _ = SHEAR_QUADRATURE
        ease = self.wall_lengths / self.shear_thickness
        return np.asarray(np.einsum("sw,g,swgi,swgj->sij", ease, weights, self.shear_flow, self.shear_flow))

    def compliance(self, material: Material) -> Array:
        """Compute the compliance of every section per metre of beam, strain = c @ section load.

        The strain is (stretch, shear y, shear z, twist, curvature y, curvature z), the load (N, V_y, V_z, T,
        M_y, M_z) at the centroid. The twist follows from the torque about the shear centre e, T - (e_y V_z -
        e_z V_y).

        Args:
            material: Material of the beam.

        Returns:
            Compliance c per metre, (sections, 6, 6) [1/N, 1/(N m), 1/(N m^2)].
        """
        E, G = material.E, material.G
        c = np.zeros((len(self.wall_corners), 6, 6))
        c[:, 0, 0] = 1 / (E * self.area)
        c[:, 1:3, 1:3] = self.shear_flexibility / G
        yy, yz, zz = (self.second_moments[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
        c[:, 4:, 4:] = np.linalg.inv(E * np.array([[zz, -yz], [-yz, yy]]).transpose(2, 0, 1))
        e, zero = self.shear_centre, np.zeros(len(c))
        torque = np.stack([zero, e[:, 1], -e[:, 0], zero + 1, zero, zero], axis=1)
        twist = torque / np.sqrt(G * self.torsion_constant)[:, None]
        return np.asarray(c + twist[:, :, None] * twist[:, None, :])


def equivalent_plate_thickness(
    material: Material,
    wall_width: Array,
    rib_pitch: Array,
    rib_width: Array,
    rib_thickness: Array,
) -> Array:
    """Compute the thickness of a plate that is as stiff in shear as a row of ribs with gaps between them.

    The ribs count as battens of a column with stiff chords: shear angle over force is a b / (12 E I) +
    1.2 a / (b G A), with I and A of a rib (Timoshenko and Gere, Theory of Elastic Stability, 1961, section
    2.18).

    Args:
        material: Material of the ribs.
        wall_width: Width b of the wall that the ribs replace, (sections,) [m].
        rib_pitch: Distance a from rib to rib, (sections,) [m].
        rib_width: Width of a rib along the beam, (sections,) [m].
        rib_thickness: Thickness of a rib, (sections,) [m].

    Returns:
        Thickness of the plate, (sections,) [m].
    """
    bending = rib_pitch * wall_width / (material.E * rib_thickness * rib_width**3)
    shear = 1.2 * rib_pitch / (wall_width * material.G * rib_thickness * rib_width)
    return np.asarray(1 / (material.G * wall_width * (bending + shear)))


CAST_IRON = Material(1.1e11, 0.26)  #: Grey cast iron.
QUADRATURE_NODES = 16  #: Nodes of Gauss-Legendre quadrature along a link.
WALL_SCALING_STEPS = 5
"""Corrections of the wall thickness. One would do for a straight link, whose bending compliance is inversely
proportional to the thickness; a bowed link also twists."""
CLOSED_BOX_PROBABILITY = 0.5
"""Fraction of cast links without an open side [1]."""
TUBE_DIAMETER_OVER_WALL = 20.0
"""Diameter over wall thickness [1] of the tube with equal bending compliance; it sets a casting's size."""
CASTING_RANGES = {
    "root_size": (0.9, 1.3),  # width and height at the root, over the diameter of the tube
    "tip_size_ratio": (0.6, 1.0),  # width and height at the tip over those at the root
    "top_over_bottom": (0.7, 1.0),  # width of the top wall over that of the bottom wall
    "wall_factors": (0.7, 1.4),  # thickness of each wall over a common one
    "tip_thickness_ratio": (0.7, 1.0),  # wall thickness at the tip over that at the root
    "section_angle": (-0.3, 0.3),  # rotation of the sections about the centre line [rad]
    "line_offset": (-0.5, 0.5),  # offset of the centre line to y and z, over the diameter of the tube
    "bow_height": (-0.05, 0.05),  # height of the centre line's arc to y and z, over the length
    "rib_pitch_ratio": (0.5, 1.0),  # distance from rib to rib on an open side, over the width of that side
    "rib_width_ratio": (0.3, 0.6),  # width of a rib over the pitch
}
"""Ranges of a casting's dimensions, each drawn uniformly [1, rad]; keys are fields of `Casting`."""


@dataclass(frozen=True)
class BeamSegments:
    """Hold the k segments of a link along its centre line, one per node of the quadrature."""

    centroids: Array  #: Centroids of the sections, in the link's beam frame, (k, 3) [m].
    section_axes: Array  #: Axes of the sections as columns, x along the centre line, (k, 3, 3) [1].
    lengths: Array  #: Lengths of the segments, (k,) [m].


def beam_compliance(segments: BeamSegments, section_compliances: Array, tip: Array) -> Array:
    """Compute the compliance of a clamped beam at its tip, C = sum_k Ad_k^T c_k Ad_k ds_k.

    Ad transforms the wrench at the tip to the section's load at its centroid.

    Args:
        segments: The segments.
        section_compliances: Compliances of the sections per metre of beam, (k, 6, 6) [1/N, 1/(N m), 1/(N
            m^2)].
        tip: Point where the beam is loaded, rigidly joined to the last segment, beam frame, (3,) [m].

    Returns:
        Compliance C at the tip, beam frame, (6, 6) [m/N, rad/N, rad/(N m)].
    """
    x, y, z = (tip - segments.centroids).T
    zero = np.zeros_like(x)
    lever = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)  # r x F
    Ad = np.zeros((len(x), 6, 6))
    back = segments.section_axes.swapaxes(1, 2)
    Ad[:, :3, :3] = Ad[:, 3:, 3:] = back
    Ad[:, 3:, :3] = back @ lever
    return np.asarray(
        (segments.lengths[:, None, None] * Ad.swapaxes(1, 2) @ section_compliances @ Ad).sum(axis=0)
    )


@dataclass(frozen=True)
class Casting:
    """Describe the dimensions of a cast link: a hollow box with four walls along a bowed centre line."""

    length: float  #: Length from joint to joint [m].
    root_size: Array  #: Width and height at the root, (2,) [m].
    tip_size_ratio: Array  #: Width and height at the tip over those at the root, (2,) [1].
    top_over_bottom: float  #: Width of the top wall over that of the bottom wall [1].
    root_thickness: float  #: Common thickness of the walls at the root [m].
    wall_factors: Array  #: Thickness of bottom, right, top and left wall over the common one, (4,) [1].
    tip_thickness_ratio: float  #: Wall thickness at the tip over that at the root [1].
    section_angle: float  #: Rotation of the sections about the centre line [rad].
    line_offset: Array  #: Offset of the centre line to y and z, (2,) [m].
    bow_height: Array  #: Height of the centre line's arc to y and z, (2,) [m].
    open_side: int | None  #: Index of the wall that ribs with gaps replace; None for a closed box.
    rib_pitch_ratio: float  #: Distance from rib to rib over the width of the open side [1].
    rib_width_ratio: float  #: Width of a rib over the distance from rib to rib [1].

    def sections(self, relative_positions: Array) -> CrossSections:
        """Compute the cross sections of the link at some positions along it.

        Args:
            relative_positions: Distances from the root over the length of the link, (k,) [1].

        Returns:
            The k cross sections.
        """
        width, height = (self.root_size * (1 + relative_positions[:, None] * (self.tip_size_ratio - 1))).T / 2
        top = self.top_over_bottom * width
        y, z = np.array([-width, width, top, -top]).T, np.array([-height, -height, height, height]).T
        cos, sin = np.cos(self.section_angle), np.sin(self.section_angle)
        corners = np.stack([cos * y - sin * z, sin * y + cos * z], axis=2)
        thickness = (
            self.root_thickness
            * (1 + relative_positions[:, None] * (self.tip_thickness_ratio - 1))
            * self.wall_factors
        )
        whole = CrossSections(corners, thickness, thickness.copy())
        if self.open_side is None:
            return whole
        k = self.open_side
        b, t = whole.wall_lengths[:, k], whole.thickness[:, k].copy()
        whole.shear_thickness[:, k] = equivalent_plate_thickness(
            CAST_IRON, b, self.rib_pitch_ratio * b, self.rib_width_ratio * self.rib_pitch_ratio * b, t
        )
        whole.thickness[:, k] = 0
        return whole

    def compliance(self) -> Array:
        """Compute the compliance of the link at its end by Gauss-Legendre quadrature along its centre line.

        Returns:
            Compliance in the beam frame, (6, 6) [m/N, rad/N, rad/(N m)].
        """
        nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_NODES)
        s = (1 + nodes) / 2
        sections = self.sections(s)
        slope = 4 * (1 - 2 * s)[:, None] * self.bow_height
        tangent = np.column_stack([np.full(QUADRATURE_NODES, self.length), slope])
        frames = _frames(tangent)
        place = np.column_stack(
            [self.length * s, self.line_offset + 4 * (s * (1 - s))[:, None] * self.bow_height]
        )
        points = place + np.einsum("kxi,ki->kx", frames[:, :, 1:], sections.centroid)
        line = BeamSegments(points, frames, weights / 2 * np.linalg.norm(tangent, axis=1))
        return beam_compliance(line, sections.compliance(CAST_IRON), np.array([self.length, 0.0, 0.0]))


def cast_link(link: Link, rng: np.random.Generator) -> Link:
    """Replace a tubular link by a cast link with random dimensions from `CASTING_RANGES`.

    The length is that of the tube, 2 c26 / c66. The wall thickness is chosen so that the mean compliance
    under bending moments, (c55 + c66) / 2, is that of the tube.

    Args:
        link: Link with the compliance of a tube.
        rng: Random number generator.

    Returns:
        The link with the compliance of the casting.
    """
    C = link.compliance
    bending = float(C[4, 4] + C[5, 5]) / 2
    casting = scale_walls(draw_casting(float(C[1, 5] - C[2, 4]) / bending, bending, rng), bending)
    return replace(link, compliance=check_compliance(casting.compliance(), f"cast {link.name}"))


def scale_walls(casting: Casting, bending_compliance: float) -> Casting:
    """Scale the wall thickness of a casting to a given compliance under bending moments, (c55 + c66) / 2.

    Args:
        casting: The casting.
        bending_compliance: Wanted mean of c55 and c66 [rad/(N m)].

    Returns:
        The casting with scaled walls.
    """
    for _ in range(WALL_SCALING_STEPS):
        C = casting.compliance()
        casting = replace(
            casting, root_thickness=casting.root_thickness * (C[4, 4] + C[5, 5]) / (2 * bending_compliance)
        )
    return casting


def draw_casting(length: float, bending_compliance: float, rng: np.random.Generator) -> Casting:
    """Draw a casting as large as a tube of given length and bending compliance, by `CASTING_RANGES`.

    Args:
        length: Length of the tube [m].
        bending_compliance: Mean of c55 and c66 of the tube [rad/(N m)].
        rng: Random number generator.

    Returns:
        The casting, before its walls are scaled.
    """
    # I = pi D^3 t / 8, t = D / 20
    wide = (8 * TUBE_DIAMETER_OVER_WALL * length / (np.pi * CAST_IRON.E * bending_compliance)) ** 0.25

    def draw_dimension(name: str) -> float:
        return float(rng.uniform(*CASTING_RANGES[name]))

    return Casting(
        length=length,
        root_size=wide * rng.uniform(*CASTING_RANGES["root_size"], 2),
        tip_size_ratio=rng.uniform(*CASTING_RANGES["tip_size_ratio"], 2),
        top_over_bottom=draw_dimension("top_over_bottom"),
        root_thickness=wide / TUBE_DIAMETER_OVER_WALL,
        wall_factors=rng.uniform(*CASTING_RANGES["wall_factors"], 4),
        tip_thickness_ratio=draw_dimension("tip_thickness_ratio"),
        section_angle=draw_dimension("section_angle"),
        line_offset=wide * rng.uniform(*CASTING_RANGES["line_offset"], 2),
        bow_height=length * rng.uniform(*CASTING_RANGES["bow_height"], 2),
        open_side=int(rng.integers(4)) if rng.random() > CLOSED_BOX_PROBABILITY else None,
        rib_pitch_ratio=draw_dimension("rib_pitch_ratio"),
        rib_width_ratio=draw_dimension("rib_width_ratio"),
    )


def _frames(tangent: Array) -> Array:
    """Compute axes along a line, y level with the beam frame's, as columns, (k, 3, 3)."""
    x = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y, axis=1)[:, None]
    return np.stack([x, y, np.cross(x, y)], axis=2)
