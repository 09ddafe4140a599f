"""Calibration by distances to fixed points and planes: rows, recovery of MuJoCo's arm, files, mistakes."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from testbench.data.dataset import Series, select_rows
from testbench.errors import BenchError
from testbench.files.read_series import read_series
from testbench.files.write import write_series
from testbench.identify.absolute.align import align_all, estimate_model_error, residuals, unknowns_of
from testbench.identify.absolute.evidence import moved_mount
from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.absolute.state import Mount, moved_frame, nominal_state, series_equilibrium
from testbench.identify.equations import distance_directions, series_equations
from testbench.identify.prior import cad_prior
from testbench.identify.registration import Frame
from testbench.identify.regression import Linearisation, reduce_series
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import read_body_masses
from testbench.model.structure import joints_only
from testbench.plant.build import build_plant
from testbench.plant.disturbance import Disturbances, GeometryErrors
from testbench.plant.tracker import DistanceMeter, PlaneProbe, place_faces
from testbench.report.readings import draw_calibration
from testbench.workflows.absolute import calibrate_with_masses, position_errors
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_distances, simulate_series
from testbench.workflows.calibration_numbers import remaining_errors
from testbench.workflows.cell import Cell
from testbench.workflows.instruments import AXES, Mounted

POINTS = (2.2, 0.0, 0.1), (0.5, 2.0, 0.8)
PLANES = ("z", (1.9, 0.3, 0.6)), ("-x", (2.3, 0.0, 1.4)), ("-y", (1.5, 1.2, 1.4))
EXACT = DistanceMeter(sigma=1e-7, fixed_point_sigma=2e-3, max_change=10.0)
CAMPAIGN = AbsoluteCampaign(
    poses=40,
    masses=(0.0, 460.0),
    noise=False,
    disturbances=Disturbances(own_weight=True, geometry=GeometryErrors(1e-3, 1e-3)),
)
NOISE = 1e-8
"""Of readings that determine all [m]: residuals of rounding alone would get weights beyond doubles."""
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
    quiet = replace(EXACT, sigma=NOISE)
    every = simulate_distances(stiff, CAMPAIGN, bars(*POINTS, instrument=quiet), 5)[0]
    return stated(every)


@pytest.fixture(scope="module")
def touched(stiff):
    """Heights over three faces, each off its stated normal by half a degree, nearly without noise."""
    return stated(heights(stiff, CAMPAIGN, 5, 1e-12)[0])


def stated(series):
    """Readings that say the noise of EXACT, however small it is."""
    return tuple(replace(one, sigma=EXACT.sigma) for one in series)


def heights(cell, campaign, seed, sigma, planes=PLANES, block=""):
    probe = PlaneProbe(sigma=sigma, flatness_sigma=0.0, max_height=0.05)
    asked = [Mounted(probe, "P1", AXES[axis], fixed=np.array(place), block=block) for axis, place in planes]
    return simulate_distances(cell, campaign, asked, seed)


@pytest.mark.parametrize("kind", ["point", "point and constant", "plane"])
def test_rows_of_distances_are_finite_differences_and_a_turn_about_a_point_is_left_out(
    kr500, read, touched, kind
):
    one = touched[1] if kind == "plane" else read[0]
    if kind == "point and constant":
        one = replace(one, distance_offset_sigma=1.0, distance=one.distance - 0.7)
    state = align_all(nominal_state(kr500.vjm, read_body_masses(kr500.arm), np.ones(6)), (one,))
    unknowns = unknowns_of(kr500.vjm, (one,), JointErrorTerms(), joints_only(kr500.arm))
    rows = series_equations(unknowns, state, one)
    (u, _) = distance_directions(state, one, series_equilibrium(state, one))
    across = rows - u[:, :, None] * np.einsum("sxr,sxcr->scr", u, rows)[:, None]
    np.testing.assert_allclose(across, 0, atol=1e-9)  # of 1e4, rounding
    step, turns = 1e-5, unknowns.unused_rotations

    def length(x):
        frame = moved_frame(state.frame(one), x[unknowns.columns(f"frame {one.frame}")])
        mount = moved_mount(state.mount(one), x[unknowns.columns(f"mount {one.mount}")])
        theta_0 = state.theta_0.copy()
        theta_0[unknowns.geometry_slice] += x[unknowns.columns("geometry")]
        C = unknowns.structure.C_theta_of(x[unknowns.columns("elastic")])
        moved = replace(
            state, theta_0=theta_0, C_theta=C, frames={one.frame: frame}, mounts={one.mount: mount}
        )
        return distance_directions(moved, one, series_equilibrium(moved, one))[1]

    for k, size in enumerate(
        np.where(np.arange(unknowns.size) < unknowns.first_columns["elastic"], step, 1e-9)
    ):
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
    still = {"wrench": np.zeros((rows, 6)), "point": np.zeros((rows, 3)), "pose_id": np.arange(rows)}
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
        fixed_point=POINTS[0],
        **still,
    )
    weightless = read_body_masses(kr500.arm)
    state = nominal_state(kr500.vjm, replace(weightless, mass=0 * weightless.mass), np.ones(6))
    frame, mount = Frame(np.eye(3), -np.array(POINTS[0])), Mount(kr500.vjm.markers[:1], np.eye(3), ("P1",))
    state = replace(state, frames={"f": frame}, mounts={"t": mount})
    _, length = distance_directions(state, one, series_equilibrium(state, one))
    one = replace(one, distance=length.T + size * rng.standard_normal((rows, 1)))
    noise = estimate_model_error(state, (one,), 1.0)
    assert noise.position_model_error == pytest.approx(size, rel=0.04)
    unknowns = unknowns_of(kr500.vjm, (one,), JointErrorTerms(), joints_only(kr500.arm))
    few = select_rows(one, np.arange(50))
    assert reduce_series(Linearisation(unknowns, state, noise), (few,)).n_equations.tolist() == [50]


@pytest.mark.parametrize(("frames", "directions"), [("abc", (29, 30)), ("aaa", (26, 27))])
def test_touches_of_planes_leave_the_scale_of_the_arm_open_and_heights_show_it(
    stiff, touched, rng, frames, directions
):
    """Three planes, and three faces of one block: six unknowns of frame, 21 of arm and target, less one."""
    weightless = read_body_masses(stiff.arm)
    state = nominal_state(stiff.vjm, replace(weightless, mass=0 * weightless.mass), np.ones(6))
    mount = Mount(stiff.vjm.markers[:1], np.eye(3), ("P1",))
    placed = {name: Frame(np.eye(3), np.zeros(3)) for name in frames}
    state = replace(state, frames=placed, mounts={touched[0].mount: mount})
    for spread, expected in zip((0.0, 0.01), directions, strict=True):
        series = [
            replace(one, frame=name, q=one.q + spread * rng.standard_normal(one.q.shape))
            for one, name in zip(touched, frames, strict=True)
        ]
        unknowns = unknowns_of(stiff.vjm, tuple(series), JointErrorTerms(), joints_only(stiff.arm))
        rows = [
            series_equations(unknowns, state, one)[0, :, : unknowns.first_columns["elastic"]]
            for one in series
        ]
        normal = [
            np.einsum("x,xcr->rc", one.plane_normal, own) for one, own in zip(series, rows, strict=True)
        ]
        size = np.linalg.svd(np.concatenate(normal), compute_uv=False)
        assert (size > 1e-6 * size[0]).sum() == expected


@pytest.mark.parametrize(
    "what",
    [
        *("one point", "planes, two points and a tracker"),
        *(
            pytest.param(name, marks=pytest.mark.study)
            for name in ("one point and a constant", "a block with two parallel faces", "planes")
        ),
    ],
)
def test_a_stiff_arm_is_recovered_from_exact_distances_to_a_micrometre(stiff, read, touched, what):
    """Judged in 30 poses that were never measured; as drawn the arm is off by millimetres.

    Planes alone show the arm's scale by heights of millimetres: 0.1 um of these are 10 um in a reach of 2 m.
    Two parallel faces of one block show it as distances do.
    """
    shared = CAMPAIGN.model_copy(update={"share_frame": True, "share_target": True})
    (there, check), _ = simulate_series(stiff, shared.model_copy(update={"series": 2}), 5)
    box = (*PLANES, ("y", (1.5, -1.2, 1.4)))
    block, _ = heights(stiff, CAMPAIGN, 5, NOISE, box, block="block")
    faces, _ = heights(stiff, CAMPAIGN, 5, NOISE)
    with_constant = replace(read[0], distance_offset_sigma=1.0, distance=read[0].distance - 2.5)
    series = {
        "a block with two parallel faces": stated(block),
        "one point": read[:1],
        "one point and a constant": (with_constant,),
        "planes": touched,
        "planes, two points and a tracker": (*stated(faces), *read, *stated([there])),
    }[what]
    options = CalibrationOptions(used_errors=frozenset({"joint springs"}))
    found = calibrate(stiff.vjm, series, cad_prior(stiff.arm), options)
    model, other = found.model(), replace(check, frame="new", mount="new")
    assert position_errors(model, [other], 30).max_mm < (0.02 if what == "planes" else 1e-3)
    rigid = replace(model, state=nominal_state(stiff.vjm, model.state.body_masses, np.ones(6)))
    assert position_errors(rigid, [other], 30).rms_mm > 0.5


def test_a_block_is_placed_as_one_rigid_body_off_its_stated_place(rng):
    stated = [(np.array(place, dtype=float), AXES[axis]) for axis, place in PLANES]
    moved, turned = [], []
    for _ in range(400):
        faces = place_faces(stated, 2e-3, 8.7e-3, rng)
        for pair in ((0, 1), (1, 2)):  # distances and angles stay to rounding
            (p, n), (q, m) = (faces[k] for k in pair)
            (p_0, n_0), (q_0, m_0) = (stated[k] for k in pair)
            assert np.linalg.norm(p - q) == pytest.approx(np.linalg.norm(p_0 - q_0), rel=1e-12)
            np.testing.assert_allclose([n @ m, n @ (q - p)], [n_0 @ m_0, n_0 @ (q_0 - p_0)], atol=1e-12)
        moved.append(np.mean([p for p, _ in faces], axis=0) - np.mean([p for p, _ in stated], axis=0))
        turned.append(faces[0][1][:2])
    # the scatter of 400 triples is known to 2 %, of 400 pairs to 2.5 %
    assert np.std(moved) == pytest.approx(2e-3, rel=0.08)
    assert np.std(turned) == pytest.approx(8.7e-3, rel=0.1)


def test_a_block_is_aligned_by_all_of_its_faces(stiff):
    """By its first face alone the others would be off by its turn about that normal, here 10 mm and more."""
    faces, _ = heights(stiff, CAMPAIGN, 5, 1e-5, (*PLANES, ("y", (1.5, -1.2, 1.4))), block="block")
    state = align_all(nominal_state(stiff.vjm, read_body_masses(stiff.arm), np.ones(6)), faces)
    off = [float(np.sqrt((residuals(state, one) ** 2).sum(axis=1).mean())) for one in faces]
    assert max(off) < 3e-3  # geometry is off by a millimetre
    first = align_all(replace(state, frames={}, mounts={}), faces[:1])
    placed = replace(state, frames=first.frames, mounts=first.mounts)
    assert max(float(np.sqrt((residuals(placed, one) ** 2).sum(axis=1).mean())) for one in faces) > 5e-3


def test_a_face_is_no_repetition_of_others_and_is_not_held_out_as_a_whole(stiff, touched, read):
    """Without a face nothing shows motion along its normal: links were dropped for that on soft arms."""
    options = CalibrationOptions(
        used_errors=None, excluded_errors=frozenset({"joint errors", "links", "gear ratio"})
    )
    points, faces = (
        calibrate(stiff.vjm, every, cad_prior(stiff.arm), options).selection.steps[0]
        for every in (read, touched)
    )
    assert np.isfinite(points.series_rms_after)
    assert np.isnan(faces.series_rms_after)
    assert faces.rms_after < faces.rms_before


def test_faces_and_fixed_points_are_drawn_where_they_were_found(stiff, touched, read, rng):
    """Targets are drawn as high over a face, and as far from a point, as was read, to 10 um of noise."""

    def noisy(one):
        error = 1e-5 * rng.standard_normal(one.distance.shape)
        return replace(one, name=f"file {one.name}", sigma=1e-5, distance=one.distance + error)

    every = [*map(noisy, (*touched, *read))]
    options = CalibrationOptions(used_errors=frozenset({"joint springs"}))
    found = calibrate_with_masses(stiff.vjm, every, options)
    [group] = draw_calibration(stiff, found, remaining_errors(found)).scene.groups
    layers = {layer.name: layer for layer in group.layers}
    squares, points, lines = (layers[name] for name in ("faces", "fixed points", "distances"))
    assert squares.labels == ["plane 1", "plane 2", "plane 3"]
    assert points.labels == ["point 1", "point 2"]
    assert np.abs(points.at[0] - POINTS).max() < 0.05  # with what a zero of the first joint moves it by
    at, normals = layers["target as read"].at[:, 0], squares.to[0] - squares.at[0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    numbers = {
        f"{one.name}, row {row}": number
        for one in every
        for row, number in zip(one.row_id, one.distance[:, 0], strict=True)
    }
    for k, one in enumerate(every):
        own = np.array([name.startswith(f"{one.name},") for name in group.names])
        read_there = [numbers[name] for name in np.array(group.names)[own]]
        if one.plane_normal is None:
            away = np.linalg.norm(at[own] - lines.at[own, 0], axis=1)
            np.testing.assert_allclose(away, read_there, atol=1e-6)
        else:
            off = at[own] - squares.at[0, k]
            np.testing.assert_allclose(off @ normals[k], read_there, atol=1e-6)
            assert (np.linalg.norm(off, axis=1) < 1.5 * squares.radius).all()
            assert np.isnan(lines.at[own]).all()


def test_distances_are_read_back_by_fixed_point_and_lost_ones_are_blank(kr500, tmp_path):
    short = replace(EXACT, max_change=0.8)
    asked = [*bars(*POINTS, instrument=short), Mounted(EXACT, "P3", fixed=np.array(POINTS[0]))]
    every, _ = simulate_distances(kr500, CAMPAIGN.model_copy(update={"poses": 8}), asked, 2)
    assert not every[0].is_measured.all()
    assert every[0].is_measured.any()
    file = tmp_path / "d.csv"
    write_series(file, kr500.arm, [replace(one, name=f"d {one.name}", mount="d") for one in every])
    again = read_series(file, kr500.arm).series
    assert [one.fixed_point for one in again] == [POINTS[0], POINTS[1], POINTS[0]]
    assert len({one.frame for one in again}) == 3
    assert {one.mount for one in again} == {"d"}
    for one, own in zip(again, every, strict=True):
        there = own.is_measured.any(axis=1)
        np.testing.assert_array_equal(one.is_measured, own.is_measured[there])
        np.testing.assert_array_equal(one.distance[one.is_measured], own.distance[own.is_measured])
        np.testing.assert_array_equal(one.q, own.q[there])
        assert (one.sigma, one.fixed_point_sigma) == (own.sigma, own.fixed_point_sigma)


def test_planes_and_constants_are_read_back_and_faces_of_a_block_share_a_frame(kr500, tmp_path):
    few = CAMPAIGN.model_copy(update={"poses": 9})
    planes, _ = heights(kr500, few, 2, 1e-5)
    twice = heights(kr500, CAMPAIGN.model_copy(update={"poses": 1}), 2, 1e-5, planes=PLANES[:1] * 2)[0]
    assert [len(np.unique(one.pose_id)) for one in twice] == [1, 1]  # fewer poses than planes
    wire = simulate_distances(kr500, few, bars(POINTS[0], instrument=replace(EXACT, zero_sigma=1.0)), 2)[0]
    file, stem = tmp_path / "d.csv", {"mount": "d", "markers": ("P1",)}
    named = [replace(one, name=f"d {k}", **stem) for k, one in enumerate((*planes, *wire))]
    named[:2] = [replace(one, frame="d block") for one in named[:2]]
    write_series(file, kr500.arm, named)
    again = read_series(file, kr500.arm).series
    assert [one.frame for one in again] == [one.frame for one in named]
    for one, own in zip(again, named, strict=True):
        np.testing.assert_allclose(one.distance, own.distance, atol=1e-15)
        for name in ("fixed_point", "plane_normal", "distance_offset_sigma", "frame_deviations"):
            assert getattr(one, name) == getattr(own, name), name
    rough = replace(again[0], plane_normal_sigma=2 * again[0].plane_normal_sigma)
    for block in ((rough, again[1]), (again[1], rough)):  # the largest of its faces, in any order
        unknowns = unknowns_of(kr500.vjm, block, JointErrorTerms(), joints_only(kr500.arm))
        assert unknowns.frame_deviations["d block"] == rough.frame_deviations
    mixed = replace(again[3], frame="d block", distance_offset_sigma=0.0, distance=np.abs(again[3].distance))
    with pytest.raises(BenchError, match="frame 'd block': expected one fixed point, got planes and"):
        calibrate(kr500.vjm, [*again[:2], mixed], cad_prior(kr500.arm))
    known = replace(again[3], distance_offset_sigma=0.0, distance=mixed.distance)
    with pytest.raises(BenchError, match="with constants within 1 m and 0 m"):
        calibrate(kr500.vjm, [again[3], known], cad_prior(kr500.arm))


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
        [one.fixed_point for one in export.series], [(2.2, 0, 0.1), (2.3, 0, 0.1)], rtol=1e-12
    )
    assert [one.fixed_point_sigma for one in export.series] == [0.02, 0.02]
    assert any("20 mm for the fixed point is assumed" in note for note in export.notes)


FACES = f"""marker,{JOINTS},height_mm,fixed_x_mm,fixed_y_mm,fixed_z_mm,direction_x,direction_y,direction_z
P1,10,-60,80,5,30,0,0,2200,0,100,0,0,2
P1,20,-60,80,5,30,0,-1.5,2200,0,100,0,0,2
P1,20,-60,80,5,30,0,2345,2200,0,100,,,
"""


def test_rows_of_a_table_with_a_direction_are_heights_over_a_plane(kr500, tmp_path):
    file = tmp_path / "d.csv"
    file.write_text(FACES)
    export = read_series(file, kr500.arm)
    plane, point = export.series
    assert (plane.name, point.name) == ("d plane 1", "d point 2")
    assert (plane.plane_normal, point.plane_normal) == ((0.0, 0.0, 1.0), None)
    np.testing.assert_allclose(plane.distance, [[0], [-1.5e-3]])
    assert any(
        "2 rows have no stated uncertainty: 0.5 deg for the direction is assumed" in note
        for note in export.notes
    )


@pytest.mark.parametrize(
    ("table", "old", "new", "words"),
    [
        (FACES, ",0,0,2\n", ",,,\n",
         "line 2, column height_mm: expected more than 0, got 0 m; a height over a plane"),
        (FACES, "100,0,0,2", "100,0,0,0",
         "line 2, column direction_x: expected a direction, got 0, 0, 0"),
        (FACES, "100,0,0,2", "100,0,,2", "line 2, column direction_y: expected a finite number, got ''"),
        (FACES, "2345", "-2345", "line 4, column height_mm: expected more than 0, got -2.345 m"),
        (TABLE, "fixed_x_mm,fixed_y_mm,fixed_z_mm", "a,b,c",
         "missing columns: fixed_x_m, fixed_y_m, fixed_z_m"),
        (TABLE, "2345.6,2200,0,100", "2345.6,,,", "line 2, column fixed_x_mm: expected the fixed point"),
        (TABLE, "2345.6", "-2345.6", "line 2, column distance_mm: expected more than 0, got -2.3456 m"),
        (TABLE, "distance_mm", "distance_before_mm", "missing columns: distance_m"),
        (TABLE.replace("P1,", "P1,1,2,3,"), "marker,", "marker,x_mm,y_mm,z_mm,",
         "expected distances, or positions and orientations, got both"),
    ],
)  # fmt: skip
def test_a_wrong_table_of_heights_or_distances_is_refused_in_one_line(
    kr500, tmp_path, table, old, new, words
):
    file = tmp_path / "d.csv"
    file.write_text(table.replace(old, new, 1))
    assert words in refused(read_series, file, kr500.arm)


@pytest.mark.parametrize(
    ("kind", "spoiled", "words"),
    [
        pytest.param("touched", lambda one: {"distance": 1e3 * one.distance},
                     "do not fit this arm and a plane through 2.3, 0, 1.4 m", marks=pytest.mark.study),
        ("touched", lambda one: {"plane_normal": (-0.6, 0.0, 0.8)}, "another .*normal"),
        pytest.param("touched", lambda one: {"fixed_point": (1.7, 0.0, 1.4)}, "its plane is 0.60. m and",
                     marks=pytest.mark.study),
        ("touched", lambda one: {"q": np.tile(one.q[:1], (one.n_rows, 1))},
         "1 poses with a reading are too few"),
        ("touched", lambda one: {"q": in_a_row(one.q)}, "its poses touch the plane along a line"),
        ("read", lambda one: {"distance": 1e-3 * one.distance},
         "0.000999 times as long as expected; is it another unit"),
        ("read", lambda one: {"fixed_point": (-2.2, 0.0, 0.1)},
         "its fixed point is 4.4 m from where it is stated"),
        ("read", lambda one: {"q": one.q[::-1].copy()},
         "do not fit this arm and a fixed point near 2.2, 0, 0.1 m"),
    ],
    ids=["mm for m", "another normal", "another place", "one pose", "in a row", "m for mm", "another point",
         "other poses"],
)  # fmt: skip
def test_readings_that_do_not_fit_or_show_no_plane_are_refused(request, kr500, kind, spoiled, words):
    sound = request.getfixturevalue(kind)[kind == "touched"]
    one = replace(sound, **spoiled(sound))
    # of a plane twice: either may have the frame and mount that they share
    every = [one, replace(one, row_id=one.row_id + 1000)][: 1 + (kind == "touched")]
    with pytest.raises(BenchError, match=words):
        calibrate(kr500.vjm, every, cad_prior(kr500.arm))


def in_a_row(q):
    """The poses of a joint that turns, with the other joints where they are in the first row."""
    rows = np.tile(q[0], (len(q), 1))
    rows[:, 0] += np.linspace(0, 1e-3, len(q))
    return rows


def test_two_fixed_points_in_one_frame_and_distances_without_one_are_refused(kr500, read):
    both = [replace(one, frame="A") for one in read]
    with pytest.raises(BenchError, match="frame 'A': expected one fixed point, got"):
        calibrate(kr500.vjm, both, cad_prior(kr500.arm))
    with pytest.raises(BenchError, match="expected distances and a fixed point together"):
        replace(read[0], fixed_point=None)
