"""An identified arm: its state, the uncertainty of that, and its origin."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, Ids
from testbench.identify.absolute.align import Noise
from testbench.identify.absolute.state import ArmState, Unknowns, nominal_state
from testbench.identify.estimate import Estimate
from testbench.identify.posterior import Posterior, linearise
from testbench.model.laws import model_for
from testbench.model.load import Weights
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm


@dataclass(frozen=True)
class ModelOrigin:
    """Hold the origin of a model: method, files of readings, warnings and largest load."""

    method: str  #: Method that found it.
    #: SHA-256 of every file of readings, by its name.
    data: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()  #: Warnings about the model, as sentences.
    force: float | None = None  #: Largest force in the data [N]; None if unknown.
    moment: float | None = None  #: Largest moment about the tool's origin in the data [N m]; None if unknown.


@dataclass(frozen=True, eq=False, repr=False)
class ArmModel:
    """Hold an identified arm: from deflections compliances only, from absolute readings geometry too."""

    state: ArmState  #: theta = theta_0 + C_theta u + Phi(q) n, own weight included.
    structure: Structure  #: Structure of the uncertain compliances.
    columns: Ids  #: Columns of `unknowns` that are uncertain, (c,).
    posterior: Posterior  #: Posterior of these unknowns.
    about: ModelOrigin
    #: How absolute readings scatter about it; None where geometry and joint errors were not identified.
    noise: Noise | None = None

    def __repr__(self) -> str:
        return (
            f"ArmModel(arm={self.arm.name}, method={self.about.method}, structure={self.structure.name}, "
            f"unknowns={len(self.columns)}, absolute={self.absolute})"
        )

    @property
    def vjm(self) -> Vjm:
        """Return its nominal virtual joint model."""
        return self.state.vjm

    @property
    def arm(self) -> Arm:
        """Return the arm."""
        return self.vjm.arm

    @property
    def absolute(self) -> bool:
        """Tell whether geometry and joint errors were identified too."""
        return self.noise is not None

    @property
    def scatter(self) -> float:
        """Return the standard deviation of a position about an absolute model beyond its unknowns [m]."""
        return 0.0 if self.noise is None else self.noise.open_position * float(self.noise.factor[0])

    @property
    def unknowns(self) -> Unknowns:
        """Return all unknowns that the model may have, in the order geometry, joint errors, compliances."""
        return Unknowns(self.vjm, (), {}, self.state.errors, self.structure)


def model_of_estimate(vjm: Vjm, estimate: Estimate, weights: Weights) -> ArmModel:
    """Convert an estimate of the compliances of a nominal arm to a model.

    Args:
        vjm: The arm.
        estimate: An estimate, from any estimator.
        weights: Weights of the links, such as `read_weights`.

    Returns:
        The model.
    """
    state = elastic_state(model_for(vjm, estimate.structure), estimate.C_theta, weights)
    return model_of_compliances(state, estimate.structure, linearise(estimate), ModelOrigin(estimate.method))


def elastic_state(vjm: Vjm, C_theta: Array, weights: Weights) -> ArmState:
    """Make the state of a nominal arm with given compliances.

    Args:
        vjm: The arm's virtual joint model.
        C_theta: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].
        weights: Weights of the links.

    Returns:
        The state.
    """
    return replace(nominal_state(vjm, weights, np.zeros(vjm.arm.n_joints)), C_theta=C_theta)


def model_of_compliances(
    state: ArmState, structure: Structure, posterior: Posterior, about: ModelOrigin
) -> ArmModel:
    """Make an arm model whose only uncertain unknowns are compliances.

    Args:
        state: The arm's state.
        structure: The compliances, n of them.
        posterior: Their posterior.
        about: Origin of the model.

    Returns:
        The model.
    """
    first = Unknowns(state.vjm, (), {}, state.errors, structure).starts["elastic"]
    return ArmModel(state, structure, first + np.arange(structure.n), posterior, about)
