"""The result of identification: an `Estimate` with its compliances, fit, certificate and status.

`deflections` predicts a dataset with an estimate, and `score` compares the prediction with measured or true
deflections.

`lilliefors` tests whether residuals come from a normal distribution of any mean and deviation. Its statistic
is the largest distance between the distribution of the residuals and the normal one with their own mean and
deviation (Lilliefors 1967). Its distribution under normality has no closed form; it is simulated with fixed
random numbers, so that one sample has one p value.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import get_args

import numpy as np

from testbench.arm.elastic import SYMMETRY_TOLERANCE, unit_diagonal_scale
from testbench.data.dataset import Dataset
from testbench.display import Displayed
from testbench.errors import Array, BenchError, check_array, check_type
from testbench.identify.prior import WeightedPrior
from testbench.identify.regression import RUNS_PER_BATCH, Regression, f_m, regression_from_terms
from testbench.model.laws import set_load_history, vjm_for_structure
from testbench.model.structure import Constraint as Constraint
from testbench.model.structure import Structure
from testbench.model.vjm import (
    Vjm,
    evaluate_chain,
    generalised_load,
    marker_positions,
    translational_jacobian,
)

# --- The result of identification: an `Estimate` with its compliances, fit, certificate and status ----------

CONSERVATIVE_TOLERANCE = 1e-10
"""Eigenvalue of a block, negative and relative to its largest, that still counts as zero [1].

V^T V has no negative eigenvalue; its rounding has.
"""


ORIENTATION_READING = "orientation"
"""Stands in the place of a marker's name for a reading of the tool's orientation."""


@dataclass(frozen=True)
class Dual:
    """Hold dual vectors y_k, |y_k| <= 1, one per term of F_M, Eq. (19); they prove a lower bound of F_M.

    Each term is a norm |r_k| of residuals, and |r_k| >= y_k . r_k. `certify` uses this bound.
    """

    y: Array  #: Components against the rows of the term's R, (terms, n) [1].
    y_unexplained: Array  #: Components against the residual that no parameter explains, (terms,) [1].


@dataclass(frozen=True)
class TracePenalty:
    """Hold the trace term of GCO, in addition to F_M: the least w <W, C'> of all C' >= 0 that make up C.

    If a structure includes a joint in the block of the link before it, C' has an unknown t for the joint:
    the block is C = C' + t a a^T, with a the joint's axis. Without such joints C' is C.
    """

    weight: float  #: w [N m/rad].
    W_diagonal: Array  #: Diagonal of W, (n_theta,) [rad^2/m^2 for translations, 1 for rotations].
    structure: Structure  #: The unknowns of C', k of them.
    pi_per_split: Array  #: pi = split_to_whole @ (parameters of C'), (n, k) [1].

    @property
    def gradient(self) -> Array:
        """Return the gradient of the trace term w <W, C'> by the k parameters of C', (k,).

        W is diagonal, and C' holds the compliances of links and joints.
        """
        s = self.structure
        return np.where(s.rows == s.columns, self.weight * self.W_diagonal[s.rows], 0.0)

    def regression_of_split(self, regression: Regression) -> Regression:
        """Rewrite the equations as a function of the k parameters of C'.

        Args:
            regression: Equations in the n parameters pi of the model.

        Returns:
            The same equations in the parameters of C'.
        """
        terms = (replace(term, R=term.R @ self.pi_per_split) for term in regression.terms)
        return regression_from_terms(self.structure, tuple(terms))


UNOBSERVED_SCALING_SENSITIVITY = 1e-3
"""Sensitivity of an axis that the data do not load, as a share of the largest: for scaling only."""


def sensitivity_units(
    regression: Regression, f_m_unit: float = 1.0, penalty: TracePenalty | None = None
) -> Array:
    """Compute units of pi in which all parameters change F_M equally: C = unit d X d^T.

    d^-2 is the change of F_M and of the trace term with each diagonal entry. This is a congruence, so that X
    is positive semi-definite where C is.

    Args:
        regression: The reduced dataset.
        f_m_unit: Unit of F_M [1].
        penalty: The trace term; None for none.

    Returns:
        Unit of every parameter, (n,) [m/N, rad/(N m), rad/N].
    """
    s, weight = regression.structure, regression.diagonal_sensitivity
    trace_cost = 0.0 if penalty is None else penalty.weight * penalty.W_diagonal
    d = 1 / np.sqrt(np.maximum(weight, UNOBSERVED_SCALING_SENSITIVITY * (weight.max() or 1.0)) + trace_cost)
    return np.asarray(f_m_unit * d[s.rows] * d[s.columns])


@dataclass(frozen=True, repr=False)
class Certificate(Displayed):
    """Hold bounds on how much better than an estimate any conservative model can fit, Eq. (19).

    They hold for all models whose blocks have traces within `trace_bounds`.
    """

    #: Upper bound of F_M + w <W, C> above its least value [1]; it measures how well the program is solved.
    duality_gap: float
    #: Upper bound of F_M above its least value [1]; for a solved program, the cost of its trace term.
    f_m_excess_bound: float
    trace_bounds: Array  #: Bound t_i of the trace of each block in scaled units, (blocks,) [rad/(N m)].
    dual: Dual  #: The proof; the best one known may certify any other estimate of the same regression.

    def summary(self) -> dict[str, object]:
        """Summarise the bounds."""
        return {
            "duality_gap": f"{self.duality_gap:.3g}",
            "f_m_excess_bound": f"{self.f_m_excess_bound:.3g}",
            "blocks": len(self.trace_bounds),
        }


@dataclass(frozen=True)
class RejectedReading:
    """Hold one reading that a robust estimate leaves out."""

    run: int  #: Identifier of its run.
    marker: str  #: Name of its marker, or `ORIENTATION_READING`.
    #: Distance of the reading from the estimate's prediction [m, or rad for an orientation]. The limit
    #: applied to an earlier fit, so that a few of these are below it.
    residual: float
    residual_over_sigma: (
        float  #: The same distance over the standard deviation of a deflection, sqrt(2) sigma [1].
    )


@dataclass(frozen=True)
class ModelAverage:
    """Hold the models that an estimate averages: with links, joints only, joint laws, coupled joints."""

    #: Weight of joints only against links and joints: its probability given the readings, or 1 where links
    #: do not predict poses better that were left out [1].
    joints_only_weight: float
    links_and_joints: "Estimate"  #: The model of links and joints.
    joints_only_probability: float = 0.0  #: Probability of joints only that intervals use [1].
    joints_only: "Estimate | None" = None  #: The model of joints only; None where its weight is zero.
    joint_laws_weight: float = 0.0  #: Weight of the model with joint laws in the mean [1].
    joint_laws_probability: float = 0.0  #: Probability of that model that intervals use [1].
    with_joint_laws: "Estimate | None" = None  #: The model with joint laws; None where it was not fitted.
    joint_couplings_weight: float = 0.0  #: Weight and probability of the model with coupled joints [1].
    #: The model with coupled joints, without laws; None where its weight is zero.
    with_joint_couplings: "Estimate | None" = None
    #: Averaged estimate under each of two priors, and its probability; empty where one prior has all weight.
    under_each_prior: "tuple[tuple[float, Estimate], ...]" = ()


@dataclass(frozen=True, repr=False)
class Estimate(Displayed):
    """Hold a stiffness model identified from a dataset: compliances, fit, certificate, status.

    Every method returns one, and `predict`, `intervals`, `certify` and `score` take it. A poor fit is a
    result: `status`, `f_m` against `f_m_floor`, and `advice` describe it.
    """

    method: str  #: Name of the method.
    regression: Regression  #: The equations that it was identified from, with structure and reduced dataset.
    pi: Array  #: Parameters, (n,) [m/N, rad/(N m), rad/N].
    #: Aggregated compliance of the virtual joints, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
    C_theta: Array
    f_m: float  #: Cost F_M, Eq. (19) [1]; compare it with `f_m_floor`.
    #: "solved" if it is proven optimal, else the failure; "not certified" where no proof was requested.
    status: str = "not certified"
    #: Distance from the optimum; None where none was computed, as for least squares.
    certificate: Certificate | None = None
    #: Time inside the numerical solver [s], as it reports it; 0 where it does not.
    solver_seconds: float = 0.0
    advice: tuple[str, ...] = ()  #: Sentences for the user, from an estimator of your own.
    #: Constraint that the method put on the blocks; "own" where it is unknown.
    constraint: Constraint = "own"
    penalty: TracePenalty | None = None  #: Trace term of GCO without a prior; None for none.
    split_parameters: Array | None = None  #: Parameters of the penalty's C', (k,); None without a penalty.
    #: Whether only the tie-break of `paper_gco` keeps an unobservable compliance finite.
    bounded_by_tie_break: bool = False
    weighted_prior: WeightedPrior | None = None  #: The prior that was used as data; None without one.
    rejected: tuple[
        RejectedReading, ...
    ] = ()  #: Readings that a robust fit left out, in the order of the dataset.
    rejected_runs: tuple[int, ...] = ()  #: Identifiers of runs all of whose readings were left out.
    average: ModelAverage | None = None  #: The models that it averages; None for a single model.

    def summary(self) -> dict[str, object]:
        """Return the rows of the small table that shows an estimate: method, structure, fit and status."""
        return {
            "method": self.method,
            "structure": self.structure.name,
            "unknowns": self.structure.n_parameters,
            "conservative": self.conservative,
            "f_m": f"{self.f_m:.3f}",
            "f_m_floor": f"{self.f_m_floor:.3f}",
            "status": self.status,
        }

    @property
    def structure(self) -> Structure:
        """Return the unknowns that were identified."""
        return self.regression.structure

    @property
    def f_m_floor(self) -> float:
        """Return the F_M to expect from noise alone, sqrt(3 (1 - rank / equations)) per term [1]."""
        return self.regression.f_m_floor

    @property
    def compliance_regression(self) -> Regression:
        """Return the equations of links and joints only, without joint laws or coupled joints."""
        if self.average is None or (
            self.average.with_joint_laws is None and self.average.with_joint_couplings is None
        ):
            return self.regression
        return self.average.links_and_joints.regression

    @cached_property
    def conservative(self) -> bool:
        """Tell whether every block of C_theta is symmetric and positive semi-definite, up to rounding."""
        return is_conservative(self.structure, self.C_theta)

    @cached_property
    def eigenvalues(self) -> tuple[Array, ...]:
        """Return the eigenvalues of every block's symmetric part, ascending, one array per block."""
        C = (self.C_theta + self.C_theta.T) / 2
        return tuple(np.asarray(np.linalg.eigvalsh(C[np.ix_(i, i)])) for i in self.structure.blocks)

    @property
    def min_eigenvalue(self) -> float:
        """Return the smallest eigenvalue of any block [mixed SI units], as the paper prints it."""
        return float(min(e[0] for e in self.eigenvalues))


Estimator = Callable[[Vjm, Structure, Dataset], Estimate]
"""The call shape of every identification method, and of a user's own."""


def make_estimate(
    regression: Regression,
    pi: Array,
    *,
    method: str,
    constraint: Constraint = "own",
    advice: tuple[str, ...] = (),
) -> Estimate:
    """Make an estimate from parameters: the last line of every estimator, and of your own.

    Args:
        regression: The reduced dataset, such as `reduce` returns.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].
        method: Name of the method, for reports.
        constraint: Constraint that the method put on the blocks; "own" for an estimator of your own.
        advice: Sentences for the user.

    Returns:
        The estimate with C_theta and F_M; add further fields by `dataclasses.replace`.

    Raises:
        BenchError: When the regression is none, the constraint is unknown, or pi has another shape or is not
            finite.
    """
    check_type(regression, Regression, "regression")
    if constraint not in get_args(Constraint):
        known = ", ".join(get_args(Constraint))
        raise BenchError(f"constraint: expected one of {known}, got {constraint!r}")
    pi = check_array(pi, (regression.structure.n_parameters,), "pi [m/N, rad/(N m), rad/N]")
    C, cost = regression.structure.matrix(pi), f_m(regression, pi)
    return Estimate(
        method=method,
        regression=regression,
        pi=pi,
        C_theta=C,
        f_m=cost,
        advice=advice,
        constraint=constraint,
    )


def is_conservative(structure: Structure, C: Array) -> bool:
    """Tell whether every block of C_theta is symmetric positive semi-definite up to rounding, Eq. (8)-(9).

    It scales C to unit diagonal first, so that metres and radians do not mix.

    Mathematics: `loaded-7`.

    Args:
        structure: The unknowns, which define the blocks.
        C: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].

    Returns:
        True if C is conservative (Section 2.2).
    """
    scale = unit_diagonal_scale(C)
    unitless = C / np.outer(scale, scale)
    if np.abs(unitless - unitless.T).max() > SYMMETRY_TOLERANCE:
        return False
    values = [np.linalg.eigvalsh(unitless[group.index_arrays]) for group in structure.block_groups]
    return all((v[:, 0] >= -CONSERVATIVE_TOLERANCE * np.maximum(v[:, -1], 0)).all() for v in values)


@dataclass(frozen=True, repr=False)
class DeflectionErrors(Displayed):
    """Hold the distance errors of predicted deflections over a set of runs."""

    rms: float  #: Root mean square of the distance error over all points [m].
    p95: float  #: 95th percentile of the distance error [m].
    max: float  #: Largest distance error [m].
    #: 95th percentile of the error over the measured deflection of its point [1]; None where no point moved.
    p95_relative: float | None
    #: Largest error over the measured deflection of its point [1]; None where no point moved.
    max_relative: float | None

    def summary(self) -> dict[str, object]:
        """Summarise the errors in millimetres and per cent."""
        lengths = {"rms_mm": self.rms, "p95_mm": self.p95, "max_mm": self.max}
        shares = {"p95_percent": self.p95_relative, "max_percent": self.max_relative}
        return {name: f"{1e3 * value:.4g}" for name, value in lengths.items()} | {
            name: None if value is None else f"{100 * value:.3g}" for name, value in shares.items()
        }


def deflections(vjm: Vjm, estimate: Estimate, data: Dataset) -> Array:
    """Predict the deflections of a dataset's markers, dp = J_p C_theta J_F^T w, Eq. (11).

    Args:
        vjm: The arm's virtual joint model.
        estimate: The identified compliances.
        data: Gives poses, loads and markers; its readings are not used.

    Returns:
        Deflection of every marker in every run in base axes, (runs, m, 3) [m].

    Raises:
        BenchError: When an argument has another type.
    """
    check_type(vjm, Vjm, "vjm")
    check_type(estimate, Estimate, "estimate")
    check_type(data, Dataset, "data")
    return np.asarray(deflections_of_models(vjm, [estimate], data)[0])


def deflections_of_models(vjm: Vjm, estimates: Sequence[Estimate], data: Dataset) -> Array:
    """Predict the deflections of a dataset's markers by several models at once, block by block of runs.

    Args:
        vjm: The arm's virtual joint model.
        estimates: The models.
        data: Gives poses, loads and markers; its readings are not used.

    Returns:
        J_p C_theta J_F^T w in base axes, (models, runs, m, 3) [m].
    """
    points, blocks = marker_positions(vjm, data.markers), []
    vjm = vjm_for_structure(vjm, max((estimate.structure for estimate in estimates), key=lambda s: s.n_theta))
    for first in range(0, data.runs, RUNS_PER_BATCH):  # so that memory does not grow with the runs
        runs = slice(first, first + RUNS_PER_BATCH)
        where = evaluate_chain(set_load_history(vjm, data.taken_off, runs), data.q[runs])
        load = generalised_load(where, data.wrench[runs], data.point[runs])
        rows = translational_jacobian(where, points)
        turns = [estimate.C_theta @ load[: len(estimate.C_theta)] for estimate in estimates]
        moved = [np.einsum("ptr,tr->rp", rows[:, : len(turn)], turn) for turn in turns]
        blocks.append(np.array(moved).reshape(len(moved), -1, len(points), 3))
    return np.concatenate(blocks, axis=1)


def score(predicted: Array, reference: Array) -> DeflectionErrors:
    """Score predicted deflections against measured or true ones.

    Args:
        predicted: Such as `deflections` returns, (runs, m, 3) [m].
        reference: Such as `Dataset.deflection`, (runs, m, 3) [m]; index both with `Dataset.seen` where
            targets were lost.

    Returns:
        Root mean square, 95th percentile and largest distance error, absolute and relative.

    Raises:
        BenchError: When the shapes differ, there is no number, or one is not finite.
    """
    predicted = check_array(predicted, (None,) * np.ndim(predicted), "predicted [m]")
    reference = check_array(reference, (None,) * np.ndim(reference), "reference [m]")
    if predicted.shape != reference.shape:
        raise BenchError(f"score: expected equal shapes, got {predicted.shape} and {reference.shape}")
    if not predicted.size:
        raise BenchError(f"score: expected at least one deflection, got shape {predicted.shape}")
    error = np.linalg.norm(predicted - reference, axis=-1).ravel()
    size = np.linalg.norm(reference, axis=-1).ravel()
    share = error[size > 0] / size[size > 0]
    return DeflectionErrors(
        rms=float(np.sqrt(np.mean(error**2))),
        p95=float(np.percentile(error, 95)),
        max=float(error.max()),
        p95_relative=float(np.percentile(share, 95)) if share.size else None,
        max_relative=float(share.max()) if share.size else None,
    )


# --- Lilliefors' test: whether residuals come from a normal distribution of any mean and deviation ----------

MIN_RESIDUALS = 5  #: Fewest residuals for the test.
NULL_SAMPLES, NULL_SEED = 2000, 1967
"""Normal samples that are simulated, so that p has a standard error of 0.5 points at 5 %, and their seed."""
MAX_SIMULATED_SIZE = 100
"""Largest simulated sample: `sample_size_factor` makes larger ones equal to it."""


def lilliefors(residuals: Array) -> float:
    """Compute the p value of Lilliefors' test, D = max |F_n(x) - Phi((x - mean) / deviation)|.

    Source: H. W. Lilliefors, *On the Kolmogorov-Smirnov test for normality with mean and variance unknown*,
    JASA 62 (1967); factor of the size: M. A. Stephens, JASA 69 (1974).

    Args:
        residuals: The sample, (n,), in any unit.

    Returns:
        Share of normal samples whose D is at least as large [1]: below 0.05 normality is rejected at 5 %.

    Raises:
        BenchError: When the sample is too small, or all of it is one number.
    """
    x = check_array(residuals, (None,), "residuals")
    if len(x) < MIN_RESIDUALS or np.ptp(x) == 0:
        raise BenchError(f"residuals: expected at least {MIN_RESIDUALS} that differ, got {len(x)}")
    n = min(len(x), MAX_SIMULATED_SIZE)
    null, statistic = (
        sample_size_factor(n) * _null_distances(n),
        sample_size_factor(len(x)) * _distance(x[None]),
    )
    # the sample itself counts as one of the simulated ones, so that p is never zero
    return float((1 + (null >= statistic).sum()) / (1 + NULL_SAMPLES))


def sample_size_factor(n: int) -> float:
    """Return the factor that makes D of n residuals comparable to that of other sizes [1]."""
    return float(np.sqrt(n) - 0.01 + 0.85 / np.sqrt(n))


@lru_cache(maxsize=4)
def _null_distances(n: int) -> Array:
    """Simulate D of normal samples of a size, (NULL_SAMPLES,)."""
    return _distance(np.random.default_rng(NULL_SEED).standard_normal((NULL_SAMPLES, n)))


def _distance(samples: Array) -> Array:
    """Compute D of every sample, (k, n) -> (k,)."""
    from scipy.special import ndtr  # here: it takes long to import, and who uses a model tests no residuals

    centred = samples - samples.mean(axis=1, keepdims=True)
    normal = ndtr(np.sort(centred, axis=1) / samples.std(axis=1, ddof=1, keepdims=True))
    n = samples.shape[1]
    above, below = np.arange(1, n + 1) / n - normal, normal - np.arange(n) / n
    return np.asarray(np.maximum(above, below).max(axis=1))
