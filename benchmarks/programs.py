"""Random reduced datasets, kind ones and nasty ones, for which an independent solver is the referee."""

import math

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.prior import PriorScaling, PriorUncertainty, WeightedPrior
from testbench.identify.regression import Regression, ResidualTerm, regression_from_terms
from testbench.model.structure import Structure

SIZES = ((6, 6, 1, 1), (1, 2, 2, 1, 3), (6, 1), (3, 3, 2), (2,), (6,), (4, 5, 1), (1, 1, 1))
NOISE = 0.02  #: Of every reading, as a share of their root mean square.
NASTY = (
    "columns of zeros",
    "rank one",
    "fewer rows than unknowns",
    "no noise",
    "readings against the loads",
    "readings of 1e-6",
    "readings of 1e6",
)


def structure_of(sizes: tuple[int, ...]) -> Structure:
    """A structure of whole blocks of these sizes."""
    first = np.cumsum((0, *sizes))[:-1]
    pairs = [
        (k + i, k + j)
        for k, size in zip(first, sizes, strict=True)
        for j in range(size)
        for i in range(j + 1)
    ]
    a, b = np.array(pairs).T
    labels = tuple(f"row_{k}" for k in range(sum(sizes)))
    return Structure("random", sum(sizes), a, b, labels)


def random_regression(kind: str, rng: np.random.Generator) -> Regression:
    """A dataset of a random conservative truth, of one or two terms; `kind` is "kind" or one of NASTY."""
    sizes = SIZES[rng.integers(len(SIZES))]
    structure = structure_of(sizes)
    C = np.zeros((structure.n_theta,) * 2)
    for block in structure.blocks:
        V = rng.standard_normal((rng.integers(1, len(block) + 1), len(block)))
        C[np.ix_(block, block)] = V.T @ V / len(block)
    pi, n = structure.parameters_of(C), structure.n_parameters
    rows = n + 2 + int(rng.integers(n + 1))
    if kind == "fewer rows than unknowns":
        rows = max(2, n // 2)
    terms = [_term(kind, pi, rows, rng) for _ in range(1 + int(rng.integers(2)))]
    return regression_from_terms(structure, tuple(terms))


def _term(kind: str, pi: np.ndarray, rows: int, rng: np.random.Generator) -> ResidualTerm:
    n = len(pi)
    A = rng.standard_normal((rows, n)) * 10 ** rng.uniform(-1.5, 0, n)
    if kind == "columns of zeros":
        A[:, rng.random(n) < 0.2] = 0
    if kind == "rank one":
        A = np.outer(rng.standard_normal(rows), rng.standard_normal(n))
    y = A @ pi
    size = np.linalg.norm(y) / math.sqrt(rows)
    if kind != "no noise":
        y = y + NOISE * size * rng.standard_normal(rows)
    scale = {"readings of 1e-6": 1e-6, "readings of 1e6": 1e6, "readings against the loads": -1.0}.get(
        kind, 1.0
    )
    T = np.zeros((n + 1, n + 1))
    R = np.linalg.qr(
        np.c_[A, scale * y] / (NOISE * abs(scale) * (size or 1.0) * math.sqrt(rows / 3)), mode="r"
    )
    T[: len(R)] = R
    return ResidualTerm(R=T[:n, :n], z=T[:n, n], unexplained=float(T[n, n] ** 2), n_equations=rows)


def random_prior(s: Structure, uncertainty: float, rng: np.random.Generator) -> WeightedPrior:
    """A prior that has nothing to do with the truth."""
    row, column = s.upper_triangles
    L = np.zeros((s.n_parameters, s.n_parameters))
    L[s.parameter_of_entry, np.arange(s.n_parameters)] = np.where(
        row == column, 1.0, math.sqrt(0.5)
    ) * 10 ** rng.uniform(-1, 1)
    one = np.where(row == column, 1.0, 0.0)
    scaling = PriorScaling("random", s, L, one)
    return WeightedPrior(scaling, PriorUncertainty(uncertainty))


def block_matrices(scaling: PriorScaling, x: Array) -> list[Array]:
    """Unpack the matrices of all blocks of a prior's units from x, their svecs one after the other."""
    ends = np.cumsum([cone.svec_length(n) for n in scaling.block_orders])[:-1]
    return [cone.smat(part) for part in np.split(x, ends)]
