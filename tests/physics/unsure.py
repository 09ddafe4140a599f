"""An arm that is known but for so much, from an identification or a calibration, and draws of it."""

from dataclasses import replace

import numpy as np

from testbench import Aim, Load
from testbench.identify.absolute.align import Noise
from testbench.identify.posterior import ModelOrigin, Posterior, elastic_state, model_of_compliances
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import read_body_masses
from testbench.model.structure import all153

TIP = np.array([0.2, 0.0, 0.1])
AIM = Aim(tool_point=tuple(TIP))
FORCE = Load(np.array([900.0, 1500, -700, 0, 0, 0]), TIP)
Q = np.array([0.3, -1.2, 1.6, 0.3, -0.5, 0.1])
RIGID = 30 + 24  #: Numbers of geometry and joint errors, before the compliances.
SCALE = np.array([9e3, 8e3, 3e3, 5e2, 4e2, 2e2])  #: Of the torque of every joint [N m].


def normal(x, root, unseen=None):
    found = Posterior.from_covariance_root(x, root)
    return found if unseen is None else replace(found, unobservable_directions=unseen)


def unsure(cell):
    """Compliances that are unsure by a tenth, no two of one link alike."""
    structure = all153(cell.arm)
    state = elastic_state(cell.vjm, cell.arm.C_theta, read_body_masses(cell.arm))
    pi = structure.parameters_of(state.C_theta)
    d = np.sqrt(np.diag(state.C_theta))
    root = np.diag(0.1 * d[structure.rows] * d[structure.columns])
    root[1:, :-1] += 0.5 * np.diag(np.diag(root)[1:])
    return model_of_compliances(state, structure, normal(pi, root), ModelOrigin("made up"))


def unsure_everywhere(cell):
    """The same that knows geometry and joint errors too, by a tenth of a millimetre and a milliradian."""
    known, errors = unsure(cell), JointErrorTerms(orders=(1,), play=True, stiffening=True)
    state = replace(
        known.state, error_terms=errors, error_coefficients=np.full((6, 4), 1e-4), torque_scale=SCALE
    )
    model = replace(known, state=state, noise=Noise())
    sizes = np.concatenate([np.tile([1e-4] * 6, 5), np.full(24, 5e-5)])
    root = np.zeros((RIGID + 153, RIGID + 153))
    root[:RIGID, :RIGID] = np.diag(sizes)
    root[1:RIGID, : RIGID - 1] += 0.5 * np.diag(sizes[1:])
    root[RIGID:, RIGID:] = known.posterior.covariance_root
    columns = np.arange(RIGID + 153)
    return replace(
        model, uncertain_columns=columns, posterior=normal(model.unknowns.values(state)[columns], root)
    )


def drawn_state(model, rng):
    """The arm that a model may be, as its doubts have it."""
    x = model.unknowns.values(model.state)
    x[model.uncertain_columns] += (
        rng.standard_normal(len(model.posterior.covariance_root)) @ model.posterior.covariance_root
    )
    return state_of(model, x)


def state_of(model, x):
    """The arm with these values of all unknowns."""
    unknowns = model.unknowns
    theta = model.state.theta_0.copy()
    theta[unknowns.geometry_slice] = x[unknowns.columns("geometry")]
    n = x[unknowns.columns("errors")].reshape(model.state.error_coefficients.shape)
    C = model.structure.C_theta_of(x[unknowns.columns("elastic")])
    return replace(model.state, theta_0=theta, C_theta=C, error_coefficients=n)
