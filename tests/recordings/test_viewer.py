"""Opening and rendering recordings: which file, which program, what is said where something is missing."""

import os
import subprocess
from dataclasses import replace

import pytest

from testbench.errors import BenchError
from testbench.views.colours import look
from testbench.views.recording import viewer
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Column


@pytest.fixture
def folder(tmp_path):
    """Two recordings, the one in the inner folder newer."""
    (tmp_path / "inner").mkdir()
    points = [Point(x, "LS", 0.1 * x) for x in (1, 2)]
    axes = Column("load", "load", "N"), Column("error", "error", "mm")
    sweep = Sweep(*axes, points, {"LS": look("MLS56", "none")})
    for path, age in ((tmp_path / "old.rrd", 100), (tmp_path / "inner" / "new.rrd", 0)):
        write_sweep(path, Header("test", "{}", 1), sweep, "### How much?")
        time = path.stat().st_mtime - age
        os.utime(path, (time, time))
    return tmp_path


def test_the_newest_recording_of_a_folder_is_taken_or_the_one_that_is_named(folder):
    assert viewer.newest(folder) == folder / "inner" / "new.rrd"
    assert viewer.newest(folder / "old.rrd") == folder / "old.rrd"


def test_the_viewer_gets_the_file_and_listens_to_this_machine_only(folder, monkeypatch):
    calls = []

    def run(command, **_):
        calls.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer.subprocess, "run", run)
    viewer.view(folder)
    (command,) = calls
    assert command[1] == str(folder / "inner" / "new.rrd")
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_a_viewer_that_fails_is_an_error(folder, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer.subprocess, "run", lambda c, **_: subprocess.CompletedProcess(c, 3))
    with pytest.raises(BenchError, match="exit code 3"):
        viewer.view(folder)


def test_without_software_vulkan_the_package_is_named(folder, monkeypatch):
    monkeypatch.setattr(viewer, "DRIVERS", (folder / "nothing",))
    with pytest.raises(BenchError, match="mesa-vulkan-drivers"):
        viewer.shot(folder, folder / "picture.png", viewer.Sight())


def has_lavapipe():
    return any(list(path.glob(viewer.SOFTWARE)) for path in viewer.DRIVERS if path.is_dir())


@pytest.mark.skipif(not has_lavapipe(), reason="needs mesa-vulkan-drivers")
def test_a_recording_becomes_a_picture_without_a_screen(folder):
    png = folder / "made" / "picture.png"
    at_2 = viewer.Sight(size="640x400", timeline="sweep", at=2)
    at_9, lost = replace(at_2, at=9), replace(at_2, timeline="load")
    assert viewer.shot(folder, png, at_2) == folder / "inner" / "new.rrd"
    assert png.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(BenchError, match="no tab 'Nothing'; tabs are Overview, Table"):
        viewer.shot(folder, png, viewer.Sight(size="640x400", tab="Nothing"))
    for sight, said in ((at_9, "--at: expected 1 to 2"), (lost, "no timeline 'load'; timelines are sweep")):
        with pytest.raises(BenchError, match=said):
            viewer.shot(folder, png, sight)
