"""Errors place by place: their order, the worst of each model, and the figure that shows them."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.bench.error_places import Places, error_places
from testbench.views.map_figure import error_map
from testbench.views.scene import scale_of

COUNT = 30
NAMES = ("MLS56", "MGCO56", "ALL153 + prior")


@pytest.fixture
def errors(rng):
    """The first errs far more than the last, most in the middle of the list."""
    sizes = zip(NAMES, (1.0, 0.3, 0.02), strict=True)
    made = {name: size * rng.uniform(0.5, 1.5, COUNT) for name, size in sizes}
    made["MLS56"][17] = 4.0
    return made | {"Joints": rng.uniform(5, 6, COUNT)}


@pytest.fixture
def at(rng):
    x, y, z = rng.uniform(-2, 2, (3, COUNT)).round(4).tolist()
    q = rng.uniform(-3, 3, (COUNT, 6))
    joints = tuple(f"[{row[0]:.2f}, ...] deg" for row in q)
    run, sag = tuple(range(101, 101 + COUNT)), tuple(rng.uniform(1, 5, COUNT).tolist())
    return Places(run, tuple(q.ravel().tolist()), joints, tuple(x), tuple(y), tuple(z), sag)


def test_places_are_ordered_by_how_far_the_first_and_the_last_differ_each_with_all_that_is_its_own(
    at, errors
):
    found = error_places(at, errors, NAMES)
    first, last = (np.array(found.error_mm[name]) for name in (NAMES[0], NAMES[-1]))
    assert (np.diff(np.abs(first - last)) <= 0).all()
    assert (found.run[0], found.worst["MLS56"].place, found.worst["MLS56"].error_mm) == (118, 0, 4.0)
    for place, run in enumerate(found.run):
        k = run - 101
        assert found.q[place] == at.q[6 * k : 6 * k + 6]
        assert found.position_m[place] == (at.x_m[k], at.y_m[k], at.z_m[k])
        assert (found.joints[place], found.deflection_mm[place]) == (at.joints[k], at.deflection_mm[k])
        assert all(found.error_mm[name][place] == errors[name][k] for name in errors)
    for name, worst in found.worst.items():
        assert worst.error_mm == max(errors[name]) == found.error_mm[name][worst.place]
        assert (worst.position_m, worst.joints) == (
            found.position_m[worst.place],
            found.joints[worst.place],
        )


def test_of_one_model_its_greatest_error_is_first(at, errors):
    assert error_places(at, errors, ["MGCO56"]).worst["MGCO56"].place == 0
    assert error_places(at, errors).compared == ("MLS56",)


def test_places_without_a_bound_come_first_and_are_drawn_as_rings(at, errors):
    unknown = [3, 11]
    bounded = {name: list(mm) for name, mm in errors.items()}
    for k in unknown:
        bounded["MLS56"][k] = None
    found = error_places(at, bounded | {"MGCO56": [None] * COUNT}, NAMES)
    assert sorted(found.run[:2]) == [104, 112]
    assert (found.unbounded("MLS56"), found.unbounded("MGCO56")) == (2, COUNT)
    assert found.worst["MLS56"].error_mm == max(mm for mm in bounded["MLS56"] if mm is not None)
    assert "MGCO56" not in found.worst
    assert np.isnan(found.errors("MLS56")).sum() == 2
    assert found.typical_mm("MLS56") == pytest.approx(
        np.sqrt(np.mean([mm**2 for mm in bounded["MLS56"] if mm is not None]))
    )
    figure = error_map(found, "arm", 7)
    first, nowhere, _ = figure.axes[:3]
    rings, _ = first.get_lines()
    np.testing.assert_allclose(rings.get_xydata(), np.array(found.position_m)[:2, [0, 2]])
    [dots] = first.collections
    assert len(dots.get_offsets()) == COUNT - 2
    assert nowhere.get_title() == "MGCO56: no bound"
    assert "Grey rings: no bound." in figure.get_supxlabel().replace("\n", " ")


def test_the_figure_has_every_place_from_two_sides_in_one_scale_and_names_the_worst(at, errors):
    found = error_places(at, errors, NAMES)
    figure, scale = error_map(found, "arm under 9 kg", [7, 8]), scale_of(*map(found.errors, NAMES))
    assert scale.logarithmic  # the joints, far beyond, are not compared
    panes = figure.axes[: 2 * len(NAMES)]
    position = np.array(found.position_m)
    for k, axes in enumerate(panes):
        name, shown = NAMES[k % 3], (0, 2) if k < 3 else (0, 1)
        [dots] = axes.collections
        order = np.argsort(scale.shares(np.array(found.error_mm[name])))
        np.testing.assert_allclose(dots.get_offsets(), position[order][:, shown])
        assert (np.diff(dots.get_sizes()) >= 0).all()
        worst = found.worst[name]
        [ring] = axes.get_lines()
        assert np.ravel(ring.get_xydata()).tolist() == [worst.position_m[i] for i in shown]
        assert axes.texts[0].get_text() == f"{worst.error_mm:.3g} mm"
        if k < 3:
            rms = np.sqrt(np.mean(errors[name] ** 2))
            assert axes.get_title() == f"{name}: RMS {rms:.3f} mm"
        else:
            assert axes.get_xlabel() == "x [m]"
        assert axes.get_ylabel() == ("" if k % 3 else f"{'xyz'[shown[1]]} [m]")
    colours = [axes.collections[0].get_facecolors()[-1].tolist() for axes in panes[:3]]
    assert len({tuple(colour) for colour in colours}) == 3  # the greatest of each, on one scale
    title, caption = figure.get_suptitle(), figure.get_supxlabel().replace("\n", " ")
    for name in NAMES:
        worst = found.worst[name]
        where = ", ".join(f"{x:.2f}" for x in worst.position_m)
        assert f"{name} {worst.error_mm:.3g} mm" in title.replace("\n", " ")
        assert f"{name} at {where} m, joints {worst.joints}" in caption
    assert "Error of seed 7: distance to the true deflection" in caption


@pytest.mark.parametrize("still", ["x", "yz", "xyz"])
def test_arms_that_move_in_a_plane_on_a_line_or_not_at_all_have_panes_too(at, errors, still):
    fixed = {f"{axis}_m": (0.3 + 1e-9 * (axis == "x"),) * COUNT for axis in still}
    figure = error_map(error_places(replace(at, **fixed), errors, NAMES), "arm")
    figure.draw_without_rendering()
    assert figure.get_figheight() < 2 * figure.get_figwidth()
    for axes in figure.axes[: 2 * len(NAMES)]:
        assert min(axes.get_position().size) > 0.01


def test_titles_and_the_scale_of_colours_are_of_the_errors_in_millimetres(at, errors):
    """The key ends where the errors of the compared models do."""
    figure = error_map(error_places(at, errors, NAMES), "an arm")
    bar = figure.axes[-1]
    assert bar.get_ylabel().endswith("[mm]") or "[mm," in bar.get_ylabel()
    drawn = np.concatenate([errors[name] for name in NAMES])
    low, high = bar.get_ylim()
    assert low <= drawn.min() * 1.001
    assert drawn.max() * 0.999 <= high < 3 * drawn.max()
