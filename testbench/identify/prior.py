"""Priors: compliances that are expected before any reading, with their relative uncertainty.

`cad_prior` makes a prior from the nominal arm. `hierarchy` learns its scales and uncertainties from readings.

A prior states a positive definite compliance P for every block. In units of the prior a compliance is
C = P^1/2 X P^1/2, and X = 1 is expected. The coordinates x = svec(X) are of order one; C is positive
semi-definite if and only if X is. In these units the prior adds equations to the least-squares problem.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from numbers import Real

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, check_array, check_type
from testbench.identify import cone
from testbench.identify.regression import Regression, check_symmetric
from testbench.model.structure import BEAM_ENTRIES, Structure
from testbench.model.vjm import Vjm

# --- Priors: compliances expected before any reading, and their relative uncertainty ------------------------

UNCERTAINTY_RANGE = 1e-6, 1e6
"""Least and largest relative uncertainty that `PriorUncertainty` accepts [1]."""
COUPLING_REDUCTION = 0.5
"""Share of off-diagonal compliances that `with_weaker_coupling` removes from every link [1].

A beam couples displacements and rotations; elastic bearings and flanges at its ends do not.
"""
N_CACHED_PRIORS = 32
"""Number of results of `with_weaker_coupling` that are cached, so that their scalings are cached too."""


@dataclass(frozen=True, eq=False, repr=False)
class Prior(Displayed):
    """Hold the expected compliances of an arm, with the origin of their numbers.

    The array cannot be changed. Two priors with equal numbers count as different.
    """

    name: str  #: Origin of the numbers, for reports.
    #: Expected aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N]; symmetric positive definite
    #: in the block of every link and joint.
    C_theta: Array

    def summary(self) -> dict[str, object]:
        """Summarise the prior: the origin of its numbers."""
        return {"name": self.name}

    def __post_init__(self) -> None:
        """Copy C_theta and make it read-only, because scalings are cached; BenchError if it is not finite."""
        C = np.array(check_array(self.C_theta, (None, None), f"prior {self.name} [m/N, rad/(N m)]"))
        C.setflags(write=False)
        object.__setattr__(self, "C_theta", C)


@dataclass(frozen=True)
class PriorUncertainty:
    """Hold the relative uncertainty of a prior on compliances: standard deviations over expected values.

    `relative` and `scale` suffice; the other fields are exceptions for some entries.
    """

    relative: float  #: Relative standard deviation u of every compliance [1].
    #: Relative standard deviation of a factor that all compliances share [1]; infinite if only the data
    #: determine this factor.
    scale: float = np.inf
    #: u of entries inside a link that couple axes which a straight beam does not couple [1]; None for
    #: `relative`.
    link_coupling: float | None = None
    #: Factor on u of every block (link or joint), (blocks,) [1]; None for 1.
    block_factors: tuple[float, ...] | None = None
    joint_coupling: float | None = None  #: u of entries that couple two joints [1]; None for `relative`.

    def __post_init__(self) -> None:
        """Check u against `UNCERTAINTY_RANGE`, and that `scale` is at least 0; BenchError if not."""
        low, high = UNCERTAINTY_RANGE
        coupling = self.relative if self.link_coupling is None else self.link_coupling
        for name, value in (("relative", self.relative), ("link_coupling", coupling)):
            if not (isinstance(value, Real) and low <= value <= high):
                raise BenchError(f"{name}: expected a number from {low:g} to {high:g}, got {value!r}")
        if not self.scale >= 0:
            raise BenchError(f"scale: expected 0 or more, got {self.scale}")


def cad_prior(arm: Arm) -> Prior:
    """Make a prior from the nominal compliances of an arm: links as beams, joints as in the catalogue.

    Args:
        arm: The nominal arm, as `load_arm` reads it.

    Raises:
        BenchError: When the argument is no arm.
    """
    check_type(arm, Arm, "arm")
    return Prior(f"CAD of {arm.name}", arm.C_theta)


@lru_cache(maxsize=N_CACHED_PRIORS)
def with_weaker_coupling(prior: Prior) -> Prior:
    """Reduce off-diagonal compliances of a prior: (1 - r) C + r diag(C), r = `COUPLING_REDUCTION`; cached.

    Mathematics: `prior-6`.
    """
    C = prior.C_theta
    return replace(prior, C_theta=(1 - COUPLING_REDUCTION) * C + COUPLING_REDUCTION * np.diag(np.diag(C)))


def perturb_prior(prior: Prior, *, scale: float, shape: float, rng: np.random.Generator) -> Prior:
    """Make a wrong prior for tests of robustness: a factor times D C D, with D diagonal and random.

    Args:
        prior: Expected compliances C.
        scale: The factor on all compliances [1].
        shape: Standard deviation of the logarithm of the factor D_ii^2 on a diagonal compliance [1].
        rng: Source of randomness.

    Returns:
        The wrong prior; its blocks remain positive definite.

    Raises:
        BenchError: When scale is not above 0 or shape is below 0.
    """
    if not scale > 0 or not shape >= 0:
        raise BenchError(f"prior: expected a scale above 0 and a shape of at least 0, got {scale}, {shape}")
    factor = np.exp(shape / 2 * rng.standard_normal(len(prior.C_theta)))  # on both sides of C
    name = f"{prior.name}, {scale:g} times, shape {100 * shape:g} % off"
    return Prior(name, scale * factor[:, None] * prior.C_theta * factor)


def aggregate_left_out_joints(C: Array, vjm: Vjm, structure: Structure) -> Array:
    """Add the compliance c of joints that a structure leaves out to the link before them, as the paper does.

    The block of this link becomes C_link + c a a^T, with the joint's axis a in the link's frame.

    Mathematics: `prior-5`.

    Args:
        C: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        vjm: The arm's virtual joint model.
        structure: Structure of the unknowns.

    Returns:
        Aggregated compliance with these links changed, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
    """
    C, first = C.copy(), 6 * len(vjm.arm.links)
    out = np.flatnonzero(structure.block_of_row[first : first + vjm.arm.n_joints] < 0)
    slides = ~vjm.arm.hinges[out]
    rows = 6 * out[:, None] + np.where(slides, 0, 3)[:, None] + np.arange(3)  # that the joint moves
    axis = vjm.joint_axes_in_beam_frame[out]
    added = C[first + out, first + out, None, None] * axis[:, :, None] * axis[:, None, :]
    C[rows[:, :, None], rows[:, None, :]] += added
    return C


# --- Compliances in units of a prior ------------------------------------------------------------------------

N_CACHED_SCALINGS = 32  #: Number of results of `scale_by_prior` that are cached.
#: Largest asymmetry of a prior that is accepted, after it is scaled to unit diagonal [1].
MAX_PRIOR_ASYMMETRY = 1e-9
#: Least eigenvalue of a block of the prior that is accepted, after it is scaled to unit diagonal [1].
MIN_PRIOR_EIGENVALUE = 1e-9


@dataclass(frozen=True)
class PriorScaling:
    """Hold the parameters of a structure in units of a prior: pi = L x, with x = svec(X) of order one.

    A block of compliances with the expectation P is C = P^1/2 X P^1/2.
    """

    prior_name: str  #: Name of the prior.
    structure: Structure  #: Structure of the n parameters.
    L: Array  #: Parameters pi per unit of x, block diagonal, (n, n) [m/N, rad/N, rad/(N m)].
    expected_x: Array  #: Expected x: svec of X = 1, (n,) [1].

    @property
    def block_orders(self) -> tuple[int, ...]:
        """Return the order of the matrix of every block, (blocks,)."""
        return self.structure.block_orders

    @cached_property
    def is_link_coupling(self) -> Mask:
        """Tell which parameters couple two axes of a link that do not couple in a straight beam, (n,)."""
        row, column = self.structure.upper_triangles
        beam = np.isin(6 * (row % 6) + column % 6, [6 * a + b for a, b in BEAM_ENTRIES])
        return np.asarray((row < 6 * self.structure.n_links) & ~beam)

    @cached_property
    def is_joint_coupling(self) -> Mask:
        """Tell which parameters couple two joints, (n,)."""
        row, column = self.structure.upper_triangles
        return np.asarray((row >= 6 * self.structure.n_links) & (row != column))

    @cached_property
    def scale_exponents(self) -> tuple[Array, Ids, tuple[str, ...]]:
        """Return how scales of K links and joints determine the scales of all n parameters.

        The scale of a parameter is the product of the K scales, each to its exponent: 1 for the link or joint
        of the parameter, 1/2 and 1/2 for both joints of a coupling.

        Returns:
            Exponents, (n, K) [1]; kind of every scale as in `block_kinds`, (K,); and K names of links and
            joints.
        """
        owner = np.repeat(np.arange(len(self.block_orders)), [cone.svec_length(n) for n in self.block_orders])
        row, column = self.structure.upper_triangles
        first = np.array([block[0] for block in self.structure.blocks])
        tied = (self.block_kinds == 1) & (np.array(self.block_orders) > 1)
        a, b = (np.where(tied[owner], end, first[owner]) for end in (row, column))
        at, place = np.unique(np.r_[a, b], return_inverse=True)
        shares = (np.eye(len(at))[place[: len(a)]] + np.eye(len(at))[place[len(a) :]]) / 2
        block = self.structure.block_of_row[at]
        names = [
            self.structure.row_labels[k] if tied[block_index] else self.block_names[block_index]
            for k, block_index in zip(at.tolist(), block.tolist(), strict=True)
        ]
        return shares, self.block_kinds[block], tuple(names)

    @cached_property
    def block_kinds(self) -> Ids:
        """Return the kind of every block, (blocks,): 0 a link, 1 a joint, 2 + k the size of joint law k."""
        first, joints = 6 * self.structure.n_links, self.structure.n_links - 1
        row = np.array([block[0] for block in self.structure.blocks])
        return np.asarray(np.where(row < first, 0, 1 + (row - first) // max(joints, 1)))

    @cached_property
    def is_joint_law_size(self) -> Mask:
        """Tell which parameters are sizes of joint laws, not compliances, (n,)."""
        return np.asarray(self.structure.upper_triangles[0] >= self.structure.n_compliance_rows)

    @property
    def block_names(self) -> tuple[str, ...]:
        """Return the name of every block of C_theta: its link or joint, or one axis of its link."""
        labels = [self.structure.row_labels[block[0]] for block in self.structure.blocks]
        whole = [size == 6 for size in self.block_orders]
        return tuple(
            label.rpartition(".")[0] if is_whole else label
            for label, is_whole in zip(labels, whole, strict=True)
        )


@dataclass(frozen=True)
class LearntScale:
    """Hold the factor on the prior compliance of one link or joint that the readings determine."""

    name: str  #: Name of the link or joint; "joints" for a factor that all joints share.
    factor: float  #: Identified compliance over the prior's, relative to other links or joints [1].
    log_deviation: float  #: Standard deviation of the logarithm of the factor [1].


@dataclass(frozen=True)
class WeightedPrior:
    """Hold a prior for the parameters of one structure, with its relative uncertainty."""

    scaling: PriorScaling  #: The parameters in units of the prior.
    uncertainty: PriorUncertainty  #: Relative uncertainty of the prior, divided by `noise_factor`.
    #: Factor kappa on the stated noise that covers the error of the model too [1].
    noise_factor: float = 1.0
    #: Change of the parameters per standard deviation of each of k learnt hyperparameters, (k, n) [m/N,
    #: rad/(N m), rad/N]; None where the uncertainty was stated, not learnt.
    hyperparameter_effect: Array | None = None
    #: Factor on the uncertainty of every entry of x because the learnt uncertainty is itself uncertain, (n,)
    #: [1]; None where the uncertainty was stated, not learnt.
    uncertainty_factors: Array | None = None
    learnt_scales: tuple[LearntScale, ...] = ()  #: Factors on links and joints that the readings determine.
    #: Logarithm of the density of the readings under this model, up to a constant that all models share [1];
    #: None if it was not requested.
    log_evidence: float | None = None


@lru_cache(maxsize=N_CACHED_SCALINGS)
def scale_by_prior(prior: Prior, vjm: Vjm, structure: Structure) -> PriorScaling:
    """Compute the parameters in units of a prior, pi = L x, from C = P^1/2 X P^1/2 in every block; cached.

    A joint that the structure leaves out adds its compliance to the link before it, as in the paper. A link
    that the structure leaves out is rigid. Joint laws have the expected size one.

    Mathematics: `prior-1`.

    Args:
        prior: Expected compliances P.
        vjm: The arm's virtual joint model.
        structure: Structure of the n parameters; it has all entries of its blocks.

    Returns:
        The scaling: L, and the expected x.

    Raises:
        BenchError: When the prior has another size, is not symmetric or not positive definite in a block, or
            the structure lacks entries inside a block.
    """
    check_symmetric(structure)
    plain = structure.n_compliance_rows
    P = np.eye(structure.n_theta)
    P[:plain, :plain] = check_array(prior.C_theta, (plain,) * 2, f"prior {prior.name} [m/N, rad/(N m)]")
    if not structure.has_full_blocks:
        raise BenchError(
            f"prior: expected a structure of whole blocks, {structure.name} lacks entries in one"
        )
    row, column = structure.upper_triangles
    root = _root(aggregate_left_out_joints(P, vjm, structure), prior, structure)
    L = np.zeros((structure.n_parameters, structure.n_parameters))
    expected = np.where(row == column, 1.0, 0.0)
    for group in structure.block_groups:
        parameters = structure.parameter_of_entry[group.triangle_indices]
        L[parameters[:, :, None], group.triangle_indices[:, None, :]] = _congruences(root[group.index_arrays])
    return PriorScaling(prior.name, structure, L, expected)


def rows_in_prior_units(regression: Regression, scaling: PriorScaling) -> tuple[Array, Array]:
    """Compute the weighted equations A x = y in units of a prior; |A x - y|^2 is chi^2 minus a constant.

    Args:
        regression: The weighted equations in pi.
        scaling: The parameters pi = L x in units of the prior.

    Returns:
        A, (rows, n) [1], and y, (rows,) [1].
    """
    A, y = regression.weighted_equations
    return A @ scaling.L, y


def prior_rows(scaling: PriorScaling, uncertainty: PriorUncertainty) -> tuple[Array, Array]:
    """Compute the equations B x = c of a prior: it adds |B x - c|^2 to chi^2.

    The prior's covariance is diag(d)^2 + v^2 e e^T, with the expectation e of x, the standard deviations d of
    its entries and v of the common scale. B is a root of the inverse; where v is infinite it projects e out.

    Mathematics: `prior-2`.

    Args:
        scaling: The parameters in units of the prior.
        uncertainty: Relative uncertainty of the prior.

    Returns:
        B, (n, n) [1], and c, (n,) [1].
    """
    d = np.full(len(scaling.expected_x), uncertainty.relative)
    if uncertainty.link_coupling is not None:  # of a structure of whole blocks
        d[scaling.is_link_coupling] = uncertainty.link_coupling
    if uncertainty.joint_coupling is not None:
        d[scaling.is_joint_coupling] = uncertainty.joint_coupling
    if uncertainty.block_factors is not None:
        d = d * np.repeat(uncertainty.block_factors, [cone.svec_length(n) for n in scaling.block_orders])
    e = scaling.expected_x / d
    size = np.linalg.norm(e)
    e, along = e / size, 1 / np.hypot(1, size * uncertainty.scale)
    B = (np.eye(len(e)) - (1 - along) * np.outer(e, e)) / d
    return B, along * size * e


def rows_with_prior(
    regression: Regression, scaling: PriorScaling, uncertainty: PriorUncertainty
) -> tuple[Array, Array]:
    """Stack the equations of data and prior, M x = r: least squares with a prior minimises |M x - r|^2.

    Mathematics: `prior-4`.

    Args:
        regression: The weighted equations of the data.
        scaling: The parameters x in units of the prior.
        uncertainty: Relative uncertainty of the prior.

    Returns:
        M, (rows, n) [1], and r, (rows,) [1].
    """
    (A, y), (B, c) = rows_in_prior_units(regression, scaling), prior_rows(scaling, uncertainty)
    return np.vstack([A, B]), np.r_[y, c]


def rescale_to_data(scaling: PriorScaling, regression: Regression) -> PriorScaling:
    """Multiply all compliances of a prior by the one factor that fits the data best.

    A relative uncertainty then refers to compliances of the right size, even if the prior's scale is wrong.

    Mathematics: `prior-3`.

    Args:
        scaling: The parameters in units of the prior.
        regression: The weighted equations of the data.

    Returns:
        The scaling with L times the factor; sizes of joint laws are not multiplied.

    Raises:
        BenchError: When the best factor is not above 0.
    """
    A, y = rows_in_prior_units(regression, scaling)
    moved = A @ np.where(scaling.is_joint_law_size, 0.0, scaling.expected_x)
    size = float(moved @ moved)
    scale = float(moved @ y) / size if size > 0 else 1.0
    if not scale > 0:
        raise BenchError(
            f"prior {scaling.prior_name}: expected readings that move with the load; "
            f"the best scale is {scale:.3g}"
        )
    return replace(scaling, L=np.where(scaling.is_joint_law_size, 1.0, scale) * scaling.L)


def _root(P: Array, prior: Prior, structure: Structure) -> Array:
    """Compute the symmetric square root of every block of a prior.

    BenchError when a block is not symmetric positive definite.
    """
    # Each block is scaled to unit diagonal, because metres and radians differ in size.
    d = np.sqrt(np.maximum(np.diag(P), 0))
    safe = np.where(d > 0, d, 1.0)
    unit, root = P / np.outer(safe, safe), np.zeros_like(P)
    row, column = structure.upper_triangles
    bad = (d[row] == 0) | (np.abs(unit[row, column] - unit[column, row]) > MAX_PRIOR_ASYMMETRY)
    if bad.any():
        raise _prior_error(prior, structure, row[np.argmax(bad)], "symmetric block with a positive diagonal")
    for group in structure.block_groups:
        values, Q = np.linalg.eigh(unit[group.index_arrays])
        if values.min() <= MIN_PRIOR_EIGENVALUE:
            k = np.argmin(values[:, 0])
            problem = f"positive definite block, got smallest eigenvalue {values[k, 0]:.3g}"
            problem += " (of the block scaled to unit diagonal)"
            raise _prior_error(prior, structure, group.theta_rows[k, 0], problem)
        root[group.index_arrays] = (
            d[group.theta_rows, None] * (Q * np.sqrt(values)[:, None]) @ Q.swapaxes(1, 2)
        )
    return root


def _prior_error(prior: Prior, structure: Structure, row: int, expected: str) -> BenchError:
    """Make the error about the block of a prior that holds a row of C_theta."""
    label = structure.row_labels[structure.blocks[structure.block_of_row[row]][0]]
    return BenchError(f"prior {prior.name}, {label} ...: expected a {expected}")


def _congruences(roots: Array) -> Array:
    """Compute entries of root X root^T, upper triangle, per entry of svec(X), (k, entries, entries)."""
    row, column = cone.upper_triangle(roots.shape[1])
    a, b = roots[:, row], roots[:, column]
    weight = np.where(row == column, 0.5, math.sqrt(0.5))
    return np.asarray(weight * (a[..., row] * b[..., column] + a[..., column] * b[..., row]))
