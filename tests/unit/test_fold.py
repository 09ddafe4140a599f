"""One fold of rows: parts add up, few rows or many, however they came and whichever columns are asked for."""

import numpy as np
import pytest

from testbench.identify import regression
from testbench.identify.regression import TriangularFactors, pose_batches, reduce
from testbench.model.structure import joints_only
from testbench.model.vjm import evaluate_chain, observation_matrix
from testbench.workflows.campaign import Scenario, simulate

COLUMNS = 12
SOME = np.array([1, 4, 5, 7, 11])  #: Five columns, as many as a part has rows.
SIZES = {0: [5], 1: [3, 4], 2: [40, 2], 3: [7, 30], 4: [1]}
"""Rows of every part as they come: fewer than columns, more, few then many."""


@pytest.fixture
def rows(rng):
    return {k: [rng.normal(size=(size, COLUMNS)) for size in sizes] for k, sizes in SIZES.items()}


def folded(rows, parts):
    found = TriangularFactors(COLUMNS)
    for k in parts:
        for one in rows[k]:
            found.add_rows(0, k, one.T.copy())
            found.n_equations[0, k] += len(one)
    return found


@pytest.mark.parametrize("columns", [slice(None), SOME])
@pytest.mark.parametrize("parts", [[0], [2], [0, 4], [0, 1, 4], [1, 2, 4], [2, 3], [0, 1, 2, 3, 4]])
def test_a_factor_of_parts_is_that_of_all_their_rows(rows, parts, columns):
    every = np.vstack([one for k in parts for one in rows[k]])[:, columns]
    found = folded(rows, SIZES)
    assert not found.factor(1, parts).any()  # of a kind without rows
    for _ in range(2):  # asking takes nothing away
        T = found.factor(0, parts, columns)
        assert T.shape == (every.shape[1],) * 2
        np.testing.assert_array_equal(T, np.triu(T))
        np.testing.assert_allclose(T.T @ T, every.T @ every, rtol=0, atol=1e-12 * len(every))


@pytest.mark.parametrize("lost", [0, 5])
def test_readings_go_to_the_rows_of_their_kind_and_part(rng, lost):
    """Two positions and an orientation a run, some readings lost: each kind and part has its own rows."""
    A, runs = rng.normal(size=(3, 3, COLUMNS, 40)), np.arange(40)
    kinds = np.repeat([[0], [0], [1]], 40, axis=1)
    kinds[rng.integers(0, 3, lost), rng.integers(0, 40, lost)] = -1
    found = TriangularFactors(COLUMNS)
    found.add_readings(A, kinds, runs % 2)
    for kind in (0, 1):
        for part in (0, 1):
            of = (kinds == kind) & (runs % 2 == part)
            rows = A.transpose(0, 3, 1, 2)[of].reshape(-1, COLUMNS)
            T = found.factor(kind, [part])
            np.testing.assert_allclose(T.T @ T, rows.T @ rows, rtol=0, atol=1e-11)
            assert found.n_equations[kind, part] == len(rows)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_rows_come_part_by_part_and_those_of_a_pose_together(rng, size):
    """Poses of two parts in any order; a few rows are left out."""
    pose = rng.integers(0, 30, 200)
    part = np.where(pose % 5 == 0, -1, pose % 2)
    found = list(pose_batches(part, pose, size))
    every = np.concatenate(found)
    np.testing.assert_array_equal(np.sort(every), np.flatnonzero(part >= 0))
    assert (np.diff(part[every]) >= 0).all()
    for k in np.unique(pose[every]):
        assert sum(k in pose[some] for some in found) == 1
    assert len(found) <= max(1, len(every) // size + 1)


def test_runs_that_come_in_several_blocks_are_each_counted_once(kr500, monkeypatch):
    """Sums of squares of 20 runs in blocks of 8 are those of all rows at once."""
    asked = Scenario(
        arm="kr500_l480", truth="linear", identification_poses=10, identification_runs=20, workspace_poses=1
    )
    data, structure = simulate(kr500, asked, 3).identification, joints_only(kr500.arm)
    A = observation_matrix(
        evaluate_chain(kr500.vjm, data.q), structure, data.wrench, data.point, kr500.vjm.markers
    )
    rows = np.column_stack([A.reshape(-1, structure.n_parameters), data.deflection.ravel()])
    monkeypatch.setattr(regression, "MAX_SORTED_RUNS", 8)
    found = np.column_stack(reduce(kr500.vjm, structure, data).weighted_equations) * np.sqrt(2) * asked.sigma
    expected = (rows.T @ rows)[:-1]  # but for the readings' own sum, a part of which is no row
    np.testing.assert_allclose((found.T @ found)[:-1], expected, rtol=1e-9, atol=1e-12 * expected.max())
