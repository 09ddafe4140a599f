"""The picture and the recording of an arm's folder."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from page_checks import check_page, said
from read_back import chunks_of, columns, document, rerun, views

from testbench.arm.catalogue import find_arm
from testbench.bench.checked import check
from testbench.views.checked.files import write

BUDGET = 2**20


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pixels) -> Path:
    out = tmp_path_factory.mktemp("arm")
    with pixels():
        write(check("kr500_l480"), find_arm("kr500_l480"), out)
    return out


def test_a_check_leaves_a_picture_and_a_whole_recording(folder):
    assert sorted(file.name for file in folder.iterdir()) == [
        "arm.png",
        "manifest.json",
        "recording.rrd",
        "report.html",
    ]
    assert "1 file verified without error" in rerun("verify", folder / "recording.rrd")[1]
    assert (folder / "recording.rrd").stat().st_size < BUDGET
    picture = matplotlib.image.imread(folder / "arm.png")[..., :3]
    assert (picture.std(axis=2) > 0.1).sum() > 500  # markers and load, in colour


def test_no_pane_of_the_recording_is_blank_on_any_timeline(folder, blank_panes):
    assert blank_panes(folder / "recording.rrd") == []


def test_beams_stand_at_their_frames_and_have_their_true_diameter(folder):
    checked, chunks = check("kr500_l480"), chunks_of(folder / "recording.rrd")
    tube = columns(chunks, "/world/tubes/link_2")["LineStrips3D:strips"]
    assert len(tube) == 2  # two poses
    for pose, strips in zip(checked.beams[:, 2], tube, strict=True):
        near, far = np.array(strips[0]), np.array(strips[1])
        np.testing.assert_allclose(near[:-1].mean(axis=0), pose[:3, 3], atol=1e-6)
        np.testing.assert_allclose(far[:-1].mean(axis=0), pose[:3, 3] + 1.3 * pose[:3, 0], atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(near - pose[:3, 3], axis=1), 0.17, atol=1e-6)
    # where frames and tubes are right, each beam ends where the next one begins
    arrows = columns(chunks, "/world/beam_axes")
    origin, vector = (np.array(arrows[f"Arrows3D:{key}"][0]) for key in ("origins", "vectors"))
    np.testing.assert_allclose((origin + vector)[:3], origin[1:4], atol=1e-5)


def test_the_words_of_the_recording_are_what_must_be_confirmed(folder):
    chunks = chunks_of(folder / "recording.rrd")
    words = document(chunks, "/summary")
    assert "| 18 | link_2's tube 340/310 mm, E 110 GPa, assumed |" in words
    assert "No doubts about the arm." in words
    assert {origin for origin, *_ in views(folder / "recording.rrd")} == {"world", "summary"}


def test_the_page_shows_the_arm_and_what_must_be_confirmed(folder, open_page):
    checked = check("kr500_l480")
    shown = check_page(open_page, folder / "report.html", [item.words for item in checked.items[:5]])
    assert said(shown).startswith("Pose of median sag")
