"""Model structures: which entries, and the algebra between parameters and C_theta."""

import numpy as np
import pytest

from testbench.arm.folder import Arm
from testbench.errors import BenchError
from testbench.model.structure import (
    Structure,
    all153,
    mgco47,
    mgco68,
    mgco69,
    mgco147,
    mls36,
    template56,
)

MAKERS = [mgco147, all153, mgco69, mgco68, mgco47, template56]


@pytest.fixture(params=["kr500", "arm_6r"])
def arm(request: pytest.FixtureRequest) -> Arm:
    return request.getfixturevalue(request.param).arm


@pytest.mark.parametrize("make", [*MAKERS, mls36])
def test_matrix_is_symmetric_and_entries_give_the_parameters_back(arm, make):
    """Of a structure that leaves the symmetry open it is any matrix of a link."""
    structure = make(arm)
    pi = np.random.default_rng(2).standard_normal(structure.n_parameters)
    C = structure.C_theta_of(pi)
    assert np.array_equal(C, C.T) == structure.symmetric
    np.testing.assert_array_equal(structure.parameters_of(C), pi)
    mirrored = (structure.rows != structure.columns) & structure.symmetric
    assert np.count_nonzero(C) == structure.n_parameters + mirrored.sum()


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ({"links": ["link_9"]}, r"no link 'link_9' in \w+; links are link_0, link_1, .*, link_6$"),
        ({"joints": ["a1"]}, r"no joint 'a1' in \w+; joints are joint_1, joint_2, .*, joint_6$"),
        ({"joints": ["joint_1"] * 2}, r"joints: expected different names, got"),
        ({"links": ["link_1"], "entries": ()}, "expected at least one elastic link or joint"),
        ({"links": ["link_1"], "entries": ((0, 6),)}, "expected different pairs a <= b out of 0 to 5"),
        ({"links": ["link_1"], "entries": ((1, 0),)}, "entries: expected different pairs"),
        ({"links": ["link_1"], "entries": ((0, 0), (0, 0))}, "entries: expected different pairs"),
        ({"links": ["link_1"], "entries": ((0, 1), (1, 0), (0, 2))}, "or every pair with its mirror"),
        ({"links": ["link_1"], "entries": ((0, 1), (1, 0), (1, 0))}, "or every pair with its mirror"),
    ],
)
def test_unknown_name_or_entry_lists_what_exists(arm, wanted, expected):
    with pytest.raises(BenchError, match=expected) as info:
        Structure.of(arm, **wanted)
    assert "\n" not in str(info.value)


@pytest.mark.parametrize("make", [mgco69, mgco68, mgco47])
def test_structure_of_a_longer_arm_says_how_many_links_it_needs(single_link, make):
    with pytest.raises(BenchError, match="expected an arm of at least 4 links, single_link has 1"):
        make(single_link.arm)
