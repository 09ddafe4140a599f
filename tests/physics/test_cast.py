"""Thin-walled sections and cast links against the closed forms of beam theory."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.arm.stiffness import Material, Tube, eigenvalue_scale, tube_compliance
from testbench.campaign.cast import (
    CAST_IRON,
    Casting,
    Line,
    as_compliant,
    beam_compliance,
    draw_casting,
)
from testbench.campaign.section import Sections, rib_thickness

STEEL = Material(2.1e11, 0.3)


def polygon(corners, thickness):
    corners, thickness = np.array(corners, dtype=float)[None], np.array(thickness, dtype=float)[None]
    return Sections(corners, thickness, thickness.copy())


def box(width, height, thickness=(0.01,) * 4):
    """Walls are bottom, right, top, left."""
    y, z = width / 2, height / 2
    return polygon([(-y, -z), (y, -z), (y, z), (-y, z)], thickness)


def ring(radius, thickness, walls=400):
    angle = 2 * np.pi * np.arange(walls) / walls
    return polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]), [thickness] * walls)


def channel(width, height, flange, web, gap):
    """The left wall is the web; the right one carries next to no shear and no normal stress."""
    own = box(width, height, (flange, 0.0, flange, web))
    own.shear_thickness[0, 1] = gap
    return own


def straight(length, section, segments=3):
    nodes, weights = np.polynomial.legendre.leggauss(segments)  # the compliance is of degree 2 in s
    s = length * (1 + nodes) / 2
    line = Line(
        np.column_stack([s, 0 * s, 0 * s]), np.tile(np.eye(3), (segments, 1, 1)), length / 2 * weights
    )
    return beam_compliance(line, np.repeat(section, segments, axis=0), np.array([length, 0.0, 0.0]))


def assert_same(C, expected, rtol):
    """To a share of the diagonal."""
    scale = eigenvalue_scale(expected)
    np.testing.assert_allclose(
        C / np.outer(scale, scale), expected / np.outer(scale, scale), rtol=0, atol=rtol
    )


def test_a_tube_of_thin_walls_adds_timoshenkos_shear():
    L, r, t = 1.3, 0.16, 1e-4
    C = straight(L, ring(r, t).compliance(STEEL))
    expected = tube_compliance(Tube(L, 2 * r + t, 2 * r - t, STEEL.E, STEEL.nu))
    expected[[1, 2], [1, 2]] += L / (
        0.5 * STEEL.G * 2 * np.pi * r * t
    )  # F L^3/(3 E I) + F L/(k G A), k = 1/2
    assert_same(C, expected, 1e-4)  # of the polygon of 400 walls


def test_cowpers_box_of_unlike_walls():
    """Cowper 1966, thin-walled box of flanges b t_f and webs h t_w, at a Poisson's ratio of 0."""
    b, h, flange, web = 0.2, 0.3, 0.01, 0.016
    m, n = b * flange / (h * web), b / h
    k = 10 * (1 + 3 * m) ** 2 / (12 + 72 * m + 150 * m**2 + 90 * m**3 + 30 * n**2 * (m + m**2))
    own = box(b, h, (flange, web, flange, web))
    assert 1 / (own.shear_flexibility[0, 1, 1] * own.area[0]) == pytest.approx(k, rel=1e-12)


def test_torsion_is_bredts():
    own = box(0.2, 0.3, (0.010, 0.016, 0.012, 0.020))
    bredt = 4 * (0.2 * 0.3) ** 2 / (0.2 / 0.010 + 0.3 / 0.016 + 0.2 / 0.012 + 0.3 / 0.020)
    saint_venant = (0.2 * (0.010**3 + 0.012**3) + 0.3 * (0.016**3 + 0.020**3)) / 3
    assert own.torsion_constant[0] == pytest.approx(bredt + saint_venant, rel=1e-12)


def test_the_shear_centre_of_an_open_side_is_that_of_a_channel():
    """e = 3 b^2 t_f / (h t_w + 6 b t_f) beyond the web; twist of a force through the centroid by Bredt."""
    b, h, flange, web = 0.2, 0.3, 0.01, 0.02
    own = channel(b, h, flange, web, gap=1e-9)
    e = own.centroid[0] + own.shear_centre[0]
    assert e[0] == pytest.approx(-b / 2 - 3 * b**2 * flange / (h * web + 6 * b * flange), rel=1e-5)
    assert e[1] == pytest.approx(0, abs=1e-12)
    c = own.compliance(STEEL)[0]
    assert c[3, 2] == pytest.approx(-own.shear_centre[0, 0] / (STEEL.G * own.torsion_constant[0]), rel=1e-12)
    assert np.linalg.eigvalsh(c)[0] > 0


def test_ribs_close_a_side_as_a_battened_column_of_stiff_chords():
    """Many stout ribs of a thin plate: their gaps are as stiff as beams clamped at both ends."""
    b, a, h, t = 0.3, 0.2, 0.08, 0.01
    EI, GA = STEEL.E * t * h**3 / 12, STEEL.G * t * h
    turn = a / b * (b**3 / (12 * EI) + 1.2 * b / GA) / b  # a rib bends under V a / b at either end
    plate = rib_thickness(STEEL, np.array([b]), np.array([a]), np.array([h]), np.array([t]))
    assert plate[0] == pytest.approx(1 / (STEEL.G * b * turn), rel=1e-12)


def test_a_quarter_circle_is_castiglianos():
    """Clamped at one end, loaded at the other: in its plane and out of it."""
    R, E, G, A, second, polar, k = 0.8, 2.1e11, 8.1e10, 4e-3, 3e-5, 5e-5, 0.45
    c = np.diag([1 / (E * A), 1 / (k * G * A), 1 / (k * G * A), 1 / (G * polar), *(1 / (E * second),) * 2])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    angle = np.pi / 4 * (1 + nodes)
    points = R * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle])
    x = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    z = np.tile([0.0, 0.0, 1.0], (12, 1))
    line = Line(points, np.stack([x, np.cross(z, x), z], axis=2), R * np.pi / 4 * weights)
    C = beam_compliance(line, np.tile(c, (12, 1, 1)), np.array([R, R, 0.0]))
    direct = np.pi * R / 4 * (1 / (E * A) + 1 / (k * G * A))
    assert C[0, 0] == pytest.approx(np.pi * R**3 / (4 * E * second) + direct, rel=1e-10)
    inward = R**3 / (E * second) * (3 * np.pi / 4 - 2) + direct
    assert C[1, 1] == pytest.approx(inward, rel=1e-10)
    across = np.pi * R**3 / (4 * E * second) + (3 * np.pi / 4 - 2) * R**3 / (G * polar)
    assert C[2, 2] == pytest.approx(across + np.pi * R / (2 * k * G * A), rel=1e-10)
    assert C[5, 5] == pytest.approx(np.pi * R / (2 * E * second), rel=1e-10)
    assert C[3, 3] == pytest.approx(np.pi * R / 4 * (1 / (E * second) + 1 / (G * polar)), rel=1e-10)


def plain(**changed):
    """A straight closed box without any of a casting's irregularities."""
    pair, one = np.zeros(2), np.ones(4)
    own = Casting(1.0, np.array([0.2, 0.3]), np.ones(2), 1.0, 0.01, one, 1.0, 0.0, pair, pair, None, 0.5, 0.5)
    return replace(own, **changed)


def test_a_casting_without_irregularities_is_a_straight_box():
    expected = straight(1.0, box(0.2, 0.3).compliance(CAST_IRON))
    assert_same(plain().compliance(), expected, 1e-14)


def test_a_pull_beside_the_centroid_bends():
    """A force along x at the tip, the stout wall at +y: the moment y F turns it by y L F over E I."""
    wall = np.array([1.0, 3.0, 1.0, 1.0])
    section = box(0.2, 0.3, 0.01 * wall)
    y = section.centroid[0, 0]
    C = plain(wall=wall).compliance()
    assert C[5, 0] == pytest.approx(y / (CAST_IRON.E * section.second_moments[0, 0, 0]), rel=1e-12)
    assert plain(wall=wall, beside=np.array([-y, 0])).compliance()[5, 0] == pytest.approx(0, abs=1e-20)


def test_a_tapered_box_bends_as_its_second_moment_says():
    """Wall and height constant, width tapered: L / (E I) integrated with I linear in s."""
    C = plain(taper=np.array([0.6, 1.0])).compliance()
    h, t = 0.3, 0.01
    root, tip = (2 * t * h**3 / 12 + 2 * t * width * (h / 2) ** 2 for width in (0.2, 0.12))
    # the walls of a slightly tapered section lie in its plane here, as in all beam theory
    assert C[4, 4] == pytest.approx(np.log(root / tip) / (root - tip) / CAST_IRON.E, rel=1e-12)


@pytest.mark.parametrize("k", range(7))
def test_cast_links_are_as_long_and_bend_as_the_tubes_with_walls_that_can_be_cast(kr500, k):
    tube = kr500.arm.links[k].compliance
    bending = (tube[4, 4] + tube[5, 5]) / 2
    for seed in range(20):
        draw = draw_casting((tube[1, 5] - tube[2, 4]) / bending, bending, np.random.default_rng(seed))
        casting = as_compliant(draw, bending)
        C = casting.compliance()
        assert casting.length == pytest.approx(2 * tube[1, 5] / tube[5, 5])
        assert C[4, 4] + C[5, 5] == pytest.approx(tube[4, 4] + tube[5, 5], rel=1e-8)
        assert casting.thickness * casting.wall.min() * casting.thinning > 3e-3  # metres
        thickest = casting.thickness * casting.wall.max()
        assert thickest < (casting.size * casting.taper * casting.trapezium).min() / 2
