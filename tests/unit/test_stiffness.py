"""Beam formulas against beams integrated along a line; compliances are conservative or refused."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.arm.elastic import Tube, check_compliance, tube_compliance, unit_diagonal_scale
from testbench.errors import Array, BenchError
from testbench.plant.cast import BeamSegments, beam_compliance

STEEL = Tube(length=0.9, outer_diameter=0.2, inner_diameter=0.16, youngs_modulus=2.1e11, poissons_ratio=0.3)


def test_any_tube_is_the_beam_that_is_integrated_along_its_line_and_passes_the_door(rng):
    """Of an arm's proportions, its wall no thinner than a hundredth of its diameter."""
    x, w = np.polynomial.legendre.leggauss(2)  # the compliance is of degree 2 along the line
    for L, D, d, E, nu in rng.uniform([0.1, 0.05, 0, 1e9, -0.9], [10, 5, 0.98, 1e12, 0.49], (100, 5)):
        tube = Tube(L, L * D, L * D * d, E, nu)
        area, inertia = (np.pi * (tube.outer_diameter**k - tube.inner_diameter**k) for k in (2, 4))
        EA, EI = E * area / 4, E * inertia / 64
        c = np.diag([1 / EA, 0, 0, (1 + nu) / EI, 1 / EI, 1 / EI])  # without shear; G J = 2 E I / 2 (1 + nu)
        line = BeamSegments(np.outer(L / 2 * (1 + x), np.eye(3)[0]), np.tile(np.eye(3), (2, 1, 1)), L / 2 * w)
        C, tip = tube_compliance(tube), np.array([L, 0, 0])
        np.testing.assert_allclose(C, beam_compliance(line, np.tile(c, (2, 1, 1)), tip), rtol=1e-12, atol=0)
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
        d = unit_diagonal_scale(matrix)
        scaled.append(np.linalg.eigvalsh(matrix / np.outer(d, d)))
    np.testing.assert_allclose(scaled[0], scaled[1], rtol=1e-13)
    np.testing.assert_array_equal(unit_diagonal_scale(np.diag([4.0, 0.0, -9.0])), [2, 1, 3])


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
