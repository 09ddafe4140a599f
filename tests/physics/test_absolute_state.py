"""A calibrated arm with true parameters against MuJoCo: weight, load, gears, geometry."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.campaign.campaign import Cell
from testbench.identify.absolute import state as absolute
from testbench.identify.absolute.state import forward, nominal
from testbench.model.joint_errors import JointErrors
from testbench.model.weights import read_weights
from testbench.plant import Disturbances, build_plant


def with_compliance(cell, scale):
    """An arm whose links and joints give way so many times as much, in truth."""
    links = tuple(replace(link, compliance=scale * link.compliance) for link in cell.arm.links)
    joints = tuple(replace(joint, compliance=scale * joint.compliance) for joint in cell.arm.joints)
    return Cell(cell.arm, cell.vjm, build_plant(replace(cell.arm, links=links, joints=joints)))


def off(cell, disturbances, mass):
    """How far a state with the parameters of the true arm is from its exact readings, (rows,) [m]."""
    asked = AbsoluteCampaign(poses=30, masses=(mass,), noise=False, disturbances=disturbances)
    (series,), truth = simulate_series(cell, asked, 3)
    mount, station = truth.mounts[0], truth.stations[0]
    state = replace(
        nominal(cell.vjm, read_weights(cell.arm), np.ones(cell.arm.n_joints)),
        theta_0=truth.theta_0,
        C_theta=truth.C_theta,
    )
    if (gears := truth.gears) is not None:
        orders = tuple(range(1, len(gears.sine) + 1))
        n = np.concatenate([gears.sine, gears.cosine]).T
        state = replace(state, errors=JointErrors(orders=orders), n=n)
    tool = forward(state, series).where
    points = truth.markers @ mount.rotation.T + mount.position
    seen = tool.points(points) @ station.rotation.T + station.position
    return np.linalg.norm(seen - series.position, axis=2)[:, 0]


@pytest.mark.parametrize("name", ["kr500", "slides"])
@pytest.mark.parametrize("steps", [0, 1, 2])
def test_every_load_step_gains_an_order_in_the_compliance(name, steps, request, monkeypatch):
    """Half the compliance leaves a quarter of the error of loads on the straight arm, then 1/8 and 1/16."""
    cell = request.getfixturevalue(name)
    monkeypatch.setattr(absolute, "LOAD_STEPS", steps)
    weight, mass = Disturbances(own_weight=True), cell.arm.payload or 20.0
    whole, half = (off(with_compliance(cell, scale), weight, mass).mean() for scale in (4.0, 2.0))
    assert whole / half == pytest.approx(2 ** (2 + steps), rel=0.01)
    assert half > 1e-10  # more than where MuJoCo's equilibrium ends


@pytest.mark.parametrize("mass", [0.0, 460.3])
def test_true_parameters_leave_less_than_a_micrometre(kr500, mass):
    """What is left of millimetres of sag: the sag turns the errors of geometry, which the model adds."""
    assert off(kr500, REAL_ARM, mass).mean() < 1e-6
