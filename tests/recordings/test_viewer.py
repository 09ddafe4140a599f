"""Opening and rendering recordings: which file, which program, how a film plays, what is missing."""

import os
from dataclasses import replace

import headless
import pytest
import shot as shots
from made_up_run import REPORT, made_up_run
from PIL import Image
from shot import Sight, film, shot

from testbench.errors import BenchError
from testbench.report.recording import stream as viewer
from testbench.report.recording.run import write_run
from testbench.report.recording.stream import RecordingHeader


@pytest.fixture
def folder(tmp_path, arm_6r):
    """Two recordings, the one in the inner folder newer."""
    (tmp_path / "inner").mkdir()
    seen = made_up_run(arm_6r)
    for path, age in ((tmp_path / "old.rrd", 100), (tmp_path / "inner" / "new.rrd", 0)):
        write_run(path, RecordingHeader("test", "{}", 1), REPORT, seen, {})
        time = path.stat().st_mtime - age
        os.utime(path, (time, time))
    return tmp_path


def test_the_newest_recording_of_a_folder_is_taken_or_the_one_that_is_named(folder):
    assert viewer.newest(folder) == folder / "inner" / "new.rrd"
    assert viewer.newest(folder / "old.rrd") == folder / "old.rrd"


@pytest.fixture
def program(folder, monkeypatch):
    """Stands for the viewer: keeps its arguments, and ends with 3 if nothing is in the folder."""
    script = folder / "program"
    script.write_text(
        f'#!/bin/sh\nprintf "%s\\n" "$@" >{folder}/arguments\ntest -e {folder}/old.rrd || exit 3\n'
    )
    script.chmod(0o700)
    monkeypatch.setattr(viewer, "program", lambda: str(script))


def test_the_viewer_gets_the_file_and_listens_to_this_machine_only(folder, program):
    for web in (False, True):
        viewer.view(folder / "old.rrd", web=web)
        got = (folder / "arguments").read_text().split()
        assert got[0] == str(folder / "old.rrd")
        assert got[got.index("--bind") + 1] == "127.0.0.1"
        assert ("--web-viewer" in got) == web


def test_a_viewer_that_fails_is_an_error(folder, program):
    (folder / "old.rrd").unlink()
    with pytest.raises(BenchError, match="exit code 3"):
        viewer.view(folder / "old.rrd", web=False)


def test_without_software_vulkan_the_package_is_named(folder, monkeypatch):
    monkeypatch.setattr(headless, "DRIVERS", (folder / "nothing",))
    with pytest.raises(BenchError, match="mesa-vulkan-drivers"):
        shot(folder, folder / "picture.png", Sight())


def has_lavapipe():
    return any(list(path.glob(headless.SOFTWARE)) for path in headless.DRIVERS if path.is_dir())


@pytest.mark.skipif(not has_lavapipe(), reason="needs mesa-vulkan-drivers")
@pytest.mark.look
def test_a_recording_becomes_pictures_without_a_screen(folder, monkeypatch, tmp_path_factory):
    monkeypatch.setattr(headless, "SETTLE", 0.5)  # messages that have not faded do no harm here
    png, gif = folder / "picture.png", folder / "film.gif"
    at_2 = Sight(size="640x400", timeline="typical_first", at=2)
    assert shot(folder, png, at_2) == folder / "inner" / "new.rrd"
    assert png.read_bytes().startswith(b"\x89PNG")
    at_9, lost, tabless = replace(at_2, at=9), replace(at_2, timeline="load"), replace(at_2, tab="Nothing")
    for sight, said in (
        (at_9, "--at: expected 0 to 7"),
        (lost, "no timeline 'load'; timelines are typical_first"),
        (tabless, "no tab 'Nothing'; tabs are Runs, Where it errs, Tables"),
    ):
        with pytest.raises(BenchError, match=said):
            shot(folder, png, sight)
    assert png.read_bytes().startswith(b"\x89PNG")
    places = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr("tempfile.tempdir", str(places))
    monkeypatch.setenv("TMPDIR", str(places))
    film(folder, gif, replace(at_2, at=None))
    assert list(places.iterdir()) == []  # the viewer keeps its data in files
    with Image.open(gif) as picture:
        assert picture.n_frames in (7, 8)  # a frame a place, of which two may look alike
        assert picture.size == (640, 400 - shots.BARS)


@pytest.mark.skipif(not has_lavapipe(), reason="needs mesa-vulkan-drivers")
def test_half_a_recording_is_told_at_once_and_by_its_reason(folder, monkeypatch):
    monkeypatch.setattr(headless, "LOAD", 0.0)  # nothing is waited for
    whole = (folder / "old.rrd").read_bytes()
    (folder / "half.rrd").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BenchError, match=r"half\.rrd: cannot be read: .*decode"):
        shot(folder / "half.rrd", folder / "picture.png", Sight(size="640x400"))
