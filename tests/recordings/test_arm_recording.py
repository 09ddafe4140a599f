"""The picture and the recording of an arm's folder."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from page_checks import check_page, said
from read_back import columns, document, on, sound
from run_here import fine

from testbench.workflows.arm_check import check


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pixels) -> Path:
    out = tmp_path_factory.mktemp("arm")
    with pixels():
        fine("check", "kr500_l480", "--out", out, "--force")
    return out


def test_a_check_leaves_a_picture_and_a_whole_recording(folder):
    assert sorted(file.name for file in folder.iterdir()) == [
        "arm.png",
        "manifest.json",
        "recording.rrd",
        "report.html",
        "report.json",
        "report.md",
        "run.log",
    ]
    picture = matplotlib.image.imread(folder / "arm.png")[..., :3]
    assert (picture.std(axis=2) > 0.1).sum() > 500  # markers and load, in colour


def test_no_pane_of_the_recording_is_blank_on_any_timeline(folder, blank_panes):
    assert blank_panes(folder / "recording.rrd") == []


def test_beams_stand_at_their_frames_and_have_their_true_diameter(folder):
    checked, chunks = check("kr500_l480"), sound(folder / "recording.rrd", "Warnings: 0.")
    poses = [1, 0, 1]  # the one of median sag first, then in order
    tubes = columns(on(chunks, "typical_first"), "/world/poses/tubes")
    arrows = columns(on(chunks, "typical_first"), "/world/poses/beam_axes")
    for rank, pose in enumerate(poses):
        k = tubes["typical_first"].index(rank)
        strips = np.array(tubes["LineStrips3D:strips"][k])
        start = np.array(arrows["Arrows3D:origins"][arrows["typical_first"].index(rank)])
        way = np.array(arrows["Arrows3D:vectors"][arrows["typical_first"].index(rank)])
        at, along = checked.beams[pose, 2, :3, 3], checked.beams[pose, 2, :3, 0]
        np.testing.assert_allclose(start[2], at, atol=1e-6)
        np.testing.assert_allclose(way[2], 1.3 * along, atol=1e-6)
        # where frames and tubes are right, each beam ends where the next one begins
        np.testing.assert_allclose((start + way)[:3], start[1:4], atol=1e-5)
        ends = strips.reshape(-1, 3)
        ring = ends[np.abs((ends - at) @ along) < 1e-6]
        near = ring[np.linalg.norm(ring - at, axis=1) < 0.2]
        np.testing.assert_allclose(np.linalg.norm(near - at, axis=1), 0.17, atol=1e-6)
        assert len(near) > 8
    names = columns(on(chunks, "typical_first"), "/world/poses/joints_names")["Points3D:labels"][0]
    assert names == [joint.name for joint in checked.cell.arm.joints]
    assert "| link_2's tube diameters 340/310 mm, E 110 GPa, assumed | 18 |" in document(chunks, "/tables")


def test_the_page_shows_the_arm_and_what_must_be_confirmed(folder, open_page):
    checked = check("kr500_l480")
    shown = check_page(open_page, folder / "report.html", [item.words for item in checked.items[:5]])
    assert said(shown).startswith("Pose of median sag")
