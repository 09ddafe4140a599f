"""Beam formulas against integrated curvature; compliances are conservative or refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from testbench.arm.stiffness import Tube, check_compliance, eigenvalue_scale, tube_compliance
from testbench.errors import Array, BenchError

STEEL = Tube(length=0.9, outer_diameter=0.2, inner_diameter=0.16, youngs_modulus=2.1e11, poissons_ratio=0.3)
REPEATABLE = settings(deadline=None, derandomize=True, database=None, max_examples=60)


@st.composite
def tubes(draw: st.DrawFn) -> Tube:
    """Any tube of an arm's proportions, its wall no thinner than a hundredth of its diameter."""
    L = draw(st.floats(0.1, 10))
    D = L * draw(st.floats(0.05, 5))
    return Tube(
        length=L,
        outer_diameter=D,
        inner_diameter=D * draw(st.floats(0, 0.98)),
        youngs_modulus=draw(st.floats(1e9, 1e12)),
        poissons_ratio=draw(st.floats(-0.9, 0.49)),
    )


def section(tube: Tube) -> tuple[float, float, float]:
    """Area, second moment and polar moment of the ring, integrated over the ring [m^2, m^4, m^4]."""
    x, w = np.polynomial.legendre.leggauss(4)  # exact to degree 7 in r; the integrands have degree 3
    inner, outer = tube.inner_diameter / 2, tube.outer_diameter / 2
    r, wr = (outer + inner) / 2 + (outer - inner) / 2 * x, (outer - inner) / 2 * w
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)  # the trapezium is exact for cos^2
    y = np.outer(r, np.cos(angle))
    dA = np.outer(r * wr, np.full(16, 2 * np.pi / 16))
    return float(dA.sum()), float((y**2 * dA).sum()), float((r[:, None] ** 2 * dA).sum())


def tip_of_clamped_beam(tube: Tube, wrench: Array) -> Array:
    """Displacement and rotation of the free end, from curvature integrated along the beam, (6,).

    Internal moment M(s) = M_tip + (L - s) e_x x F; rotation phi' = M / (GJ, EI, EI);
    displacement u' = (F_x / EA) e_x + phi x e_x; clamped at s = 0.
    """
    A, second, polar = section(tube)
    E, L = tube.youngs_modulus, tube.length
    G = E / (2 * (1 + tube.poissons_ratio))
    rigidity = np.array([G * polar, E * second, E * second])
    force, moment = wrench[:3], wrench[3:]
    x, w = np.polynomial.legendre.leggauss(4)  # exact: phi is quadratic, u cubic in s

    def rotation(s: float) -> Array:
        t, wt = s / 2 * (x + 1), s / 2 * w
        lever = np.stack([L - t, 0 * t, 0 * t], axis=1)
        return wt @ ((moment + np.cross(lever, force)) / rigidity)

    e_x = np.array([1.0, 0.0, 0.0])
    s, ws = L / 2 * (x + 1), L / 2 * w
    slope = np.array([force[0] / (E * A) * e_x + np.cross(rotation(k), e_x) for k in s])
    return np.concatenate([ws @ slope, rotation(L)])


@REPEATABLE
@given(tube=tubes(), wrench=arrays(float, 6, elements=st.integers(-10_000, 10_000)))
def test_any_tube_under_any_load_follows_the_integrated_curvature(tube: Tube, wrench: Array):
    C = tube_compliance(tube)
    bound = np.abs(C) @ np.abs(wrench)  # terms may cancel
    # 1e-12 covers D^4 - d^4 of a wall of a hundredth: it cancels two digits
    assert (np.abs(C @ wrench - tip_of_clamped_beam(tube, wrench)) <= 1e-12 * bound).all()


@REPEATABLE
@given(tubes())
def test_compliance_of_any_tube_passes_the_door_unchanged(tube: Tube):
    C = tube_compliance(tube)
    np.testing.assert_array_equal(check_compliance(C, "compliance"), C)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("length", 0.0, "length: expected 0.001 to 100 m, got 0.0"),
        ("inner_diameter", 0.2, "inner_diameter: expected 0 to below outer_diameter 0.2 m, got 0.2"),
        ("youngs_modulus", 210.0, r"youngs_modulus: expected 1e\+06 to 1e\+13 Pa, got 210.0"),
        ("poissons_ratio", 0.5, "poissons_ratio: expected between -1 and 0.5, got 0.5"),
    ],
)
def test_tube_that_cannot_exist_is_refused(name: str, value: float, expected: str):
    with pytest.raises(BenchError, match=expected):
        replace(STEEL, **{name: value})


def test_scaled_eigenvalues_do_not_depend_on_the_unit_of_length():
    C = tube_compliance(STEEL)
    to_mm = np.diag([1e3, 1e3, 1e3, 1, 1, 1])
    scaled = []
    for matrix in (C, to_mm @ C @ to_mm):
        d = eigenvalue_scale(matrix)
        scaled.append(np.linalg.eigvalsh(matrix / np.outer(d, d)))
    np.testing.assert_allclose(scaled[0], scaled[1], rtol=1e-13)
    np.testing.assert_array_equal(eigenvalue_scale(np.diag([4.0, 0.0, -9.0])), [2, 1, 3])


def coupled(share: float) -> Array:
    """A beam whose bending couples as strongly as its diagonal allows, times a share."""
    C = tube_compliance(STEEL)
    C[1, 5] = C[5, 1] = share * np.sqrt(C[1, 1] * C[5, 5])
    return C


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.eye(5), r"link: expected shape \(6, 6\), got \(5, 5\)"),
        (np.diag([1, 1, 0, 1, 1, 1.0]), "link: expected 1e-18 to 1000 on the diagonal, got 0 in row 3"),
        (np.diag([1, 1, 1e4, 1, 1, 1]), "link: expected 1e-18 to 1000 on the diagonal, got 10000 in row 3"),
        (np.eye(6) + 1e305 * np.eye(6)[::-1], r"link: expected entries up to 1000, got 1e\+305"),
        (np.eye(6) + np.eye(6)[[1, 0, 2, 3, 4, 5]], "link: expected a positive definite matrix"),  # singular
        (np.diag([1, 1, 1, 1, 1, np.nan]), "link: expected finite numbers"),
        ([[1.0], [1.0, 2.0]], "link: expected numbers, got list"),
        *((coupled(x), r"positive definite matrix, got smallest eigenvalue -0\.01") for x in (-1.01, 1.01)),
    ],
)
def test_what_is_no_compliance_is_refused(value: object, expected: str):
    with pytest.raises(BenchError, match=expected):
        check_compliance(value, "link")
