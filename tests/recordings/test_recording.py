"""The recording of a calibration study, read back from its file."""

import re
import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from testbench import record
from testbench.bench import Scenario, build_cell, identify, named_models, simulate
from testbench.paper import SECTION_6
from testbench.plant.shapes import (
    body_names,
    elastic_frames,
    join_meshes,
    rigid_frames,
    visual_shapes,
)
from testbench.poses import WorkArea
from testbench.record import write_recording
from testbench.recording_study import RESIDUAL_FACTOR, build_study
from testbench.report import report

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


def study(cell, names=tuple(SECTION_6), **changes):
    scenario = Scenario(arm=cell.arm.name, workspace_poses=5, **changes)
    campaign = simulate(cell, scenario, 1)
    results = identify(cell, campaign, named_models(cell, names), time.perf_counter)
    return report("gravity_calibration", campaign, results, SECTION_6), cell, campaign, results


@pytest.fixture(scope="module")
def heavy(kr500):
    return study(kr500)


@pytest.fixture(scope="module")
def file(heavy, tmp_path_factory):
    path = tmp_path_factory.mktemp("heavy") / "recording.rrd"
    write_recording(path, *heavy)
    return path


@pytest.fixture(scope="module")
def chunks(file):
    return list(RrdReader(file).stream())


def columns(chunks, path):
    """All components of an entity by name, as lists of lists."""
    found = {}
    for chunk in chunks:
        if chunk.entity_path == path:
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if name != "log_time"]  # of the blueprint
            found |= {name: batch.column(name).to_pylist() for name in names}
    return found


def series(chunks, path):
    """Scalars of an entity, sorted by worst_first."""
    data = columns(chunks, path)
    return [v[0] for _, v in sorted(zip(data["worst_first"], data["Scalars:scalars"], strict=True))]


def document(chunks, path):
    return columns(chunks, path)["TextDocument:text"][0][0]


def views(path):
    """Origin, class and name of every view of the embedded blueprint."""
    reader = RrdReader(path)
    (blueprint,) = reader.blueprints()
    stream = list(reader.stream(store=blueprint))
    found = [columns(stream, c.entity_path) for c in stream]
    keys = [f"ViewBlueprint:{key}" for key in ("space_origin", "class_identifier", "display_name")]
    return {tuple(data[key][0][0] for key in keys) for data in found if keys[0] in data}


def rerun(*args):
    """Exit code and output of the viewer's own tool; `python -m rerun_cli` would lose the exit code."""
    command = [str(Path(sys.executable).with_name("rerun")), "rrd", *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stdout + done.stderr


def test_the_file_is_one_whole_recording_within_budget(file):
    assert "1 file verified without error" in rerun("verify", file)[1]
    assert file.stat().st_size < BUDGET
    (entry,) = RrdReader(file).recordings()
    assert re.fullmatch(r"testbench_calibration_v\d+", entry.application_id)


def test_every_view_of_the_blueprint_has_data_under_its_origin(file, chunks):
    paths = {chunk.entity_path for chunk in chunks}
    assert 0 < len(views(file)) <= 8
    for origin, *_ in views(file):
        assert any(f"{path}/".startswith(f"/{origin}/") for path in paths), origin


def test_every_view_of_numbers_has_its_unit_in_the_title(file):
    for origin, kind, name in views(file):
        assert kind == "TextDocument" or re.search(r"\((m|mm|um)\)", name), origin


def test_timelines_are_the_place_by_residual_and_the_order_of_the_dataset(chunks):
    for chunk in chunks:
        assert set(chunk.timeline_names) == (set() if chunk.is_static else {"worst_first", "pose"})
    residual = columns(chunks, "/residual_mm/mgco56")
    assert residual["pose"] == list(range(21))
    assert sorted(residual["worst_first"]) == list(range(21))


def test_the_reviewer_lands_on_the_worst_run(file, chunks, heavy):
    reader = RrdReader(file)
    panel = columns(list(reader.stream(store=reader.blueprints()[0])), "/time_panel")
    assert panel["TimePanelBlueprint:timeline"] == [["worst_first"]]
    row = min((m for m in heavy[0]["models"] if m["conservative"]), key=lambda m: m["check"]["rms_mm"])
    residual = series(chunks, f"/residual_mm/{row['name'].lower()}")
    assert residual == sorted(residual, reverse=True)
    largest = max(row["identification"]["max_mm"], row["check"]["max_mm"])
    assert residual[0] == pytest.approx(largest, rel=1e-12)


def test_residuals_of_the_check_runs_reach_the_reports_maximum_and_are_marked(chunks, heavy):
    for row in heavy[0]["models"]:
        data = columns(chunks, f"/residual_mm/{row['name'].lower()}")
        marked = np.array(data["SeriesPoints:marker_sizes"])[:, 0] > 0
        assert marked.sum() == heavy[0]["dataset"]["check_runs"]
        values = np.array(data["Scalars:scalars"])[:, 0]
        assert values[marked].max() == pytest.approx(row["check"]["max_mm"], rel=1e-12)


def test_the_numbers_of_the_summary_are_the_reports(chunks, heavy):
    text, rows = document(chunks, "/summary"), heavy[0]["models"]
    lines = [[c.strip(" *") for c in x.split("|")[1:-1]] for x in text.split("\n") if x.startswith("|")]
    table = {line[0]: line[1:] for line in lines}
    assert table[""] == [m["name"] for m in rows]
    assert table["unknowns / seen"] == [f"{m['parameters']} / {m['rank']}" for m in rows]
    assert table["conservative"] == ["yes" if m["conservative"] else "no" for m in rows]
    headings = {
        "RMS, identification, mm": ("identification", "rms_mm"),
        "RMS, check, mm": ("check", "rms_mm"),
        "max, check, mm": ("check", "max_mm"),
        "max relative, check, %": ("check", "max_relative_percent"),
        "RMS, workspace, mm": ("workspace", "rms_mm"),
    }
    for heading, (group, number) in headings.items():
        digits = 5.1e-3 if heading.endswith("%") else 5.1e-4  # rounding of the last printed digit
        printed = [float(cell.split()[0]) for cell in table[heading]]
        assert printed == pytest.approx([m[group][number] for m in rows], abs=digits)
    assert "(0.144)" in table["RMS, check, mm"][1]


def test_the_answer_is_one_bold_line_with_the_best_conservative_model(chunks, heavy):
    text, rows = document(chunks, "/summary"), heavy[0]["models"]
    (answer,) = re.findall(r"\*\*(.*predict.*|Best.*)\*\*", text)
    best = min((m for m in rows if m["conservative"]), key=lambda m: m["check"]["rms_mm"])
    assert answer.startswith(f"Best conservative model: {best['name']}, ")
    assert f"{best['check']['rms_mm']:.3f} mm" in answer
    assert f"{best['workspace']['rms_mm']:.3f} mm" in answer
    assert re.search(r"in run \d+, (check|identification) pose \d+", answer)


def test_all_numbers_are_finite(chunks):
    for chunk in chunks:
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            while pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
                column = column.flatten()
            if pa.types.is_floating(column.type):
                assert np.isfinite(column.to_numpy(zero_copy_only=False)).all(), name


def test_entity_paths_are_few_and_in_snake_case_and_carry_units(chunks):
    paths = {chunk.entity_path for chunk in chunks}
    assert len(paths) < 100
    for path in paths - {"/__properties", "/__properties/study", "/__properties/versions"}:
        assert re.fullmatch(r"(/[a-z][a-z0-9_]*)+|(/[a-z_]+)+/P\d", path), path
        numbers = {"Scalars:scalars", "BarChart:values"} & set(columns(chunks, path))
        assert not numbers or re.match(r"/[a-z]+_(mm|um)/", path), path


def test_seed_scenario_versions_and_magnification_are_properties(chunks):
    properties = columns(chunks, "/__properties/study")
    assert properties["seed"] == [[1]]
    assert properties["scenario"] == [["gravity_calibration"]]
    assert properties["deflection_magnification"] == [[50.0]]
    assert properties["residual_magnification"] == [[50.0 * RESIDUAL_FACTOR]]
    assert '"payload":460.3' in properties["parameters"][0][0]
    versions = columns(chunks, "/__properties/versions")
    assert {"testbench", "mujoco", "pin", "rerun-sdk", "numpy"} <= set(versions)


def test_measured_markers_are_drawn_at_the_magnified_deflection(chunks, heavy):
    campaign = heavy[2]
    nominal, measured = (
        np.array(columns(chunks, f"/world/markers/{name}")["Points3D:positions"])
        for name in ("nominal", "measured")
    )
    # single precision of a viewer: 1e-7 of a few metres
    assert measured - nominal == pytest.approx(50 * campaign.measured.deflection, abs=2e-6)


def test_load_is_labelled_with_the_payload(chunks):
    assert columns(chunks, "/world/load")["Arrows3D:labels"] == [["460.3 kg"]]


def test_same_seed_gives_the_same_recording(kr500, file, tmp_path):
    again = tmp_path / "again.rrd"
    write_recording(again, *study(kr500))
    assert rerun("compare", "--unordered", file, again)[0] == 0


def test_another_magnification_gives_another_recording(heavy, file, tmp_path):
    other = tmp_path / "other.rrd"
    write_recording(other, *heavy, magnification=51.0)
    assert rerun("compare", "--unordered", file, other)[0] != 0


def test_a_failure_half_way_leaves_the_earlier_file_whole(heavy, file, tmp_path, monkeypatch):
    path = tmp_path / "recording.rrd"
    shutil.copyfile(file, path)

    def fail(*_):
        raise RuntimeError("half-way")

    monkeypatch.setattr(record, "_write_load", fail)
    with pytest.raises(RuntimeError, match="half-way"):
        write_recording(path, *heavy)
    assert path.read_bytes() == file.read_bytes()
    assert list(tmp_path.iterdir()) == [path]
    assert not rr.strict_mode()


def test_two_hundred_runs_stay_within_budget(kr500, tmp_path):
    path = tmp_path / "large.rrd"
    runs = {"identification_runs": 140, "check_runs": 60}
    data = study(kr500, ("MLS56", "MGCO56"), identification_poses=40, check_poses=20, **runs)
    start = time.perf_counter()
    write_recording(path, *data)
    assert time.perf_counter() - start < 2  # takes 0.2 s; the rest is for a busy machine
    assert path.stat().st_size < BUDGET


def test_noise_free_linear_truth_is_drawn_too(kr500, tmp_path):
    path = tmp_path / "quiet.rrd"
    write_recording(path, *study(kr500, ("MLS56", "MGCO56"), truth="linear", noise=False))
    assert max(series(list(RrdReader(path).stream()), "/residual_mm/mgco56")) < 1e-6


@pytest.mark.parametrize(
    ("name", "answer"),
    [("MLS56", "No model is conservative; best: MLS56, "), ("MGCO56", "Best conservative model: MGCO56, ")],
)
def test_one_model_alone_is_a_study_too(name, answer, kr500, tmp_path):
    path = tmp_path / "recording.rrd"
    write_recording(path, *study(kr500, (name,)))
    summary = document(list(RrdReader(path).stream()), "/summary")
    assert f"**{answer}" in summary
    assert "(best" not in summary


def test_illustrative_arm_with_one_marker_is_drawn(arm_6r, tmp_path):
    path = tmp_path / "recording.rrd"
    write_recording(path, *study(arm_6r, ("MLS56", "MGCO56"), **SMALL))
    paths = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert {"/world/arm/link_2", "/world/arm_deflected/link_2"} <= paths
    assert "/world/arm_deflected/link_0" not in paths  # it never moves


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
    campaign = heavy[2]
    frames = elastic_frames(kr500.plant, campaign.measured.q, campaign.after.theta)
    index = [body_names(kr500.room).index(name) for name in kr500.arm.markers]
    assert frames.positions[:, index] == pytest.approx(campaign.after.markers, abs=1e-12)


def test_ghost_moves_by_the_magnified_deflection_to_first_order(heavy):
    small = build_study(*heavy, 2.0)
    names = small.cell.arm.markers
    shift = small.bodies(names, small.ghost) - small.bodies(names, small.rigid)
    sag = heavy[2].after.markers - heavy[2].before.markers
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
    write_recording(path, *study(mesh_arm, ("MLS56", "MGCO56"), **SMALL))
    data = columns(list(RrdReader(path).stream()), "/world/arm/link_2")
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
    write_recording(path, *study(bare, ("MLS56", "MGCO56"), **SMALL))
    assert "/world/arm/link_2" in {chunk.entity_path for chunk in RrdReader(path).stream()}
