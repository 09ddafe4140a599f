"""The result of identification: an `Estimate` with its compliances, fit, certificate and status.

`deflections` predicts a dataset with an estimate, and `score` compares the prediction with measured or true
deflections. `lilliefors_p_value` tests whether residuals are normally distributed.
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
from testbench.identify.equations import RUNS_PER_BATCH
from testbench.identify.prior import WeightedPrior
from testbench.identify.regression import Regression, f_m, regression_from_terms
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
"""Size of a negative eigenvalue of a block, over its largest, that counts as zero [1]: rounding of V^T V."""

ORIENTATION_READING = "orientation"
"""Name that a reading of the tool's orientation has where other readings have a marker's name."""


@dataclass(frozen=True)
class Dual:
    """Hold dual vectors y_k, |y_k| <= 1, one per term of F_M, Eq. (19); they prove a lower bound of F_M.

    Each term of F_M is a norm |r_k|, and |r_k| >= y_k . r_k. The residuals r_k are R pi - z, with the
    triangular factor R of the equations, and one further number that no parameter changes.
    """

    y: Array  #: Dual variables of the residuals R pi - z, (terms, n) [1].
    y_unexplained: Array  #: Dual variables of the residual that no parameter changes, (terms,) [1].


@dataclass(frozen=True)
class TracePenalty:
    """Hold the trace term w <W, C'> that GCO without a prior adds to F_M; W is diagonal.

    C' are the compliances of links and joints. If the compliance of a joint is part of its link's block C,
    the two are split: C = C' + t a a^T, with the joint's compliance t >= 0 and axis a. The term is the least
    over all such splits, with a small weight on t. Without such joints C' is C.
    """

    weight: float  #: w [N m/rad].
    W_diagonal: Array  #: Diagonal of W, (n_theta,) [rad^2/m^2 for translations, 1 for rotations].
    structure: Structure  #: Structure of the k split parameters: C', and t of every such joint.
    pi_per_split_parameter: Array  #: Parameters pi of the model per split parameter, (n, k) [1].

    @property
    def trace_gradient(self) -> Array:
        """Return the gradient of the trace term with respect to its k parameters, (k,) [N m/rad, N rad/m]."""
        s = self.structure
        return np.where(s.rows == s.columns, self.weight * self.W_diagonal[s.rows], 0.0)

    def in_split_parameters(self, regression: Regression) -> Regression:
        """Rewrite weighted equations so that compliances of joints are separate from those of their links.

        Args:
            regression: Equations in the n parameters pi of the model.

        Returns:
            The same equations in the k split parameters.
        """
        terms = (replace(term, R=term.R @ self.pi_per_split_parameter) for term in regression.terms)
        return regression_from_terms(self.structure, tuple(terms))


MIN_SCALING_SENSITIVITY = 1e-3
"""Least sensitivity that `sensitivity_units` uses, over the largest [1]: for axes that no reading loads."""


def sensitivity_units(
    regression: Regression, f_m_unit: float = 1.0, penalty: TracePenalty | None = None
) -> Array:
    """Compute units in which all parameters pi change F_M about equally: C = f_m_unit D X D, D diagonal.

    With d the diagonal of D, 1 / d^2 is the change of F_M and of the trace term with each diagonal entry of
    C. X is positive semi-definite if and only if C is.

    Args:
        regression: The weighted equations.
        f_m_unit: Change of F_M that one unit of a parameter causes [1].
        penalty: The trace term; None for none.

    Returns:
        Unit of every parameter, (n,) [m/N, rad/(N m), rad/N].
    """
    s, weight = regression.structure, regression.diagonal_sensitivity
    trace_cost = 0.0 if penalty is None else penalty.weight * penalty.W_diagonal
    d = 1 / np.sqrt(np.maximum(weight, MIN_SCALING_SENSITIVITY * (weight.max() or 1.0)) + trace_cost)
    return np.asarray(f_m_unit * d[s.rows] * d[s.columns])


@dataclass(frozen=True, repr=False)
class Certificate(Displayed):
    """Hold bounds on how much better than an estimate any conservative model can fit, Eq. (19).

    The bounds apply to all models whose blocks have traces within `trace_bounds`.
    """

    #: Bound on F_M + w <W, C> of the estimate minus its least value [1]; 0 for an exact solution.
    duality_gap: float
    #: Bound on F_M of the estimate minus its least value [1]: what the trace term costs, if it is solved.
    f_m_excess_bound: float
    trace_bounds: Array  #: Bound on the trace of each block in units of `trace_units`, (blocks,) [rad/(N m)].
    dual: Dual  #: Dual vectors that prove the bounds; they may certify any other estimate of the equations.

    def summary(self) -> dict[str, object]:
        """Summarise the certificate: both bounds, and the number of blocks."""
        return {
            "duality_gap": f"{self.duality_gap:.3g}",
            "f_m_excess_bound": f"{self.f_m_excess_bound:.3g}",
            "blocks": len(self.trace_bounds),
        }


@dataclass(frozen=True)
class RejectedReading:
    """Hold one reading that a robust estimate leaves out as an outlier."""

    run: int  #: Identifier of its run.
    marker: str  #: Name of its marker, or `ORIENTATION_READING`.
    #: Distance between the reading and the final estimate's prediction [m, or rad for an orientation]. The
    #: limit was applied to an earlier fit, so that a few distances are below it.
    residual: float
    #: The residual over the standard deviation of a deflection, sqrt(2) sigma [1].
    residual_over_sigma: float


@dataclass(frozen=True)
class ModelAverage:
    """Hold the models that an estimate averages, with their weights.

    They are: links and joints; elastic joints with rigid links; joints with non-linear laws; coupled joints.
    A weight is a share in the averaged parameters; a probability is a share in their intervals.
    """

    links_and_joints: "Estimate"  #: The model with elastic links and joints.
    #: Probability [1] of every model in intervals, and its estimate; the first has the most unknowns.
    interval_models: "tuple[tuple[float, Estimate], ...]"
    #: Weight of rigid links against elastic links [1]: its probability given the readings, or 1 where elastic
    #: links do not predict held-out poses better.
    joints_only_weight: float = 0.0
    joint_laws_weight: float = 0.0  #: Weight of the model with joint laws [1].
    with_joint_laws: "Estimate | None" = None  #: The model with joint laws; None where it was not fitted.
    joint_couplings_weight: float = 0.0  #: Weight of the model with coupled joints [1].
    #: The model with coupled joints, without joint laws; None where its weight is zero.
    with_joint_couplings: "Estimate | None" = None


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Displayed):
    """Hold a stiffness model identified from a dataset: compliances, fit, certificate, status.

    A poor fit is a result, not an error: `status`, `advice`, and `f_m` compared with `f_m_floor` describe it.
    """

    method: str  #: Name of the method.
    regression: Regression  #: The weighted equations (13) that were solved.
    pi: Array  #: Parameters: the unknown entries of C_theta, (n,) [m/N, rad/(N m), rad/N].
    #: Aggregated compliance of the virtual joints, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
    C_theta: Array
    f_m: float  #: Cost F_M, Eq. (19) [1]; compare it with `f_m_floor`.
    #: "solved" if it is proven optimal, else the failure; "not certified" where no proof was requested.
    status: str = "not certified"
    #: Bounds on the distance from the optimum; None where none were computed, as for least squares.
    certificate: Certificate | None = None
    #: Time inside the numerical solver, as it reports it [s]; 0 where it does not.
    solver_seconds: float = 0.0
    advice: tuple[str, ...] = ()  #: Sentences for the user, from an estimator of your own.
    #: Constraint of the method on the blocks of C_theta; "own" where it is unknown.
    constraint: Constraint = "own"
    penalty: TracePenalty | None = None  #: Trace term of GCO without a prior; None for none.
    #: Parameters with joints split from links, as the trace term needs them, (k,); None without a penalty.
    split_parameters: Array | None = None
    #: Whether a compliance is unobservable and only the least trace of `paper_gco` keeps it finite.
    bounded_by_tie_break: bool = False
    weighted_prior: WeightedPrior | None = None  #: The prior that was used as data; None without one.
    #: Readings that a robust fit left out, in the order of the dataset.
    rejected_readings: tuple[RejectedReading, ...] = ()
    rejected_runs: tuple[int, ...] = ()  #: Identifiers of runs all of whose readings were left out.
    #: The models that the estimate averages; None for a single model.
    averaged_models: ModelAverage | None = None

    def summary(self) -> dict[str, object]:
        """Summarise the estimate: method, structure, number of unknowns, fit and status."""
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
        """Return the structure of the unknowns: which entries of C_theta were identified."""
        return self.regression.structure

    @property
    def f_m_floor(self) -> float:
        """Return the F_M that noise alone causes, sqrt(3 (1 - rank / equations)) per term of Eq. (19) [1]."""
        return self.regression.f_m_floor

    @property
    def compliance_regression(self) -> Regression:
        """Return the weighted equations whose unknowns are links and joints, no joint laws or couplings."""
        if self.averaged_models is None or (
            self.averaged_models.with_joint_laws is None and self.averaged_models.with_joint_couplings is None
        ):
            return self.regression
        return self.averaged_models.links_and_joints.regression

    @cached_property
    def conservative(self) -> bool:
        """Tell whether every block of C_theta is symmetric positive semi-definite up to rounding."""
        return is_conservative(self.structure, self.C_theta)

    @cached_property
    def eigenvalues(self) -> tuple[Array, ...]:
        """Return the eigenvalues of the symmetric part of every block of C_theta, ascending [SI, mixed]."""
        C = (self.C_theta + self.C_theta.T) / 2
        return tuple(np.asarray(np.linalg.eigvalsh(C[np.ix_(i, i)])) for i in self.structure.blocks)

    @property
    def min_eigenvalue(self) -> float:
        """Return the smallest eigenvalue of any block of C_theta [SI, mixed], as the paper prints it."""
        return float(min(e[0] for e in self.eigenvalues))


Estimator = Callable[[Vjm, Structure, Dataset], Estimate]
"""Signature of every identification method: estimator(vjm, structure, data) -> Estimate."""


def make_estimate(
    regression: Regression,
    pi: Array,
    *,
    method: str,
    constraint: Constraint = "own",
    advice: tuple[str, ...] = (),
) -> Estimate:
    """Make an estimate from its parameters, with C_theta and F_M; every estimator ends with this call.

    Args:
        regression: The weighted equations, such as `reduce` returns.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].
        method: Name of the method, for reports.
        constraint: Constraint of the method on the blocks of C_theta; "own" for an estimator of your own.
        advice: Sentences for the user.

    Returns:
        The estimate; `dataclasses.replace` sets further fields.

    Raises:
        BenchError: When the regression has another type, the constraint is unknown, or pi has another shape
            or is not finite.
    """
    check_type(regression, Regression, "regression")
    if constraint not in get_args(Constraint):
        known = ", ".join(get_args(Constraint))
        raise BenchError(f"constraint: expected one of {known}, got {constraint!r}")
    pi = check_array(pi, (regression.structure.n_parameters,), "pi [m/N, rad/(N m), rad/N]")
    C, cost = regression.structure.C_theta_of(pi), f_m(regression, pi)
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

    Blocks are scaled to unit diagonal first, because metres and radians differ in size.

    Mathematics: `loaded-7`.

    Args:
        structure: Structure of the unknowns, which defines the blocks.
        C: Aggregated compliance C_theta, (n_theta, n_theta) [m/N, rad/(N m), rad/N].

    Returns:
        True if C is conservative, that is, the compliance of an elastic body.
    """
    scale = unit_diagonal_scale(C)
    unitless = C / np.outer(scale, scale)
    if np.abs(unitless - unitless.T).max() > SYMMETRY_TOLERANCE:
        return False
    values = [np.linalg.eigvalsh(unitless[group.index_arrays]) for group in structure.block_groups]
    return all((v[:, 0] >= -CONSERVATIVE_TOLERANCE * np.maximum(v[:, -1], 0)).all() for v in values)


@dataclass(frozen=True, repr=False)
class DeflectionErrors(Displayed):
    """Hold the errors of predicted deflections: distances from the reference over all markers and runs."""

    rms: float  #: Root mean square of the distance error [m].
    p95: float  #: 95th percentile of the distance error [m].
    max: float  #: Largest distance error [m].
    #: 95th percentile of the error over the reference deflection of its marker [1]; None where none moved.
    p95_relative: float | None
    #: Largest error over the reference deflection of its marker [1]; None where none moved.
    max_relative: float | None

    def summary(self) -> dict[str, object]:
        """Summarise the errors: root mean square, 95th percentile and largest, in mm and per cent."""
        lengths = {"rms_mm": self.rms, "p95_mm": self.p95, "max_mm": self.max}
        shares = {"p95_percent": self.p95_relative, "max_percent": self.max_relative}
        return {name: f"{1e3 * value:.4g}" for name, value in lengths.items()} | {
            name: None if value is None else f"{100 * value:.3g}" for name, value in shares.items()
        }


def deflections(vjm: Vjm, estimate: Estimate, data: Dataset) -> Array:
    """Predict the deflections of a dataset's markers by the linear model, dp = J_p C_theta J_F^T w, Eq. (11).

    Args:
        vjm: The arm's virtual joint model.
        estimate: The identified compliances.
        data: Poses, loads and markers; its readings are not used.

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
    """Predict the deflections of a dataset's markers by several estimates, J_p C_theta J_F^T w, Eq. (11).

    Args:
        vjm: The arm's virtual joint model.
        estimates: The identified compliances of every model.
        data: Poses, loads and markers; its readings are not used.

    Returns:
        Deflection of every marker in every run in base axes, (models, runs, m, 3) [m].
    """
    points, blocks = marker_positions(vjm, data.markers), []
    vjm = vjm_for_structure(vjm, max((estimate.structure for estimate in estimates), key=lambda s: s.n_theta))
    for first in range(0, data.n_runs, RUNS_PER_BATCH):  # so that memory does not grow with the runs
        runs = slice(first, first + RUNS_PER_BATCH)
        where = evaluate_chain(set_load_history(vjm, data.unloaded_after_load, runs), data.q[runs])
        load = generalised_load(where, data.wrench[runs], data.point[runs])
        rows = translational_jacobian(where, points)
        turns = [estimate.C_theta @ load[: len(estimate.C_theta)] for estimate in estimates]
        moved = [np.einsum("ptr,tr->rp", rows[:, : len(turn)], turn) for turn in turns]
        blocks.append(np.array(moved).reshape(len(moved), -1, len(points), 3))
    return np.concatenate(blocks, axis=1)


def score(predicted: Array, reference: Array) -> DeflectionErrors:
    """Compute the errors of predicted deflections against measured or true ones.

    Args:
        predicted: Predicted deflections, (..., 3) [m], such as `deflections` returns.
        reference: Measured or true deflections, (..., 3) [m], such as `Dataset.deflection`. Where targets
            were lost, index both arrays with `Dataset.is_measured`.

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

MIN_RESIDUALS = 5  #: Least number of residuals for the test.
N_SIMULATED_SAMPLES, SIMULATION_SEED = 2000, 1967
"""Number of normal samples that are simulated, and their seed. The standard error of a p value of 5 % is then
0.5 percentage points."""
MAX_SIMULATED_SAMPLE_SIZE = 100
"""Largest size of a simulated sample; `sample_size_factor` converts D of larger samples."""


def lilliefors_p_value(residuals: Array) -> float:
    """Compute the p value of Lilliefors' test for normality of residuals.

    The statistic is D = max |F_n(x) - Phi((x - mean) / deviation)|: the largest distance between the
    distribution of the residuals and the normal one with their mean and deviation. Its distribution for
    normal samples has no closed form; it is simulated with fixed random numbers, so that one sample has one p
    value.

    Source: H. W. Lilliefors, *On the Kolmogorov-Smirnov test for normality with mean and variance unknown*,
    JASA 62 (1967); factor of the size: M. A. Stephens, JASA 69 (1974).

    Args:
        residuals: The sample, (n,), in any unit.

    Returns:
        Share of normal samples whose D is at least as large [1]; below 0.05 normality is rejected at 5 %.

    Raises:
        BenchError: When the sample is too small, or all of it is one number.
    """
    x = check_array(residuals, (None,), "residuals")
    if len(x) < MIN_RESIDUALS or np.ptp(x) == 0:
        raise BenchError(f"residuals: expected at least {MIN_RESIDUALS} that differ, got {len(x)}")
    n = min(len(x), MAX_SIMULATED_SAMPLE_SIZE)
    null, statistic = (
        sample_size_factor(n) * _null_distances(n),
        sample_size_factor(len(x)) * _distance(x[None]),
    )
    # the sample itself counts as one of the simulated ones, so that p is never zero
    return float((1 + (null >= statistic).sum()) / (1 + N_SIMULATED_SAMPLES))


def sample_size_factor(n: int) -> float:
    """Return the factor that makes Lilliefors' statistic D of n residuals comparable to other sizes [1].

    Source: M. A. Stephens, JASA 69 (1974).
    """
    return float(np.sqrt(n) - 0.01 + 0.85 / np.sqrt(n))


@lru_cache(maxsize=4)
def _null_distances(n: int) -> Array:
    """Simulate D of normal samples of a size, (N_SIMULATED_SAMPLES,)."""
    return _distance(np.random.default_rng(SIMULATION_SEED).standard_normal((N_SIMULATED_SAMPLES, n)))


def _distance(samples: Array) -> Array:
    """Compute D of every sample, (k, n) -> (k,)."""
    from scipy.special import ndtr  # here: it takes long to import, and who uses a model tests no residuals

    centred = samples - samples.mean(axis=1, keepdims=True)
    normal = ndtr(np.sort(centred, axis=1) / samples.std(axis=1, ddof=1, keepdims=True))
    n = samples.shape[1]
    above, below = np.arange(1, n + 1) / n - normal, normal - np.arange(n) / n
    return np.asarray(np.maximum(above, below).max(axis=1))
