"""Shapes of an arm are where its MJCF has them; a recording draws meshes and sticks too."""

import shutil
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from read_back import chunks_of, columns

from testbench.plant.shapes import elastic_frames, join_meshes, rigid_frames, visual_shapes
from testbench.report.recording.stream import RecordingHeader, recording
from testbench.report.recording.world import reach, write_arm
from testbench.workflows.campaign import settle_both
from testbench.workflows.cell import build_cell


def test_shapes_are_the_visual_geoms_of_the_mjcf_in_their_own_places(kr500):
    shapes, names = visual_shapes(kr500.room), kr500.room.body_names
    root = ET.parse(kr500.arm.mjcf_path).getroot()
    geoms = [(b.get("name"), g) for b in root.iter("body") for g in b.findall("geom[@class='visual']")]
    assert [(names[s.body], s.kind) for s in shapes] == [(b, g.get("type")) for b, g in geoms]
    for shape, (_, geom) in zip(shapes, geoms, strict=True):
        size = np.array([float(x) for x in geom.get("size").split()])
        if geom.get("fromto"):
            ends = np.array([float(x) for x in geom.get("fromto").split()]).reshape(2, 3)
            half = shape.rotation[:, 2] * shape.half_sizes[2]
            drawn = np.array([shape.centre - half, shape.centre + half])
            turned = drawn[0] @ (ends[1] - ends[0]) > drawn[1] @ (ends[1] - ends[0])  # MuJoCo may
            assert (drawn[::-1] if turned else drawn) == pytest.approx(ends, abs=1e-9)
            assert shape.half_sizes[:2] == pytest.approx(np.tile(size, 2))
        else:
            assert shape.half_sizes == pytest.approx(np.broadcast_to(size, 3))
        assert shape.rotation @ shape.rotation.T == pytest.approx(np.eye(3), abs=1e-12)


def test_colours_come_from_the_material(kr500):
    shapes, names = visual_shapes(kr500.room), kr500.room.body_names
    [marker] = [shape for shape in shapes if names[shape.body] == "P1"]
    assert marker.rgba == pytest.approx([0.835, 0.369, 0, 1], abs=1e-6)


def test_elastic_frames_are_rigid_at_rest_and_hold_the_markers_of_the_loaded_arm(kr500):
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, (3, 6))
    rigid = rigid_frames(kr500.room, q)
    still = elastic_frames(kr500.plant, q, np.zeros((len(q), kr500.arm.n_theta)))
    assert rigid.positions.shape == (3, len(kr500.room.body_names), 3)
    assert still.positions == pytest.approx(rigid.positions, abs=1e-12)
    assert still.rotations == pytest.approx(rigid.rotations, abs=1e-12)
    wrench = np.tile([0.0, 0, -4500, 0, 0, 0], (3, 1))
    _, loaded = settle_both(kr500.plant, "nonlinear", q, wrench, np.zeros((3, 3)))
    frames = elastic_frames(kr500.plant, q, loaded.theta)
    index = [kr500.room.body_names.index(name) for name in kr500.arm.markers]
    assert frames.positions[:, index] == pytest.approx(loaded.marker_positions, abs=1e-12)


TETRAHEDRON = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0, 0, 0.2]])
FACES = [(1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)]


def variant(arm, folder, edit):
    """A copy of an arm's folder with an edited rigid.xml."""
    shutil.copytree(arm.mjcf_path.parent, folder)
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
    corners = shape.centre + shape.mesh.vertices @ shape.rotation.T
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
    corners = shape.centre + shape.mesh.vertices @ shape.rotation.T
    triangles = corners[shape.mesh.faces]
    assert counts == [len(corners)] * 2
    assert joined.vertices[joined.faces] == pytest.approx(np.concatenate([triangles, triangles]))


def drawn(cell, tmp_path):
    """The arm in a recording, by entity."""
    with recording(tmp_path / "arm.rrd", RecordingHeader("arm", "{}", 1)) as pen:
        pen.layout(rrb.Spatial3DView(origin="world"), timeline="pose", places=1)
        frames = rigid_frames(cell.room, np.zeros((1, cell.arm.n_joints)))
        write_arm(pen.on(rr.TimeColumn("pose", sequence=[1])), cell, "arm", frames, None)
    return chunks_of(tmp_path / "arm.rrd")


def test_an_arm_with_a_mesh_is_drawn(mesh_arm, tmp_path):
    data = columns(drawn(mesh_arm, tmp_path), "/world/arm/link_2")
    assert len(data["Mesh3D:triangle_indices"][0]) == 4
    assert len(data["Mesh3D:vertex_positions"][0]) == len(data["Mesh3D:vertex_normals"][0])


@pytest.fixture
def bare(arm_6r, tmp_path):
    """An arm without visual geoms whose base stands elsewhere."""

    def edit(root):
        for body in root.iter("body"):
            for geom in body.findall("geom"):
                body.remove(geom)
        base = next(body for body in root.iter("body") if body.get("name") == "link_0")
        base.set("pos", "5 -4 3")

    return variant(arm_6r.arm, tmp_path / "bare", edit)


def test_an_arm_without_visual_geoms_is_drawn_as_sticks_between_its_bodies(bare, tmp_path):
    shapes, names = visual_shapes(bare.room), bare.room.body_names
    assert {s.kind for s in shapes} == {"capsule"}
    upper = next(s for s in shapes if names[s.body] == "link_2")
    tip = upper.centre + upper.rotation[:, 2] * upper.half_sizes[2]
    assert tip == pytest.approx([0.9, 0, 0], abs=1e-9)
    assert "/world/arm/link_2" in {chunk.entity_path for chunk in drawn(bare, tmp_path)}


def test_sizes_of_a_drawing_do_not_depend_on_where_the_base_stands(arm_6r, bare):
    radius = max(shape.half_sizes[0] for shape in visual_shapes(bare.room))
    assert 0.02 * 2 < radius < 0.02 * 4  # of an arm of three metres
    q = np.zeros((1, 6))
    assert reach(rigid_frames(bare.room, q)) == pytest.approx(reach(rigid_frames(arm_6r.room, q)))
