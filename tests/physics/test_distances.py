"""Calibration by distances to fixed points: rows, recovery of MuJoCo's arm, files, and mistakes."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from testbench.data.dataset import Series, select_rows
from testbench.errors import BenchError
from testbench.files.read_series import read_series
from testbench.files.write import write_series
from testbench.identify.absolute.align import align_all, scatter
from testbench.identify.absolute.evidence import moved_frame, moved_mount
from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.absolute.posterior import model_of
from testbench.identify.absolute.state import Mount, nominal_state, series_equilibrium, unknowns_of
from testbench.identify.metric import cad_prior
from testbench.identify.registration import Frame
from testbench.identify.regression import Linearisation, reduce_series
from testbench.identify.rows import beams, series_rows
from testbench.model.kinematics import JointErrors
from testbench.model.load import read_weights
from testbench.model.structure import joints_only
from testbench.plant.build import build_plant
from testbench.plant.disturbance import Disturbances, GeometryErrors
from testbench.plant.tracker import DistanceMeter
from testbench.workflows.absolute import (
    AbsoluteCampaign,
    position_errors,
    simulate_distances,
    simulate_series,
)
from testbench.workflows.campaign_flags import Mounted
from testbench.workflows.cell import Cell

POINTS = (2.2, 0.0, 0.1), (0.5, 2.0, 0.8)
EXACT = DistanceMeter(sigma=1e-7, fixed_point_sigma=2e-3, travel=10.0)
CAMPAIGN = AbsoluteCampaign(
    poses=40,
    masses=(0.0, 460.0),
    noise=False,
    disturbances=Disturbances(own_weight=True, geometry=GeometryErrors(1e-3, 1e-3)),
)
STIFF = 1e-6  #: Compliance of a true arm whose sag the model has to rounding, over that of the folder [1].


def bars(*points, instrument=EXACT):
    return [Mounted(instrument, "P1", fixed=np.array(point)) for point in points]


@pytest.fixture(scope="module")
def stiff(kr500):
    parts = {
        kind: tuple(replace(own, compliance=STIFF * own.compliance) for own in getattr(kr500.arm, kind))
        for kind in ("links", "joints")
    }
    return Cell(kr500.arm, kr500.vjm, build_plant(replace(kr500.arm, **parts)))


@pytest.fixture(scope="module")
def read(stiff):
    """Distances from two points to one marker, nearly without noise."""
    quiet = replace(EXACT, sigma=1e-12)
    every = simulate_distances(stiff, CAMPAIGN, bars(*POINTS, instrument=quiet), 5)[0]
    return tuple(replace(one, sigma=EXACT.sigma) for one in every)


def test_rows_of_distances_are_finite_differences_and_a_turn_about_the_point_is_left_out(kr500, read):
    one = read[0]
    state = align_all(nominal_state(kr500.vjm, read_weights(kr500.arm), np.ones(6)), (one,))
    unknowns = unknowns_of(kr500.vjm, (one,), JointErrors(), joints_only(kr500.arm))
    rows, (u, _) = series_rows(unknowns, state, one), beams(state, one, series_equilibrium(state, one))
    across = rows - u[:, :, None] * np.einsum("sxr,sxcr->scr", u, rows)[:, None]
    np.testing.assert_allclose(across, 0, atol=1e-9)  # of 1e4, rounding
    step, turns = 1e-5, unknowns.turns_of_points

    def length(x):
        frame = moved_frame(state.frame(one), x[unknowns.columns(f"frame {one.frame}")])
        mount = moved_mount(state.mount(one), x[unknowns.columns(f"mount {one.target}")])
        theta_0 = state.theta_0.copy()
        theta_0[unknowns.geometry_slice] += x[unknowns.columns("geometry")]
        C = unknowns.structure.matrix(x[unknowns.columns("elastic")])
        moved = replace(
            state, theta_0=theta_0, C_theta=C, frames={one.frame: frame}, mounts={one.target: mount}
        )
        return beams(moved, one, series_equilibrium(moved, one))[1]

    for k, size in enumerate(np.where(np.arange(unknowns.size) < unknowns.starts["elastic"], step, 1e-9)):
        way = size * np.eye(unknowns.size)[k]
        slope = (length(way) - length(-way)) / (2 * size)
        along = np.einsum("sxr,sxr->sr", u, rows[:, :, k])
        if k in turns:
            assert not along.any()
        else:
            np.testing.assert_allclose(along, slope, rtol=1e-6, atol=1e-6)


def test_a_distance_is_one_equation_and_scatters_as_one_number(kr500, rng):
    """4,000 distances off by 100 um: their standard deviation is known to 1.1 %."""
    rows, size = 4000, 1e-4
    still = {"wrench": np.zeros((rows, 6)), "point": np.zeros((rows, 3)), "pose": np.arange(rows)}
    one = Series(
        "s",
        ("P1",),
        "f",
        "t",
        np.arange(rows),
        q=kr500.arm.draw_poses(rng, rows),
        position=np.zeros((rows, 1, 3)),
        sigma=1e-6,
        distance=np.ones((rows, 1)),
        fixed=POINTS[0],
        **still,
    )
    weightless = read_weights(kr500.arm)
    state = nominal_state(kr500.vjm, replace(weightless, mass=0 * weightless.mass), np.ones(6))
    frame, mount = Frame(np.eye(3), -np.array(POINTS[0])), Mount(kr500.vjm.markers[:1], np.eye(3), ("P1",))
    state = replace(state, frames={"f": frame}, mounts={"t": mount})
    _, length = beams(state, one, series_equilibrium(state, one))
    one = replace(one, distance=length.T + size * rng.standard_normal((rows, 1)))
    noise = scatter(state, (one,), 1.0)
    assert noise.open_position == pytest.approx(size, rel=0.04)
    unknowns = unknowns_of(kr500.vjm, (one,), JointErrors(), joints_only(kr500.arm))
    few = select_rows(one, np.arange(50))
    assert reduce_series(Linearisation(unknowns, state, noise), (few,)).counts.tolist() == [50]


@pytest.mark.parametrize("what", ["one point", "two points and a tracker"])
def test_a_stiff_arm_is_recovered_from_exact_distances_to_a_micrometre(stiff, read, what):
    """Judged in 30 poses that were never measured; as drawn the arm is off by millimetres."""
    shared = CAMPAIGN.model_copy(update={"share_frame": True, "share_target": True})
    (there, check), _ = simulate_series(stiff, shared.model_copy(update={"series": 2}), 5)
    tracker = (replace(there, sigma=EXACT.sigma),)
    series = read[:1] if what == "one point" else (*read, *tracker)
    options = CalibrationOptions(only=frozenset({"joint springs"}))
    found = calibrate(stiff.vjm, series, cad_prior(stiff.arm), options)
    model, other = model_of(found), replace(check, frame="new", target="new")
    assert position_errors(model, [other], 30).max_mm < 1e-3
    rigid = replace(model, state=nominal_state(stiff.vjm, model.state.weights, np.ones(6)))
    assert position_errors(rigid, [other], 30).rms_mm > 0.5


def test_distances_are_read_back_by_fixed_point_and_lost_ones_are_blank(kr500, tmp_path):
    short = replace(EXACT, travel=0.8)
    asked = [*bars(*POINTS, instrument=short), Mounted(EXACT, "P3", fixed=np.array(POINTS[0]))]
    every, _ = simulate_distances(kr500, CAMPAIGN.model_copy(update={"poses": 8}), asked, 2)
    assert not every[0].seen.all()
    assert every[0].seen.any()
    file = tmp_path / "d.csv"
    write_series(file, kr500.arm, [replace(one, name=f"d {one.name}", target="d") for one in every])
    again = read_series(file, kr500.arm).series
    assert [one.fixed for one in again] == [POINTS[0], POINTS[1], POINTS[0]]
    assert len({one.frame for one in again}) == 3
    assert {one.target for one in again} == {"d"}
    for one, own in zip(again, every, strict=True):
        there = own.seen.any(axis=1)
        np.testing.assert_array_equal(one.seen, own.seen[there])
        np.testing.assert_array_equal(one.distance[one.seen], own.distance[own.seen])
        np.testing.assert_array_equal(one.q, own.q[there])
        assert (one.sigma, one.fixed_sigma) == (own.sigma, own.fixed_sigma)


JOINTS = ",".join(f"joint_{k}_deg" for k in range(1, 7))
TABLE = f"""marker,{JOINTS},distance_mm,fixed_x_mm,fixed_y_mm,fixed_z_mm
P1,10,-60,80,5,30,0,2345.6,2200,0,100
P1,20,-60,80,5,30,0,2245.6,2200,0,100
"""


def test_every_fixed_point_of_a_workshops_table_is_a_series_of_its_own(kr500, tmp_path):
    file = tmp_path / "d.csv"
    file.write_text(TABLE.replace("2245.6,2200", "2245.6,2300"))
    export = read_series(file, kr500.arm)
    assert [one.name for one in export.series] == ["d point 1", "d point 2"]
    assert [one.frame for one in export.series] == ["d point 1", "d point 2"]
    np.testing.assert_allclose(
        [one.fixed for one in export.series], [(2.2, 0, 0.1), (2.3, 0, 0.1)], rtol=1e-12
    )
    assert [one.fixed_sigma for one in export.series] == [0.02, 0.02]
    assert any("20 mm of a fixed point is assumed" in note for note in export.notes)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "fixed_x_mm,fixed_y_mm,fixed_z_mm",
            "a,b,c",
            "missing columns ['fixed_x_m', 'fixed_y_m', 'fixed_z_m']",
        ),
        ("2345.6,2200,0,100", "2345.6,,,", "line 2, column fixed_x_mm: expected the fixed point"),
        ("2345.6", "-2345.6", "line 2, column distance_mm: expected more than 0, got -2.3456 m"),
        ("distance_mm", "distance_before_mm", "missing columns ['distance_m']"),
        ("marker,", "marker,x_mm,y_mm,z_mm,", "expected distances, or positions and orientations, got both"),
    ],
)
def test_a_wrong_table_of_distances_is_refused_in_one_line(kr500, tmp_path, old, new, words):
    file = tmp_path / "d.csv"
    text = TABLE.replace(old, new, 1)
    file.write_text(text.replace("P1,", "P1,1,2,3,") if "x_mm,y_mm,z_mm,j" in new + "j" else text)
    assert words in refused(read_series, file, kr500.arm)


@pytest.mark.parametrize(
    ("spoiled", "words"),
    [
        (lambda one: {"distance": 1e-3 * one.distance}, "0.000999 times as long as expected; another unit"),
        (lambda one: {"fixed": (-2.2, 0.0, 0.1)}, "its fixed point is 4.4 m from where it is stated"),
        (lambda one: {"q": one.q[::-1].copy()}, "do not fit this arm and a fixed point near 2.2, 0, 0.1 m"),
    ],
    ids=["mm for m", "another point", "other poses"],
)
def test_distances_in_another_unit_or_from_another_point_are_refused(kr500, read, spoiled, words):
    one = replace(read[0], **spoiled(read[0]))
    with pytest.raises(BenchError, match=words):
        calibrate(kr500.vjm, [one], cad_prior(kr500.arm))


def test_two_fixed_points_in_one_frame_and_distances_without_one_are_refused(kr500, read):
    both = [replace(one, frame="A") for one in read]
    with pytest.raises(BenchError, match="frame 'A': expected one fixed point, got"):
        calibrate(kr500.vjm, both, cad_prior(kr500.arm))
    with pytest.raises(BenchError, match="expected them and a fixed point together"):
        replace(read[0], fixed=None)
