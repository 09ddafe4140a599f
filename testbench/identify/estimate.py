"""An identified model, and what can be said of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from testbench.arm.stiffness import SYMMETRY_TOLERANCE, eigenvalue_scale
from testbench.data.dataset import Dataset
from testbench.display import Displayed
from testbench.errors import Array, check_array
from testbench.identify.metric import Belief
from testbench.identify.regression import Regression, f_m, regression_of
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

Constraint = Literal["none", "psd", "free", "ridge", "clipped", "own"]
"""What a method asks of every block: nothing; to be positive semi-definite; the same, but only as far as free
directions allow, the fit being that of least squares; to be small; the same as "psd", but afterwards."""

CONSERVATIVE_TOLERANCE = 1e-10
"""An eigenvalue above minus this share of the block's largest counts as zero: rounding of V^T V."""


PAPERS = "GCO (paper)"  #: Method of GCO without a trace weight.
TOOL = "orientation"  #: Stands in for the marker where the tool's orientation was read.


@dataclass(frozen=True)
class Dual:
    """Vectors y_k of length one at most, one for every term of F_M."""

    y: Array  #: Against the rows of the term's R, (terms, n).
    y_rest: Array  #: Against what no parameter explains, (terms,).


@dataclass(frozen=True)
class Penalty:
    """The trace term of GCO beside F_M: the least w <W, C'> of all C' >= 0 that make up C.

    A joint that a structure counts in the link before it is an unknown of its own in C': the link's block is
    C = C' + t a a^T, about the joint's axis a. Where there is none, C' is C.
    """

    weight: float  #: w [N m/rad].
    metric: Array  #: W, diagonal of (n_theta, n_theta), (n_theta,) [rad^2/m^2, 1].
    structure: Structure  #: The unknowns of C', k of them.
    lift: Array  #: Parameters by those of C', (n, k) [1].

    @property
    def price(self) -> Array:
        """Gradient with respect to the parameters of C', (k,)."""
        s = self.structure
        return np.where(s.a == s.b, self.weight * self.metric[s.a], 0.0)

    def lifted(self, regression: Regression) -> Regression:
        """The same readings by the parameters of C'."""
        terms = (replace(term, R=term.R @ self.lift) for term in regression.terms)
        return regression_of(self.structure, tuple(terms))


@dataclass(frozen=True)
class Certificate:
    """How far an estimate can be from the best conservative one, of traces within `trace_bounds`."""

    #: Upper bound of F_M + w <W, C> above its least value [1]: how well the program of GCO is solved.
    duality_gap: float
    #: Upper bound of F_M above its least value [1]: of a solved program, what its trace term costs.
    f_m_excess_bound: float
    trace_bounds: Array  #: Bound t_i of the trace of each block in scaled units, (blocks,) [rad/(N m)].
    dual: Dual  #: The proof; the best one known may certify any other estimate of the same regression.


@dataclass(frozen=True)
class Rejected:
    """A reading that the estimate does without."""

    run: int  #: Identifier of its run.
    marker: str  #: Name of its marker, or `TOOL`.
    #: Distance of the reading from the estimate's prediction [m, or rad for an orientation]; the estimate is
    #: not the model that rejected it, so a few are below the limit.
    residual: float
    sigmas: float  #: The same in standard deviations of a deflection, sqrt(2) sigma [1].


@dataclass(frozen=True)
class Average:
    """What an estimate is the mean of: links and joints, joints alone, and links and joints with laws."""

    weight: float  #: Of joints alone, over both that are linear: their probability given the readings [1].
    whole: "Estimate"  #: Of links and joints.
    rigid: float = 0.0  #: Probability of joints alone, as widths count it [1].
    alone: "Estimate | None" = None  #: Joints alone; None where they count nothing.
    laws: float = 0.0  #: Weight of the model with laws [1].
    likely: float = 0.0  #: Its probability, as widths count it [1].
    lawful: "Estimate | None" = None  #: That model; None where nobody asked for it.
    ties: float = 0.0  #: Probability and weight of the model whose joints are coupled [1].
    tied: "Estimate | None" = None  #: That model, without laws; None where it counts nothing.
    #: All of it by one prior and by another, each with its probability as widths count it; empty of one.
    parts: "tuple[tuple[float, Estimate], ...]" = ()


@dataclass(frozen=True, repr=False)
class Estimate(Displayed):
    """A stiffness model identified from a dataset."""

    method: str  #: How it was found.
    regression: Regression  #: What it was found from: structure and reduced dataset.
    pi: Array  #: Parameters, (n,) [m/N, rad/(N m), rad/N].
    C_theta: Array  #: Aggregated joint compliance, (n_theta, n_theta).
    f_m: float  #: Cost, Eq. (19) [1].
    status: str = "not certified"  #: "solved", or what went wrong, or "not certified" where nobody knows.
    #: Distance from the optimum; None where none was computed (least squares).
    certificate: Certificate | None = None
    solver_seconds: float = 0.0  #: Time inside the numerical solver, as it reports it; 0 where it does not.
    advice: tuple[str, ...] = ()  #: Sentences for a person, of an estimator of your own.
    constraint: Constraint = "own"  #: What the method asked of the blocks; "own" where nobody says it.
    penalty: Penalty | None = None  #: Trace term of GCO without a prior; None for none.
    split: Array | None = None  #: Parameters of its C', (k,).
    #: Whether only the tie-break of the paper's GCO holds unseen compliance, which fits better as it grows.
    held_by_trace_weight: bool = False
    belief: Belief | None = None  #: The prior that counted as data; None for none.
    #: Readings that the estimate does without, in the order of the dataset.
    rejected: tuple[Rejected, ...] = ()
    lost: tuple[int, ...] = ()  #: Identifiers of runs of which no reading is left.
    average: Average | None = None  #: What it is the mean of; None where it is one model.

    def about(self) -> dict[str, object]:
        """Method, structure, what the data see of it, fit and status."""
        return {
            "method": self.method,
            "structure": self.structure.name,
            "unknowns": self.structure.n,
            "conservative": self.conservative,
            "f_m": f"{self.f_m:.3f}",
            "f_m_floor": f"{self.f_m_floor:.3f}",
            "status": self.status,
        }

    @property
    def structure(self) -> Structure:
        """The structure that was identified."""
        return self.regression.structure

    @property
    def f_m_floor(self) -> float:
        """Cost to expect of noise alone [1]."""
        return self.regression.f_m_floor

    @property
    def of_compliances(self) -> Regression:
        """What compliances alone were found from: the regression, without laws of joints."""
        if self.average is None or (self.average.lawful is None and self.average.tied is None):
            return self.regression
        return self.average.whole.regression

    @cached_property
    def conservative(self) -> bool:
        """Whether every block is symmetric and positive semi-definite up to rounding: looked at."""
        return is_conservative(self.structure, self.C_theta)

    @cached_property
    def eigenvalues(self) -> tuple[Array, ...]:
        """Of every block (of its symmetric part), ascending, in its own (mixed) SI units, one a block."""
        C = (self.C_theta + self.C_theta.T) / 2
        return tuple(np.asarray(np.linalg.eigvalsh(C[np.ix_(i, i)])) for i in self.structure.blocks)

    @property
    def min_eigenvalue(self) -> float:
        """Smallest eigenvalue of any block, in its own (mixed) SI units, as the paper prints it."""
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
    """Judge a parameter vector: the last line of every estimator; what else is known, `replace` adds.

    Args:
        regression: The reduced dataset.
        pi: Parameters, (n,).
        method: Name of the method, for reports.
        constraint: What the method asked of the blocks; "own" of an estimator of your own.
        advice: Sentences for a person.

    Returns:
        The estimate: costs, eigenvalues of every block, whether it is conservative.

    Raises:
        BenchError: When pi has another shape or is not finite.
    """
    pi = check_array(pi, (regression.structure.n,), "pi [m/N, rad/(N m), rad/N]")
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
    """Whether every block of C_theta is symmetric and positive semi-definite up to rounding (Section 2.2).

    Judged on the matrix of unit diagonal, so that metres and radians do not mix.
    """
    scale = eigenvalue_scale(C)
    unitless = C / np.outer(scale, scale)
    if np.abs(unitless - unitless.T).max() > SYMMETRY_TOLERANCE:
        return False
    values = [np.linalg.eigvalsh(unitless[group.index]) for group in structure.groups]
    return all((v[:, 0] >= -CONSERVATIVE_TOLERANCE * np.maximum(v[:, -1], 0)).all() for v in values)
