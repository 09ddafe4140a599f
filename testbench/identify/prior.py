"""What is believed of the compliances before any data, and the metric in which it is believed.

A prior names a positive definite compliance P for every block. In its metric a compliance is
C = P^1/2 X P^1/2, and X = 1 is what was expected. The upper triangle of X, off-diagonals times sqrt 2, is x:
distances in x are Frobenius distances of X, and C is positive semi-definite where X is.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from testbench.arm.folder import Arm
from testbench.errors import Array, BenchError, check_array
from testbench.identify.conic import check_symmetric
from testbench.identify.regression import Regression
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

SMALLEST = 1e-9
"""Eigenvalue of a block of the prior of unit diagonal below which it counts as singular."""


@dataclass(frozen=True)
class Prior:
    """Expected compliances of an arm.

    Attributes:
        name: Where they are from, for reports.
        C_theta: Symmetric, positive definite in every link's and joint's block, (n_theta, n_theta)
            [m/N, rad/(N m)].
    """

    name: str
    C_theta: Array


@dataclass(frozen=True)
class Metric:
    """A structure in the metric of a prior.

    Attributes:
        prior: Its name.
        structure: The unknowns.
        L: pi = L x, (n, n), block by block.
        expected: x of X = 1, (n,).
        sizes: Size of every block, in the order of `structure.blocks`.
    """

    prior: str
    structure: Structure
    L: Array
    expected: Array
    sizes: tuple[int, ...]


def cad_prior(arm: Arm) -> Prior:
    """The compliances of the arm's folder: beams of the links' dimensions, catalogue values of the joints."""
    return Prior(f"CAD of {arm.name}", arm.C_theta)


def distorted(prior: Prior, *, scale: float, shape: float, rng: np.random.Generator) -> Prior:
    """A prior that is wrong: by a common factor, and axis by axis.

    Args:
        prior: The right one.
        scale: Factor of all compliances.
        shape: Standard deviation of the logarithm of each axis's own factor, that of its diagonal entry [1].
        rng: Source of those factors.

    Raises:
        BenchError: When scale is not above 0 or shape is below 0.
    """
    if not scale > 0 or not shape >= 0:
        raise BenchError(f"prior: expected a scale above 0 and a shape of at least 0, got {scale}, {shape}")
    factor = np.exp(shape / 2 * rng.standard_normal(len(prior.C_theta)))  # on both sides of C
    name = f"{prior.name}, {scale:g} times, shape {100 * shape:g} % off"
    return Prior(name, scale * factor[:, None] * prior.C_theta * factor)


def metric(prior: Prior, vjm: Vjm, structure: Structure) -> Metric:
    """A structure in the metric of a prior.

    A joint that the structure leaves out adds its compliance to the link before it, about its axis: the
    paper's aggregation. A link that it leaves out is rigid.

    Args:
        prior: Expected compliances.
        vjm: The model, for the joints' axes.
        structure: The unknowns: every block with all its entries.

    Raises:
        BenchError: When the prior has another size, is not symmetric or not positive definite in a block, or
            the structure lacks entries inside a block.
    """
    check_symmetric(structure)
    P = check_array(prior.C_theta, (structure.n_theta,) * 2, f"prior {prior.name} [m/N, rad/(N m)]")
    sizes = tuple(len(block) for block in structure.blocks)
    if sum(n * (n + 1) // 2 for n in sizes) != structure.n:
        raise BenchError(
            f"prior: expected a structure of whole blocks, {structure.name} lacks entries in one"
        )
    P = aggregate(P, vjm, structure)
    L, expected = np.zeros((structure.n, structure.n)), np.zeros(structure.n)
    first = 0
    for block in structure.blocks:
        root = _root(P[np.ix_(block, block)], f"prior {prior.name}, {structure.labels[block[0]]} ...")
        column, row = np.triu_indices(len(block))[::-1]
        order = np.lexsort((row, column))
        row, column = row[order], column[order]
        last = first + len(row)
        L[np.ix_(_entries(structure, block), np.arange(first, last))] = _congruence(
            structure, block, root, row, column
        )
        expected[first:last] = row == column
        first = last
    return Metric(prior.name, structure, L, expected, sizes)


def aggregate(C: Array, vjm: Vjm, structure: Structure) -> Array:
    """C_theta with the joints that a structure leaves out put into the links before them."""
    C, first = C.copy(), 6 * len(vjm.arm.links)
    used = np.union1d(structure.a, structure.b)
    for j, link in enumerate(vjm.arm.links[:-1]):
        if first + j not in used:
            axis = link.frame.T @ vjm.placements[j][:3, :3] @ vjm.axes[j]
            turn = slice(6 * j + 3, 6 * j + 6)
            C[turn, turn] += C[first + j, first + j] * np.outer(axis, axis)
    return C


def whitened(regression: Regression, metric: Metric) -> tuple[Array, Array]:
    """All terms' rows in the metric, so that |A x - y|^2 is chi squared less what nothing explains.

    Returns:
        A, (terms n, n) [1], and y, (terms n,).
    """
    rows = [math.sqrt(term.equations / 3) * np.c_[term.R @ metric.L, term.z] for term in regression.terms]
    A, y = np.split(np.vstack(rows), [metric.structure.n], axis=1)
    return A, y[:, 0]


def rescaled(metric: Metric, regression: Regression) -> Metric:
    """The metric of a prior whose common scale is that of the data, fitted as the only unknown.

    An uncertainty is then relative to compliances of the right size, however wrong the prior's own scale is.

    Args:
        metric: The structure in the metric of the prior.
        regression: The reduced dataset.

    Raises:
        BenchError: When the data want a scale that is not above 0.
    """
    A, y = whitened(regression, metric)
    moved = A @ metric.expected
    size = float(moved @ moved)
    scale = float(moved @ y) / size if size > 0 else 1.0
    if not scale > 0:
        raise BenchError(
            f"prior {metric.prior}: expected data that move with the load, its best scale is {scale:.3g}"
        )
    return replace(metric, L=scale * metric.L)


def _root(P: Array, what: str) -> Array:
    """Symmetric square root of a block of the prior.

    Raises:
        BenchError: When it is not symmetric positive definite.
    """
    d = np.sqrt(np.maximum(np.diag(P), 0))
    if not (d > 0).all() or np.abs(P - P.T).max() > 1e-9 * np.abs(P).max():
        raise BenchError(f"{what}: expected a symmetric block with a positive diagonal")
    smallest = float(np.linalg.eigvalsh(P / np.outer(d, d))[0])
    if smallest <= SMALLEST:
        raise BenchError(
            f"{what}: expected a positive definite block, got smallest eigenvalue {smallest:.3g} (of the "
            "block scaled to unit diagonal)"
        )
    values, Q = np.linalg.eigh(P / np.outer(d, d))
    return np.asarray(d[:, None] * (Q * np.sqrt(values)) @ Q.T)


def _entries(structure: Structure, block: npt.NDArray[np.int_]) -> npt.NDArray[np.int_]:
    """Parameters of a block."""
    return np.flatnonzero(np.isin(structure.a, block))


def _congruence(
    structure: Structure,
    block: npt.NDArray[np.int_],
    root: Array,
    row: npt.NDArray[np.int_],
    column: npt.NDArray[np.int_],
) -> Array:
    """Parameters of a block per unit of each entry of its x: C = root X root^T."""
    position = np.full(structure.n_theta, -1)
    position[block] = np.arange(len(block))
    k = _entries(structure, block)
    a, b = root[position[structure.a[k]]], root[position[structure.b[k]]]
    weight = np.where(row == column, 0.5, math.sqrt(0.5))
    return np.asarray(weight * (a[:, row] * b[:, column] + a[:, column] * b[:, row]))
