"""An arm as it was identified: where its tool is under a load, and how sure that is."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from testbench.arm.folder import Arm
from testbench.errors import Array
from testbench.identify.absolute.posterior import Belief
from testbench.identify.absolute.state import State, nominal
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.estimate import Estimate
from testbench.identify.intervals import Linearised, linearise
from testbench.model.structure import Ids, Structure
from testbench.model.vjm import Vjm
from testbench.model.weights import Weights


@dataclass(frozen=True)
class About:
    """Where a model comes from."""

    method: str  #: How it was found.
    data: tuple[str, ...] = ()  #: Names of the files of readings.
    doubts: tuple[str, ...] = ()  #: What may be wrong, sentences.
    force: float | None = None  #: Largest force it was identified under [N]; None where nobody knows.
    moment: float | None = None  #: Largest moment about the tool's origin [N m]; the same.


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A model of either kind: compliances from deflections, or geometry and all from absolute readings."""

    state: State  #: theta = theta_0 + C_theta u + Phi(q) n, own weight included.
    structure: Structure  #: Of the compliances that are uncertain.
    columns: Ids  #: Which of `unknowns` are uncertain, (c,).
    spread: Linearised  #: Distribution of these.
    absolute: bool  #: Whether geometry and joint errors were identified too.
    scatter: float  #: Of a position about an absolute model, beyond what the columns leave open [m].
    about: About

    @property
    def vjm(self) -> Vjm:
        """Its nominal kinematics."""
        return self.state.vjm

    @property
    def arm(self) -> Arm:
        """Whose it is."""
        return self.vjm.arm

    @property
    def unknowns(self) -> Unknowns:
        """All columns that there might be: geometry, joint errors, compliances."""
        return Unknowns(self.vjm, (), {}, self.state.errors, self.structure)


def of_estimate(vjm: Vjm, estimate: Estimate, weights: Weights, about: About | None = None) -> ArmModel:
    """The model that an estimate of compliances is, of an arm as drawn.

    Args:
        vjm: The arm.
        estimate: From any estimator.
        weights: What its links weigh, such as `read_weights`.
        about: Where it comes from; the method alone if not given.
    """
    state = bending(vjm, estimate.C_theta, weights)
    return of_compliances(state, estimate.structure, linearise(estimate), about or About(estimate.method))


def bending(vjm: Vjm, C_theta: Array, weights: Weights) -> State:
    """An arm as drawn that bends, C_theta (n_theta, n_theta) [m/N, rad/(N m)]."""
    return replace(nominal(vjm, weights, np.zeros(vjm.arm.n_joints)), C_theta=C_theta)


def of_compliances(state: State, structure: Structure, spread: Linearised, about: About) -> ArmModel:
    """A model of compliances alone, and the distribution of the structure's entries."""
    model = ArmModel(
        state=state,
        structure=structure,
        columns=np.zeros(0, dtype=int),
        spread=spread,
        absolute=False,
        scatter=0.0,
        about=about,
    )
    first = model.unknowns.starts["elastic"]
    return replace(model, columns=first + np.arange(structure.n))


def of_calibration(state: State, belief: Belief, about: About) -> ArmModel:
    """The model that a calibration by absolute readings is."""
    own, columns = belief.own, belief.columns
    L = np.zeros((0, 0)) if own.elastic is None else own.elastic.L
    rigid = len(columns) - len(L)
    back = block_diag(np.eye(rigid), L)
    root: Array = solve_triangular(belief.root, back.T, trans="T")
    structure = own.unknowns.structure if own.elastic is None else own.elastic.structure
    model = ArmModel(
        state=state,
        structure=structure,
        columns=columns,
        spread=Linearised(
            pi=np.zeros(len(columns)),
            root=root,
            unseen=np.zeros((0, len(columns))),
            scale=np.ones(len(columns)),
            tail=math.inf,
            pull=0.0,
            on_boundary=False,
        ),
        absolute=True,
        scatter=belief.noise.open_position * float(belief.noise.factor[0]),
        about=about,
    )
    current = model.unknowns.current(state)[columns]
    return replace(model, spread=replace(model.spread, pi=current))
