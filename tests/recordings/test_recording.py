"""The recording of a calibration study, read back from its file."""

import re
import shutil
import time
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import rerun as rr
from read_back import chunks_of, columns, document, layout, on, picture, rerun, series, views
from rerun.chunk import RrdReader

from testbench.bench.campaign import Scenario, build_cell, settle_both, simulate
from testbench.bench.campaign_row import campaign_rows
from testbench.bench.judged import identify
from testbench.bench.models import SECTION_6, named_models
from testbench.data.dataset import in_order
from testbench.identify.evaluate import deflections
from testbench.model.poses import WorkArea
from testbench.plant import settle
from testbench.plant.shapes import body_names, elastic_frames, join_meshes, rigid_frames, visual_shapes
from testbench.report import campaigns
from testbench.report.table import Trials
from testbench.studies.gravity_calibration import report as gravity
from testbench.studies.gravity_calibration import trial
from testbench.views.page.calibration import Calibrated, calibration_seen
from testbench.views.recording import calibration
from testbench.views.recording.arm import reach
from testbench.views.recording.calibration import write_calibration
from testbench.views.recording.compliance import colours, compress, scaled
from testbench.views.recording.drawing import build_drawing
from testbench.views.recording.error_map import shades
from testbench.views.recording.stream import Header
from testbench.views.scale import scale_of
from testbench.views.schema import show

BUDGET = 2 * 2**20
SMALL = {
    "payload": 100.0,
    "station": WorkArea((0.8, -0.8, 0.5), (1.6, 0.8, 1.5)),
    "workspace": WorkArea((-2.0, -2.0, 0.3), (2.0, 2.0, 2.0)),
    "identification_poses": 3,
    "check_poses": 1,
    "identification_runs": 3,
    "check_runs": 2,
}


def campaign_of(cell, names, seed, changes):
    scenario = Scenario(arm=cell.arm.name, workspace_poses=5, **changes)
    campaign = simulate(cell, scenario, seed)
    return campaign, identify(cell, campaign, named_models(cell, names), time.perf_counter)


def study(cell, names=SECTION_6, seeds=1, **changes):
    """What write_calibration takes, of several seeds the words of all and the drawing of the first."""
    made = [campaign_of(cell, names, seed, changes) for seed in range(1, 1 + seeds)]
    trials = [
        (k, campaign_rows(cell, c, results, "tubes", placed=k == 0)) for k, (c, results) in enumerate(made)
    ]
    campaign, results = made[0]
    asked = trial.Settings(cell.arm.name, campaign.scenario, 50.0, "tubes")
    report = gravity.report(asked, range(1, 1 + seeds), Trials.of(trials))
    text = campaign.scenario.model_dump_json()
    header = Header(report.scenario, text, 1)
    return campaigns.calibration(report, header, 50.0), cell, campaign, results


def rests(made):
    """The true arm of all measured runs, unloaded and loaded."""
    cell, runs = made[1], made[2].measured
    return settle_both(cell.plant, "nonlinear", runs.q, runs.wrench, runs.point)


@pytest.fixture(scope="module")
def heavy(kr500):
    return study(kr500)


@pytest.fixture(scope="module")
def file(heavy, tmp_path_factory):
    path = tmp_path_factory.mktemp("heavy") / "recording.rrd"
    write_calibration(path, *heavy)
    return path


@pytest.fixture(scope="module")
def chunks(file):
    return chunks_of(file)


def test_timelines_are_places_runs_by_residual_or_as_measured_and_the_load(chunks):
    for chunk in chunks:
        names = set(chunk.timeline_names)
        assert names in (set(), {"load"}, {"place"}, {"worst_first", "run"})
        assert chunk.is_static == (not names)
    runs = columns(on(chunks, "run"), "/here")
    assert runs["run"] == list(range(1, 22))
    assert sorted(runs["worst_first"]) == list(range(21))
    assert columns(on(chunks, "place"), "/here")["place"] == list(range(1, 6))


def test_whatever_moves_has_a_state_on_every_timeline_so_that_no_view_is_blank_or_collapses(chunks):
    """A view shows entities of a timeline and static ones: what is on one alone vanishes on the others."""
    moving = {}
    for chunk in chunks:
        if not chunk.is_static:
            moving.setdefault(chunk.entity_path, set()).update(chunk.timeline_names)
    every = {"place", "worst_first", "run", "load"}
    apart = {path: every - own for path, own in moving.items() if own != every}
    runs = {"/world/markers/measured", "/world/sight", "/error_mm/noise_p95"}
    truth = {"/world/markers/true": {"worst_first", "run"}}
    assert apart == {path: {"place", "load"} for path in runs} | truth


def test_the_reviewer_lands_where_the_compared_models_differ_most(file, chunks, heavy):
    panel = layout(file)["/time_panel"]
    assert panel["TimePanelBlueprint:timeline"] == [["place"]]
    names = heavy[0].map.compared
    first, *_, last = (np.array(series(chunks, f"/error_mm/{name.lower()}", "place")) for name in names)
    apart = np.abs(first - last)
    assert apart[0] == apart.max()
    text = columns(on(chunks, "place"), "/here")["TextDocument:text"][0][0]
    assert all(f"{name} {heavy[0].map.error_mm[name][0]:.3f}" in text for name in names)


def test_bars_are_as_long_as_the_errors_of_the_compared_models(chunks, heavy):
    rows = {model.name: model for model in heavy[0].models}
    lengths, compared = [], heavy[0].map.compared
    for k, name in enumerate(compared):
        for timeline in ("place", "load"):
            there, mm = on(chunks, timeline), series(chunks, f"/error_mm/{name.lower()}", timeline)
            strips = columns(there, "/error_bars_mm/bar")["LineStrips2D:strips"]
            across = np.array([row[len(compared) + k] for row in strips])[:, :, 0]  # behind their frames
            assert (across.min(axis=1) == 0).all()
            labels = columns(there, "/error_bars_mm/name")["Points2D:labels"]
            method = "GCO" if rows[name].constraint == "psd" else "LS"
            assert [row[k] for row in labels] == [f"{method} ({name}): {x:.3f} mm" for x in mm]
            lengths += zip(across.max(axis=1), mm, strict=True)
    ends, mm = np.array(lengths).T
    assert ends == pytest.approx(mm * ends.max() / mm.max(), abs=1e-3)


def test_errors_by_place_are_those_of_the_report_and_of_arrows_and_markers(chunks, heavy):
    about, campaign = heavy[0], heavy[2]
    order = [list(campaign.truth.run).index(run) for run in about.map.run]
    true = np.array(columns(on(chunks, "place"), "/world/markers/true")["Points3D:positions"])
    nominal = np.array(columns(on(chunks, "place"), "/world/markers/nominal")["Points3D:positions"])
    assert true - nominal == pytest.approx(50 * campaign.truth.deflection[order], abs=2e-6)
    scale = columns(chunks, "/__properties/study")["error_magnification"][0][0]
    for k in about.shown:
        name = about.models[k].name
        mm = series(chunks, f"/error_mm/{name.lower()}", "place")
        assert mm == pytest.approx(about.map.error_mm[name], rel=1e-3)  # kept to four digits
        errors, predicted = (
            columns(on(chunks, "place"), f"/world/markers/{what}_{name.lower()}")
            for what in ("error", "predicted")
        )
        arrows, dots = np.array(errors["Arrows3D:vectors"]), np.array(predicted["Points3D:positions"])
        rms = np.sqrt((arrows**2).sum(axis=-1).mean(axis=-1))
        assert 1e3 * rms / scale == pytest.approx(mm, rel=1e-4)
        assert dots - true == pytest.approx(50 / scale * arrows, abs=4e-6)


def test_arrows_of_models_that_err_alike_lie_beside_each_other(chunks, heavy):
    shown = [heavy[0].models[k].name.lower() for k in heavy[0].shown]
    data = [columns(on(chunks, "place"), f"/world/markers/error_{name}") for name in shown]
    starts, along = (np.array([own[f"Arrows3D:{part}"] for own in data]) for part in ("origins", "vectors"))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    alike = (along[0] * along[1]).sum(axis=-1) > 0.9
    assert alike.any()
    radius = data[0]["Arrows3D:radii"][0][0]
    apart = np.linalg.norm(starts[0] - starts[1], axis=-1)
    assert (apart[alike] > 2 * radius).all()


def test_the_first_of_worst_first_is_the_worst_run(chunks, heavy):
    row = min((m for m in heavy[0].models if m.conservative), key=lambda m: m.workspace.rms_mm)
    residual = series(chunks, f"/error_mm/{row.name.lower()}")
    assert residual == sorted(residual, reverse=True)
    largest = max(row.identification.max_mm, row.check.max_mm)
    assert residual[0] == pytest.approx(largest, rel=1e-12)


def test_residuals_of_the_check_runs_reach_the_reports_maximum_and_are_marked(chunks, heavy):
    for row in (heavy[0].models[k] for k in heavy[0].shown):
        data = columns(on(chunks, "run"), f"/error_mm/{row.name.lower()}")
        marked = np.array(data["SeriesPoints:marker_sizes"])[:, 0] > 0
        assert marked.sum() == heavy[2].check.runs
        values = np.array(data["Scalars:scalars"])[:, 0]
        assert values[marked].max() == pytest.approx(row.check.max_mm, rel=1e-12)


def test_the_summary_is_answer_table_and_words_of_the_report(chunks, heavy):
    text = document(chunks, "/summary")
    assert text.startswith(heavy[0].summary)
    first, *_, last = heavy[0].map.compared
    assert f"at 1 {first} and {last} differ most" in text
    assert f"worst {first} {heavy[0].map.worst[first].place + 1}, " in text


def test_seed_scenario_versions_and_magnification_are_properties(chunks):
    properties = columns(chunks, "/__properties/study")
    assert properties["seed"] == [[1]]
    assert properties["scenario"] == [["gravity_calibration"]]
    assert properties["deflection_magnification"] == [[50.0]]
    assert properties["residual_magnification"] == [[2000.0]]
    assert properties["error_magnification"][0][0] > 0
    assert '"payload":460.3' in properties["parameters"][0][0]
    versions = columns(chunks, "/__properties/versions")
    assert {"testbench", "mujoco", "pin", "rerun-sdk", "numpy"} <= set(versions)


def test_measured_markers_are_drawn_at_the_magnified_deflection(chunks, heavy):
    campaign = heavy[2]
    nominal, measured = (
        np.array(columns(on(chunks, "run"), f"/world/markers/{name}")["Points3D:positions"])
        for name in ("nominal", "measured")
    )
    # single precision of a viewer: 1e-7 of a few metres
    assert measured - nominal == pytest.approx(50 * campaign.measured.deflection, abs=2e-6)


def test_load_is_labelled_with_the_payload(chunks):
    labels = columns(on(chunks, "run"), "/world/load/label")["Points3D:labels"]
    assert labels == [["460.3 kg"]] * 21


def application(file):
    (entry,) = RrdReader(file).recordings()
    return entry.application_id


def test_the_same_fits_give_the_same_recording(heavy, file, tmp_path):
    again = tmp_path / "again.rrd"
    write_calibration(again, *heavy)
    assert rerun("compare", "--unordered", file, again)[0] == 0
    assert application(again) == application(file)


def test_another_magnification_gives_another_recording(heavy, file, tmp_path):
    other = tmp_path / "other.rrd"
    write_calibration(other, replace(heavy[0], magnification=51.0), *heavy[1:])
    assert rerun("compare", "--unordered", file, other)[0] != 0
    assert application(other) != application(file)  # or the viewer would show one by the layout of the other


def test_a_failure_half_way_leaves_the_earlier_file_whole(heavy, file, tmp_path, monkeypatch):
    path = tmp_path / "recording.rrd"
    shutil.copyfile(file, path)

    def fail(*_):
        raise RuntimeError("half-way")

    monkeypatch.setattr(calibration, "write_histograms", fail)
    with pytest.raises(RuntimeError, match="half-way"):
        write_calibration(path, *heavy)
    assert path.read_bytes() == file.read_bytes()
    assert list(tmp_path.iterdir()) == [path]
    assert not rr.strict_mode()


def test_two_hundred_runs_stay_within_budget(kr500, tmp_path):
    path = tmp_path / "large.rrd"
    runs = {"identification_runs": 140, "check_runs": 60}
    data = study(kr500, ("MLS56", "MGCO56"), identification_poses=40, check_poses=20, **runs)
    write_calibration(path, *data)
    assert path.stat().st_size < BUDGET


def test_noise_free_linear_truth_is_drawn_too(kr500, tmp_path):
    path = tmp_path / "quiet.rrd"
    write_calibration(path, *study(kr500, ("MLS56", "MGCO56"), truth="linear", noise=False))
    assert max(series(chunks_of(path), "/error_mm/mgco56")) < 1e-6


@pytest.mark.parametrize(
    ("name", "words"),
    [("MLS56", "No model is conservative in every seed"), ("MGCO56", "Take MGCO56, marked")],
)
def test_one_model_alone_is_a_study_too(name, words, kr500, tmp_path):
    path = tmp_path / "recording.rrd"
    write_calibration(path, *study(kr500, (name,)))
    assert words in document(chunks_of(path), "/summary")


def test_illustrative_arm_with_one_marker_is_drawn(arm_6r, tmp_path):
    path = tmp_path / "recording.rrd"
    write_calibration(path, *study(arm_6r, ("MLS56", "MGCO56"), **SMALL))
    paths = {chunk.entity_path for chunk in chunks_of(path)}
    assert {"/world/arm/link_2", "/world/arm_deflected/link_2"} <= paths
    assert "/world/arm_deflected/link_0" not in paths  # it never moves


def test_loading_ends_where_the_arm_stands_at_the_first_place(heavy):
    made = build_drawing(*heavy)
    loading, places = made.loading, made.places
    assert made.share[[0, -1]].tolist() == [0, 1]
    assert loading.deflection[0] == pytest.approx(0, abs=1e-12)
    assert loading.deflection[-1] == pytest.approx(places.deflection[0], abs=1e-12)
    assert loading.predicted[:, -1] == pytest.approx(places.predicted[:, 0], abs=1e-15)
    assert loading.ghost.positions[-1] == pytest.approx(places.ghost.positions[0], abs=1e-12)
    assert loading.ghost.positions[0] == pytest.approx(places.rigid.positions[0], abs=1e-12)


def test_loading_is_an_equilibrium_of_its_share_of_the_load(kr500, heavy):
    made = build_drawing(*heavy)
    data, k = heavy[2].truth, list(heavy[2].truth.run).index(heavy[0].map.run[0])
    half = settle(kr500.plant, data.q[[k]], 0.5 * data.wrench[[k]], data.point[[k]])
    rest = settle(kr500.plant, data.q[[k]])
    middle = np.flatnonzero(made.share == 0.5)[0]
    assert made.loading.deflection[middle] == pytest.approx((half.markers - rest.markers)[0], abs=1e-12)
    # not half of the whole: the truth is not linear
    assert np.abs(made.loading.deflection[middle] - 0.5 * made.loading.deflection[-1]).max() > 1e-7


def test_the_arm_sags_on_the_load_timeline_below_an_empty_hook_on_a_sling_of_one_length(chunks):
    data = on(chunks, "load")
    true, nominal = (columns(data, f"/world/markers/{name}") for name in ("true", "nominal"))
    assert true["load"] == list(range(0, 101, 5))
    moved = np.array(true["Points3D:positions"]) - np.array(nominal["Points3D:positions"])
    sag = np.sqrt((moved**2).sum(axis=-1).mean(axis=-1))
    assert (np.diff(sag) > 0).all()
    plotted = np.array(series(chunks, "/deflection_mm/truth", "load"))
    assert sag == pytest.approx(50e-3 * plotted, abs=2e-6)
    labels = columns(data, "/world/load/label")["Points3D:labels"]
    assert (labels[0], labels[10], labels[20]) == (["0 kg"], ["230.2 kg"], ["460.3 kg"])
    sling = np.array(columns(data, "/world/load/sling")["LineStrips3D:strips"])[:, 0]
    length = np.linalg.norm(sling[:, 1] - sling[:, 0], axis=1)
    assert length == pytest.approx(length[0], abs=1e-6)
    cubes = columns(data, "/world/load/weight")["Boxes3D:half_sizes"]
    assert not cubes[0]
    hung = 7850 * np.prod(2 * np.array(cubes[1:])[:, 0], axis=1)
    assert hung == pytest.approx(460.3 * np.linspace(0.05, 1, 20), rel=1e-6)


def test_heatmaps_hold_truth_and_the_best_of_each_method(chunks, heavy, kr500):
    about, _, _, results = heavy
    shown = about.shown
    assert {about.models[k].constraint for k in shown} == {"none", "psd"}
    true = kr500.arm.links[2].compliance
    pixels = picture(chunks, "/compliance/links/cells")
    assert pixels.shape == (7 * 7 - 1, 7 * (1 + len(shown)) - 1, 3)
    blocks = [true, *(results[k].estimate.C_theta[12:18, 12:18] for k in shown)]
    for k, C in enumerate(blocks):
        assert (pixels[14:20, 7 * k : 7 * k + 6] == colours(scaled(C, true))).all()
    assert compress(np.array([-11.0, -1, 0, 1, 11])) == pytest.approx([-2, -1, 0, 1, 2])
    heads = columns(chunks, "/compliance/links/columns")["Points2D:labels"][0]
    assert heads == ["truth", *(about.models[k].name for k in shown)]
    assert show(true[1, 1], ".3e") in document(chunks, "/compliance_table")


def test_error_maps_of_all_models_have_one_scale_and_name_the_worst_place(chunks, heavy):
    found = heavy[0].map
    scale = scale_of(*(np.array(found.error_mm[name]) for name in found.compared))
    for name in found.compared:
        mm, worst = np.array(found.error_mm[name]), found.worst[name]
        balls = columns(chunks, f"/world/error_map/{name.lower()}/field")
        packed = np.array(balls["Points3D:colors"][0], dtype=np.uint32)
        drawn = np.column_stack([packed >> shift & 255 for shift in (24, 16, 8)])
        assert (drawn == shades(scale.shares(mm))).all()
        label = columns(chunks, f"/world/error_map/{name.lower()}/worst")
        assert label["Points3D:labels"] == [[f"worst {mm.max():.3f} mm, place {worst.place + 1}"]]
        assert label["Points3D:positions"][0][0][2] > max(z for *_, z in found.position_m)
        assert label["LineStrips3D:strips"][0][0][0] == pytest.approx(worst.position_m, abs=1e-6)
        assert worst.joints in document(chunks, "/error_words")


def test_a_scale_is_logarithmic_where_one_model_errs_far_more_and_says_so():
    good, bad = np.array([0.01, 0.02, 0.03]), np.array([0.5, 1.0, 2.0])
    alike, apart = scale_of(good, 1.5 * good), scale_of(good, bad)
    assert (alike.logarithmic, alike.words, alike.ends) == (False, "mm", (0.01, 0.045))
    assert (apart.logarithmic, apart.words, apart.ends) == (True, "mm, logarithmic", (0.01, 2.0))
    for scale in (alike, apart):
        share = np.linspace(0, 1, 5)
        assert scale.shares(scale.errors(share)) == pytest.approx(share, abs=1e-12)
    assert apart.shares(np.array([0.1 * 2**0.5]))[0] == pytest.approx(0.5)
    assert scale_of(np.array([0.0, 1e-9, 3.0])).ends == (0.003, 3.0)  # zero has no logarithm


def test_models_of_one_method_have_shades_of_their_own(chunks, heavy):
    shades_of = [
        tuple(columns(chunks, f"/error_mm/{heavy[0].models[k].name.lower()}")["SeriesLines:colors"][0])
        for k in heavy[0].shown
    ]
    assert len(set(shades_of)) == len(shades_of) > 1


def test_only_the_worst_marker_of_a_run_is_labelled(chunks, heavy):
    labels = columns(on(chunks, "run"), "/world/markers/worst_label")["Points3D:labels"]
    result = heavy[3][heavy[0].best]
    size = 1e3 * np.linalg.norm(result.residuals, axis=-1)
    names = np.array(heavy[1].arm.markers)[size.argmax(axis=1)]
    worst = zip(names, size.max(axis=1), strict=True)
    assert labels == [[f"{result.model.name} at {name}: {mm:.3f} mm"] for name, mm in worst]


def test_without_noise_there_is_no_line_of_noise(kr500, tmp_path):
    path = tmp_path / "quiet.rrd"
    write_calibration(path, *study(kr500, ("MLS56", "MGCO56"), noise=False))
    quiet = chunks_of(path)
    assert not [c for c in quiet if "noise" in c.entity_path]
    assert "noise-free" in document(quiet, "/log")


# --- geometry ---------------------------------------------------------------------------------------------


def test_shapes_are_the_visual_geoms_of_the_mjcf_in_their_own_places(kr500):
    shapes, names = visual_shapes(kr500.room), body_names(kr500.room)
    root = ET.parse(kr500.arm.rigid).getroot()
    geoms = [(b.get("name"), g) for b in root.iter("body") for g in b.findall("geom[@class='visual']")]
    assert [(names[s.body], s.kind) for s in shapes] == [(b, g.get("type")) for b, g in geoms]
    for shape, (_, geom) in zip(shapes, geoms, strict=True):
        size = np.array([float(x) for x in geom.get("size").split()])
        if geom.get("fromto"):
            ends = np.array([float(x) for x in geom.get("fromto").split()]).reshape(2, 3)
            half = shape.rotation[:, 2] * shape.size[2]
            drawn = np.array([shape.position - half, shape.position + half])
            turned = drawn[0] @ (ends[1] - ends[0]) > drawn[1] @ (ends[1] - ends[0])  # MuJoCo may
            assert (drawn[::-1] if turned else drawn) == pytest.approx(ends, abs=1e-9)
            assert shape.size[:2] == pytest.approx(np.tile(size, 2))
        else:
            assert shape.size == pytest.approx(np.broadcast_to(size, 3))
        assert shape.rotation @ shape.rotation.T == pytest.approx(np.eye(3), abs=1e-12)


def test_colours_come_from_the_material(kr500):
    shapes, names = visual_shapes(kr500.room), body_names(kr500.room)
    markers = [s for s in shapes if names[s.body] == "P1"]
    assert markers[0].rgba == pytest.approx([0.835, 0.369, 0, 1], abs=1e-6)


def test_elastic_frames_at_rest_are_the_rigid_ones(kr500, heavy):
    q = heavy[2].measured.q
    rigid = rigid_frames(kr500.room, q)
    elastic = elastic_frames(kr500.plant, q, np.zeros((len(q), kr500.arm.n_theta)))
    assert rigid.positions.shape == (21, len(body_names(kr500.room)), 3)
    assert elastic.positions == pytest.approx(rigid.positions, abs=1e-12)
    assert elastic.rotations == pytest.approx(rigid.rotations, abs=1e-12)


def test_elastic_frames_of_the_loaded_arm_hold_its_markers(kr500, heavy):
    _, loaded = rests(heavy)
    frames = elastic_frames(kr500.plant, heavy[2].measured.q, loaded.theta)
    index = [body_names(kr500.room).index(name) for name in kr500.arm.markers]
    assert frames.positions[:, index] == pytest.approx(loaded.markers, abs=1e-12)


def test_ghost_moves_by_the_magnified_deflection_to_first_order(heavy):
    small = build_drawing(replace(heavy[0], magnification=2.0), *heavy[1:])
    names = small.cell.arm.markers
    shift = small.bodies(names, small.runs.ghost) - small.bodies(names, small.runs.rigid)
    before, after = rests(heavy)
    sag = after.markers - before.markers
    # second order: rotations of 2 x 0.003 rad on 10 mm, and the sag of the unloaded arm
    assert shift == pytest.approx(2 * sag, abs=2e-4)


TETRAHEDRON = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0, 0, 0.2]])
FACES = [(1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)]


def variant(arm, folder, edit):
    """A copy of an arm's folder with an edited rigid.xml."""
    shutil.copytree(arm.rigid.parent, folder)
    tree = ET.parse(folder / "rigid.xml")
    edit(tree.getroot())
    tree.write(folder / "rigid.xml")
    return build_cell(folder)


@pytest.fixture
def mesh_arm(arm_6r, tmp_path):
    def edit(root):
        ET.SubElement(ET.SubElement(root, "asset"), "mesh", name="block", file="block.obj")
        link = next(b for b in root.iter("body") if b.get("name") == "link_2")
        look = {"type": "mesh", "mesh": "block", "pos": "0.1 0 0.2", "euler": "0 0 1.5707963267948966"}
        ET.SubElement(link, "geom", **look, group="2", contype="0", conaffinity="0")
        (tmp_path / "mesh" / "block.obj").write_text(
            "".join(f"v {x} {y} {z}\n" for x, y, z in TETRAHEDRON)
            + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES)
        )

    return variant(arm_6r.arm, tmp_path / "mesh", edit)


def test_mesh_vertices_stand_where_the_mjcf_puts_them(mesh_arm):
    (shape,) = [s for s in visual_shapes(mesh_arm.room) if s.kind == "mesh"]
    corners = shape.position + shape.mesh.vertices @ shape.rotation.T
    turned = TETRAHEDRON @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [0.1, 0, 0.2]
    # MuJoCo keeps meshes in single precision, about their centre of mass
    distance = np.linalg.norm(corners[:, None] - turned, axis=-1)
    assert distance.min(axis=1).max() < 1e-6
    assert distance.min(axis=0).max() < 1e-6
    assert shape.mesh.faces.shape == (4, 3)
    assert np.linalg.norm(shape.mesh.normals, axis=1) == pytest.approx(1, abs=1e-6)


def test_joined_meshes_keep_their_triangles(mesh_arm):
    (shape,) = [s for s in visual_shapes(mesh_arm.room) if s.kind == "mesh"]
    joined, counts = join_meshes([shape, shape])
    corners = shape.position + shape.mesh.vertices @ shape.rotation.T
    triangles = corners[shape.mesh.faces]
    assert counts == [len(corners)] * 2
    assert joined.vertices[joined.faces] == pytest.approx(np.concatenate([triangles, triangles]))


def test_an_arm_with_a_mesh_is_drawn(mesh_arm, tmp_path):
    path = tmp_path / "recording.rrd"
    write_calibration(path, *study(mesh_arm, ("MLS56", "MGCO56"), **SMALL))
    data = columns(chunks_of(path), "/world/arm/link_2")
    assert len(data["Mesh3D:triangle_indices"][0]) == 4
    assert len(data["Mesh3D:vertex_positions"][0]) == len(data["Mesh3D:vertex_normals"][0])


def test_an_arm_without_visual_geoms_is_drawn_as_sticks_between_its_bodies(arm_6r, tmp_path):
    def edit(root):
        for body in root.iter("body"):
            for geom in body.findall("geom"):
                body.remove(geom)

    bare = variant(arm_6r.arm, tmp_path / "bare", edit)
    shapes, names = visual_shapes(bare.room), body_names(bare.room)
    assert {s.kind for s in shapes} == {"capsule"}
    upper = next(s for s in shapes if names[s.body] == "link_2")
    tip = upper.position + upper.rotation[:, 2] * upper.size[2]
    assert tip == pytest.approx([0.9, 0, 0], abs=1e-9)
    path = tmp_path / "recording.rrd"
    write_calibration(path, *study(bare, ("MLS56", "MGCO56"), **SMALL))
    assert "/world/arm/link_2" in {chunk.entity_path for chunk in chunks_of(path)}


def test_sizes_of_a_drawing_do_not_depend_on_where_the_base_stands(arm_6r, tmp_path):
    def edit(root):
        for body in root.iter("body"):
            for geom in body.findall("geom"):
                body.remove(geom)
        base = next(body for body in root.iter("body") if body.get("name") == "link_0")
        base.set("pos", "5 -4 3")

    away = variant(arm_6r.arm, tmp_path / "away", edit)
    radius = max(shape.size[0] for shape in visual_shapes(away.room))
    assert 0.02 * 2 < radius < 0.02 * 4  # of an arm of three metres
    q = np.zeros((1, 6))
    assert reach(rigid_frames(away.room, q)) == pytest.approx(reach(rigid_frames(arm_6r.room, q)))


def test_of_several_seeds_the_words_are_the_medians_and_the_drawing_is_the_first(kr500, tmp_path):
    made = study(kr500, ("MLS56", "MGCO56"), seeds=2)
    path = tmp_path / "recording.rrd"
    write_calibration(path, *made)
    chunks = chunks_of(path)
    area = made[0].models[1].workspace.rms_mm
    assert f"MGCO56 {area.median:.3f} mm, least squares" in document(chunks, "/summary")
    assert columns(chunks, "/__properties/study")["seed"] == [[1]]
    labels = columns(chunks, "/errors_by_model_mm/number")["Points2D:labels"][0]
    assert f"{area.median:.3f} ({area.least:.3f} to {area.most:.3f}) mm, recommended" in labels
    titles = [name for *_, name in views(path)]
    assert "Errors by model (mm), logarithmic; dot: value; line: range of 2 trials" in titles


@pytest.fixture(scope="module")
def seen(heavy):
    """What the page draws of the same study."""
    about, cell, campaign, results = heavy
    made = Calibrated(cell, campaign, results, about.models, about.map, 37.0)
    return made, calibration_seen(made)


def test_the_pages_arrows_lead_from_where_markers_go_to_where_each_model_has_them(heavy, seen):
    """Of every model its own, as many times as long as the title says, on the deflection as it says."""
    made, drawn = seen
    said = re.fullmatch(r"Deflections x (\S+), arrows of errors x (\S+)\.", drawn.scene.title)
    moved, arrows = map(float, said.groups())
    assert moved == 37.0
    named = {m.name: r.estimate for m, r in zip(made.models, made.results, strict=True)}
    truth = {run: k for k, run in enumerate(made.campaign.truth.run.tolist())}
    sets = (
        in_order(made.campaign.truth, np.array([truth[run] for run in made.map.run])),
        made.campaign.measured,
    )
    for group, data in zip(drawn.scene.groups, sets, strict=True):
        dots, *errors = group.layers
        np.testing.assert_allclose(dots.at, data.before + moved * data.deflection, atol=2e-4)
        assert [layer.name for layer in errors] == [f"error of {name}" for name in made.map.compared]
        for layer, name in zip(errors, made.map.compared, strict=True):
            predicted = deflections(made.cell.vjm, named[name], data)
            np.testing.assert_allclose(layer.to - layer.at, arrows * (predicted - data.deflection), atol=1e-9)
            np.testing.assert_array_equal(layer.at, dots.at)


def test_titles_of_the_recording_say_the_magnifications_that_are_drawn(file, chunks, heavy):
    """Each by its property; over the maps stands the RMS of the errors, not the worst of them."""
    kept = columns(chunks, "/__properties/study")
    names = ("deflection_magnification", "error_magnification", "residual_magnification")
    moved, place, run = (kept[name][0][0] for name in names)
    titles = [name for *_, name in views(file)] + [name for name, *_ in views(file)]
    assert f"Arm (m): deflection x {moved:g}; arrows of errors x {place:g}, of runs x {run:g}" in titles
    found = heavy[0].map
    for name in found.compared:
        errors = np.array(found.error_mm[name])
        rms = np.sqrt(np.mean(errors**2))
        assert abs(rms / errors.max() - 1) > 0.05
        assert f"{name}: RMS {show(float(rms))} mm, axes (m)" in titles


def test_histograms_count_the_residuals_of_their_own_runs_in_micrometres(file, chunks, heavy):
    """Below its title stand the runs that it names; the curve of noise has as many components."""
    about, _, campaign, results = heavy
    check = np.isin(campaign.measured.pose, campaign.check.pose)
    found = [(origin, name) for origin, _, name in views(file) if origin.startswith("histogram_um/")]
    assert len(found) == 2 * len(about.shown)
    for origin, name in found:
        model, called = re.fullmatch(r"(.*), (fit|check) \(.*", name).groups()
        [k] = [k for k, row in enumerate(about.models) if row.name == model]
        left = 1e6 * results[k].residuals[check if called == "check" else ~check]
        bars, noise = (columns(chunks, f"/{origin}/{what}") for what in ("residuals", "noise"))
        at, counts = (np.array(bars[f"BarChart:{part}"][0][0]["buffer"]) for part in ("abscissa", "values"))
        half = (at[1] - at[0]) / 2
        np.testing.assert_array_equal(counts, np.histogram(left, [*(at - half), at[-1] + half])[0])
        fine, curve = (np.array(noise[f"BarChart:{part}"][0][0]["buffer"]) for part in ("abscissa", "values"))
        assert np.trapezoid(curve, fine) / (2 * half) == pytest.approx(left.size, rel=0.01)
