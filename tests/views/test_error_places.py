"""Errors place by place: their order, the worst of each model, and the figure that shows them."""

import numpy as np
import pytest

from testbench.workflows.error_places import WorkspacePoses, error_places, rms

COUNT = 30
NAMES = ("MLS56", "MGCO56", "ALL153 + prior")


@pytest.fixture
def errors(rng):
    """The first errs far more than the last, most in the middle of the list."""
    sizes = zip(NAMES, (1.0, 0.3, 0.02), strict=True)
    made = {name: (size * rng.uniform(0.5, 1.5, COUNT)).round(3) for name, size in sizes}
    made["MLS56"][17] = 4.0
    return made | {"Joints": rng.uniform(5, 6, COUNT).round(3)}


@pytest.fixture
def at(rng):
    x, y, z = rng.uniform(-2, 2, (3, COUNT)).round(4).tolist()
    q = rng.uniform(-3, 3, (COUNT, 6))
    joints = tuple(f"[{row[0]:.2f}, ...] deg" for row in q)
    run, sag = tuple(range(101, 101 + COUNT)), tuple(rng.uniform(1, 5, COUNT).tolist())
    return WorkspacePoses(run, tuple(q.ravel().tolist()), joints, tuple(x), tuple(y), tuple(z), sag)


def test_places_are_ordered_by_how_far_the_first_and_the_last_differ_each_with_all_that_is_its_own(
    at, errors
):
    found = error_places(at, errors, NAMES)
    first, last = (found.error_mm[name] for name in (NAMES[0], NAMES[-1]))
    assert (np.diff(np.abs(first - last)) <= 0).all()
    assert (found.run[0], found.worst["MLS56"].place, found.worst["MLS56"].error_mm) == (118, 0, 4.0)
    for place, run in enumerate(found.run):
        k = run - 101
        np.testing.assert_array_equal(found.q[place], at.q[6 * k : 6 * k + 6])
        np.testing.assert_array_equal(found.position_m[place], (at.x_m[k], at.y_m[k], at.z_m[k]))
        assert (found.joints[place], found.deflection_mm[place]) == (at.joints[k], at.deflection_mm[k])
        assert all(found.error_mm[name][place] == errors[name][k] for name in errors)
    for name, worst in found.worst.items():
        assert worst.error_mm == max(errors[name]) == found.error_mm[name][worst.place]
        assert (worst.position_m, worst.joints) == (
            tuple(found.position_m[worst.place]),
            found.joints[worst.place],
        )


def test_of_one_model_its_greatest_error_is_first(at, errors):
    assert error_places(at, errors, ["MGCO56"]).worst["MGCO56"].place == 0
    assert error_places(at, errors).compared == ("MLS56",)


def test_places_without_a_bound_come_first(at, errors):
    unknown = [3, 11]
    bounded = {name: list(mm) for name, mm in errors.items()}
    for k in unknown:
        bounded["MLS56"][k] = None
    found = error_places(at, bounded | {"MGCO56": [None] * COUNT}, NAMES)
    assert sorted(found.run[:2]) == [104, 112]
    assert (found.unbounded("MLS56"), found.unbounded("MGCO56")) == (2, COUNT)
    assert found.worst["MLS56"].error_mm == max(mm for mm in bounded["MLS56"] if mm is not None)
    assert "MGCO56" not in found.worst
    assert np.isnan(found.error_mm["MLS56"]).sum() == 2
    assert found.typical_mm("MLS56") == pytest.approx(
        np.sqrt(np.mean([mm**2 for mm in bounded["MLS56"] if mm is not None]))
    )


def test_rms_is_over_the_markers_of_every_pose():
    """Two markers moved by 3 and by 4 mm: 5 / sqrt(2); the same of flat rows."""
    moved = np.array([[[3e-3, 0, 0], [0, 0, -4e-3]], [[0, 1e-3, 0], [1e-3, 0, 0]]])
    np.testing.assert_allclose(rms(moved), [5e-3 / np.sqrt(2), 1e-3])
    np.testing.assert_array_equal(rms(moved.reshape(2, 6)), rms(moved))
