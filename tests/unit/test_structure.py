"""Model structures: how many parameters, which entries, and the algebra between parameters and C_theta."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from loads import rotation_observation

from testbench.arm.folder import Arm, load_arm
from testbench.campaign.campaign import Cell
from testbench.campaign.pose_campaign import FullPose, simulate
from testbench.errors import BenchError
from testbench.identify import reduce
from testbench.identify.conic import optimum
from testbench.model.structure import (
    FREE,
    FULL,
    TEMPLATE,
    Structure,
    all153,
    free36,
    mgco47,
    mgco68,
    mgco69,
    mgco147,
    template56,
)
from testbench.model.vjm import chain, observation
from testbench.studies.estimators.factorised import factorise

MODELS = Path(__file__).parents[2] / "models"
MAKERS = [mgco147, all153, mgco69, mgco68, mgco47, template56]


@pytest.fixture(params=["kr500_l480", "arm_6r"])
def arm(request: pytest.FixtureRequest) -> Arm:
    return load_arm(MODELS / request.param)


@pytest.mark.parametrize(
    ("make", "name", "n"),
    [
        (mgco147, "MGCO147", 147),
        (all153, "ALL153", 153),
        (mgco69, "MGCO69", 69),
        (mgco68, "MGCO68", 68),
        (mgco47, "MGCO47", 47),
        (template56, "MGCO56", 56),
    ],
)
def test_structures_of_the_paper_have_as_many_parameters_as_their_names_say(
    arm: Arm, make: Callable[[Arm], Structure], name: str, n: int
) -> None:
    structure = make(arm)
    assert (structure.name, structure.n, structure.n_theta) == (name, n, 48)
    assert template56(arm, name="MLS56").name == "MLS56"
    assert (len(set(FULL)), len(set(TEMPLATE))) == (21, 8)
    assert set(TEMPLATE) < set(FULL)
    assert len({frozenset(pair) for pair in zip(structure.a, structure.b, strict=True)}) == n
    assert len(structure.labels) == 48


def test_blocks_of_full_links_are_six_by_six_and_joints_are_scalars(arm: Arm) -> None:
    blocks = [block.tolist() for block in all153(arm).blocks]
    links = [list(range(6 * i, 6 * i + 6)) for i in range(7)]
    assert sorted(blocks) == sorted(links + [[k] for k in range(42, 48)])


@pytest.mark.parametrize("make", [template56, mgco68, all153])
def test_triangles_run_block_by_block_and_the_groups_by_size_point_into_them(
    arm: Arm, make: Callable[[Arm], Structure]
) -> None:
    s = make(arm)
    row, column = s.triangles
    pairs = [(b[i], b[j]) for b in s.blocks for j in range(len(b)) for i in range(j + 1)]
    assert list(zip(row, column, strict=True)) == pairs
    np.testing.assert_array_equal(np.sort([s.a, s.b], axis=0)[:, s.parameter], [row, column])
    rows = {int(k): own.tolist() for group in s.groups for k, own in zip(group.at, group.rows, strict=True)}
    assert [rows[k] for k in range(len(s.blocks))] == [block.tolist() for block in s.blocks]
    for group in s.groups:
        assert (s.block_of[row[group.entries]] == group.at[:, None]).all()
    entries = np.concatenate([group.entries.ravel() for group in s.groups])
    np.testing.assert_array_equal(np.sort(entries), np.arange(len(row)))


@pytest.mark.parametrize("make", [*MAKERS, free36])
def test_matrix_is_symmetric_and_entries_give_the_parameters_back(
    arm: Arm, make: Callable[[Arm], Structure]
) -> None:
    """Of a structure that leaves the symmetry open it is any matrix of a link."""
    structure = make(arm)
    pi = np.random.default_rng(2).standard_normal(structure.n)
    C = structure.matrix(pi)
    assert np.array_equal(C, C.T) == structure.symmetric
    np.testing.assert_array_equal(structure.entries(C), pi)
    mirrored = (structure.a != structure.b) & structure.symmetric
    assert np.count_nonzero(C) == structure.n + mirrored.sum()


@pytest.mark.parametrize("make", [*MAKERS, free36])
def test_gradient_is_the_adjoint_of_matrix(arm: Arm, make: Callable[[Arm], Structure]) -> None:
    """Without halves where an entry stands at one place."""
    structure, rng = make(arm), np.random.default_rng(3)
    g, pi = rng.standard_normal((2, structure.n))
    S = structure.gradient(g)
    if not structure.symmetric:
        np.testing.assert_array_equal(structure.entries(S), g)
        np.testing.assert_allclose(np.sum(S * structure.matrix(pi)), g @ pi, rtol=0, atol=1e-12)
        return
    np.testing.assert_array_equal(S, S.T)
    # sums of some 100 products of order one: rounding
    np.testing.assert_allclose(np.sum(S * structure.matrix(pi)), g @ pi, rtol=0, atol=1e-12)
    X = rng.standard_normal((48, 48))
    np.testing.assert_allclose(np.sum(S * (X + X.T)), g @ structure.entries(X + X.T), rtol=0, atol=1e-12)


def test_true_compliance_of_tubes_lies_in_the_template_with_joints(arm: Arm) -> None:
    links, joints = [x.name for x in arm.links], [x.name for x in arm.joints]
    structure = Structure.of(arm, links=links, joints=joints, entries=TEMPLATE)
    assert structure.n == 62
    np.testing.assert_array_equal(structure.matrix(structure.entries(arm.C_theta)), arm.C_theta)


def test_keep_leaves_these_parameters_and_drops_the_rest(arm: Arm) -> None:
    full = template56(arm)
    kept = full.keep(np.array([0, 7, 55]), "OWN3")
    assert (kept.name, kept.n, kept.n_theta, kept.labels) == ("OWN3", 3, 48, full.labels)
    pi = np.arange(1.0, 57.0)
    np.testing.assert_array_equal(kept.entries(full.matrix(pi)), [1, 8, 56])
    assert np.count_nonzero(kept.matrix(np.ones(3))) == 5  # a diagonal entry, c35 of link 0, c35 of link 6


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ({"links": ["link_9"]}, r"no link 'link_9' in \w+; links are link_0, link_1, .*, link_6$"),
        ({"joints": ["a1"]}, r"no joint 'a1' in \w+; joints are joint_1, joint_2, .*, joint_6$"),
        ({"joints": ["joint_1"] * 2}, r"joints: expected different names, got"),
        ({"links": ["link_1"], "entries": ()}, "expected at least one elastic link or joint"),
        (
            {"links": ["link_1"], "entries": ((0, 6),)},
            "entries: expected different pairs a <= b out of 0 to 5",
        ),
        ({"links": ["link_1"], "entries": ((1, 0),)}, "entries: expected different pairs"),
        ({"links": ["link_1"], "entries": ((0, 0), (0, 0))}, "entries: expected different pairs"),
    ],
)
def test_unknown_name_or_entry_lists_what_exists(arm: Arm, wanted: dict, expected: str) -> None:
    with pytest.raises(BenchError, match=expected) as info:
        Structure.of(arm, **wanted)
    assert "\n" not in str(info.value)


@pytest.mark.parametrize(("make", "links"), [(mgco69, 4), (mgco68, 4), (mgco47, 4)])
def test_structure_of_a_longer_arm_says_how_many_links_it_needs(
    make: Callable[[Arm], Structure], links: int
) -> None:
    with pytest.raises(BenchError, match=f"expected an arm of at least {links} links, single_link has 1"):
        make(load_arm(MODELS / "single_link"))


def test_free36_leaves_the_symmetry_open() -> None:
    arm = load_arm(MODELS / "single_link")
    structure = free36(arm)
    assert (structure.name, structure.n, structure.symmetric) == ("MLS36", 36, False)
    assert not structure.mirrored.any()
    assert [block.tolist() for block in structure.blocks] == [list(range(6))]
    assert set(zip(structure.a.tolist(), structure.b.tolist(), strict=True)) == set(FREE)


def test_unsymmetric_structure_predicts_with_its_unsymmetric_matrix(single_link: Cell) -> None:
    structure, rng = free36(single_link.arm), np.random.default_rng(7)
    C, wrench = rng.standard_normal((6, 6)), rng.standard_normal((4, 6))
    args = (chain(single_link.vjm, np.empty((4, 0))), structure, wrench, np.zeros((4, 3)))
    moved = observation(*args, np.zeros((1, 3)))[:, 0] @ structure.entries(C)
    turned = rotation_observation(*args)[:, 0] @ structure.entries(C)
    # one link without joints: the twist is C w; sums of six products of order one
    np.testing.assert_allclose(np.hstack([moved, turned]), wrench @ C.T, rtol=0, atol=1e-13)


def test_gco_refuses_an_unsymmetric_structure_in_either_form(single_link: Cell) -> None:
    scenario = FullPose(arm="single_link", poses=1, force=10.0, moment=10.0, check_runs=1)
    data = simulate(single_link, scenario, 1).identification
    regression = reduce(single_link.vjm, free36(single_link.arm), data)
    for refuse in (optimum, factorise):
        with pytest.raises(
            BenchError, match="expected a symmetric structure, MLS36 leaves the symmetry open"
        ):
            refuse(regression)


@pytest.mark.parametrize("entries", [((0, 1), (1, 0), (0, 2)), ((0, 1), (1, 0), (1, 0))])
def test_unsymmetric_entries_need_every_mirror_once(arm: Arm, entries: tuple) -> None:
    with pytest.raises(BenchError, match="or every pair with its mirror"):
        Structure.of(arm, links=["link_1"], entries=entries)
