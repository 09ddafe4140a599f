"""The tool at rest: MuJoCo's equilibrium of the same arm, own weight and several loads at once."""

import numpy as np
import pytest

import testbench as tb
from testbench.correct.arm_model import bending
from testbench.correct.rest import rest
from testbench.errors import BenchError, NoEquilibrium
from testbench.model.load import Load
from testbench.model.weights import read_weights
from testbench.plant import settle

POSES = 40


@pytest.fixture(scope="module")
def cell():
    return tb.build_cell("kr500_l480")


@pytest.fixture(scope="module")
def state(cell):
    return bending(cell.vjm, cell.arm.C_theta, read_weights(cell.arm))


def test_the_tool_rests_where_mujoco_has_it(cell, state):
    """Two codes that share nothing; steps end below 1e-11 m, so 1e-9 m leaves two digits to rounding."""
    rng = np.random.default_rng(3)
    q = rng.uniform(*cell.arm.limits, (POSES, 6))
    wrench = rng.normal(size=(POSES, 6)) * [2e3, 2e3, 2e3, 1e2, 1e2, 1e2]
    point = 0.3 * rng.normal(size=(POSES, 3))
    found, true = rest(state, q, [Load(wrench, point)]), settle(cell.plant, q, wrench, point)
    assert np.abs(found.position - true.tool).max() < 1e-9
    assert np.abs(found.rotation - true.rotation).max() < 1e-9
    assert np.abs(found.theta - true.theta).max() < 1e-9


def test_loads_add_up(cell, state):
    q = np.random.default_rng(4).uniform(*cell.arm.limits, (POSES, 6))
    half = Load(np.array([500.0, -200, 800, 5, 6, 7]), cell.vjm.load)
    twice = Load(2 * half.wrench, cell.vjm.load)
    assert np.abs(rest(state, q, [half, half]).position - rest(state, q, [twice]).position).max() < 1e-10


def test_an_arm_that_buckles_is_named(cell, state):
    q = np.array([cell.arm.limits[0] * 0.3])
    with pytest.raises(NoEquilibrium, match="no static equilibrium at q"):
        rest(state, q, [Load(np.array([0, 0, -3e7, 0, 0, 0]), cell.vjm.load)])


def test_a_load_of_another_number_of_poses_is_refused(cell, state):
    with pytest.raises(BenchError, match="one for each of 2 poses"):
        rest(state, np.zeros((2, 6)), [Load(np.zeros((3, 6)), np.zeros(3))])
