"""Section 5.1: what six axis loads tell of a link, and what the printed Eq. (22), (23) tell of the paper."""

from dataclasses import replace

import numpy as np
import pytest
from printed_matrices import OWN, least_cost, printed_matrices, readings, tables

from testbench.studies.paper import EQ_22, EQ_23
from testbench.studies.single_link.trial import (
    GCO,
    LEAST_SQUARES,
    Settings,
    measure,
    models,
    noise_scale,
    rank_beyond_noise,
    trials,
)

STUDY = Settings()
LOADS = np.diag([10.0] * 6)


def estimates(cell, data):
    return {m.name: m.estimator(cell.vjm, m.structure, data).C_theta for m in models(cell)}


@pytest.fixture(scope="module")
def printed(single_link):
    return printed_matrices(single_link, STUDY, measure(single_link, STUDY, 1).truth)


def test_the_truth_is_eq_21_and_its_entries_are_the_papers(single_link):
    C = single_link.arm.C_theta
    diagonal = [4.50e-8, 8.01e-5, 3.64e-5, 3.76e-3, 1.09e-3, 2.65e-3]
    np.testing.assert_array_equal(np.diag(C), diagonal)
    assert (C[1, 5], C[2, 4]) == (3.98e-4, -1.71e-4)
    np.testing.assert_array_equal(C, C.T)


def test_noise_free_data_give_eq_21_back(single_link):
    campaign = STUDY.campaign.model_copy(update={"noise": False})
    data = measure(single_link, replace(STUDY, campaign=campaign), 1).identification
    found = estimates(single_link, data)
    C, unit = single_link.arm.C_theta, noise_scale(STUDY.campaign)
    # rounding of marker positions of order one, over 10 N
    np.testing.assert_allclose(found[LEAST_SQUARES], C, rtol=0, atol=1e-15)
    # the interior point stops at 1e-7 of the data; noise would be of order one
    assert np.abs((found[GCO] - C) / unit).max() < 1e-3


def test_least_squares_of_axis_loads_reads_the_columns_directly(single_link):
    data = measure(single_link, STUDY, 3).identification
    columns = np.hstack([data.deflection[:, 0], data.rotation]).T / 10
    C = estimates(single_link, data)[LEAST_SQUARES]
    np.testing.assert_allclose(C, columns, rtol=0, atol=1e-15)
    assert np.abs(columns - columns.T).max() > 1e-6


def test_eq_22_differs_from_the_truth_as_noise_of_a_deflection_under_axis_loads(printed):
    pin = printed.pinning
    assert pin.position_rms_over_sigma == pytest.approx(1.02, abs=0.005)
    assert pin.rotation_rms_over_sigma == pytest.approx(1.21, abs=0.005)
    by_column = [0.80, 1.18, 0.83, 0.56, 0.73, 1.64]
    np.testing.assert_allclose(pin.position_rms_by_column_over_sigma, by_column, rtol=0, atol=0.005)
    assert pin.likelihood_ratio_deflection_to_reading > 2
    assert pin.random_loads_share_as_small < 0.03
    facts = tables(printed)["facts"]
    assert facts.rows[0].value == pin.rms_over_sigma
    assert "RMS that six random loads would give" in [row.what for row in facts.rows]


def test_eq_22_has_a_negative_eigenvalue_and_eq_23_is_of_rank_4_within_its_rounding(printed):
    assert printed.eq_22.eigenvalues_matrix[0] == pytest.approx(-1.14e-6, abs=0.005e-6)
    assert printed.eq_22.eigenvalues_symmetric_part[0] == pytest.approx(-4.07e-6, abs=0.005e-6)
    assert printed.eq_23.eigenvalues_symmetric_part[0] == pytest.approx(-3.9e-9, abs=0.1e-9)
    assert printed.eq_23_from_the_data_of_eq_22.rank_within_rounding == 4
    ours = np.array(EQ_23)
    np.testing.assert_array_equal(ours, ours.T)


def test_eq_22_is_the_papers_dataset_and_eq_23_is_not_its_optimum(single_link, printed):
    data = readings(single_link, STUDY.campaign, LOADS, LOADS @ np.array(EQ_22).T)
    C = estimates(single_link, data)[LEAST_SQUARES]
    np.testing.assert_allclose(C, EQ_22, rtol=0, atol=1e-15)
    own = printed[OWN]
    assert least_cost(printed).verdict == "not confirmed"
    assert own.optimum_f_m + own.optimum_f_m_excess_bound < own.printed_f_m_within_rounding[0]
    distance = [row.rms_to_eq_23_over_sigma for row in own.order]
    assert int(np.argmin(distance)) + 1 == 4  # the order that the paper seems to have used
    assert own.order[-1].f_m == pytest.approx(own.optimum_f_m, rel=1e-6)


def test_rank_counts_what_is_beyond_rounding_in_units_of_the_noise(single_link):
    C = single_link.arm.C_theta
    assert rank_beyond_noise(STUDY.campaign, C) == 6
    values, Q = np.linalg.eigh(C)
    values[:2] = 0, 1e-14
    assert rank_beyond_noise(STUDY.campaign, (Q * values) @ Q.T) == 4


def test_a_draw_is_the_same_alone_and_among_others():
    def without_clock(rows):
        return [replace(row, solve_seconds=0.0) for row in rows]

    [alone] = trials(STUDY, [8])
    assert without_clock(alone) == without_clock(trials(STUDY, [7, 8])[1])
