"""Recordings of strangers: what is none is told at once in a line, and no name of one is a flag."""

import os

import pytest

from testbench.errors import InputError
from testbench.views.recording import viewer

SPARSE = 5 * 2**30  #: [byte]
JUNK = {
    "nothing": b"",
    "text": b"hello\n" * 1000,
    "noise": bytes(range(256)) * 20,
    "an old one": b"RRF1" + bytes(4000),
    "half a head": b"RRF",
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(100),
}
HEAD, NOISE = b"RRF2\0\x29\0\0\x02\0\0\0", bytes(range(256)) * 20
HALF = {
    "a head alone": HEAD,
    "noise behind a head": HEAD + NOISE,
    "noise between head and end": HEAD + NOISE + viewer.ENDS + bytes(8),
}


@pytest.mark.parametrize("command", ["view", "shot"])
@pytest.mark.parametrize("content", JUNK.values(), ids=JUNK)
def test_what_is_no_recording_is_told_at_once(content, command, attack, lab):
    (lab / "a.rrd").write_bytes(content)
    attack(lab, command, "a.rrd").refused("a.rrd", "no recording")
    attack(lab, command, ".").refused("a.rrd", "no recording")


@pytest.mark.parametrize("content", HALF.values(), ids=HALF)
def test_what_is_half_of_one_opens_no_window(content, tmp_path):
    (tmp_path / "a.rrd").write_bytes(content)
    with pytest.raises(InputError, match="no whole recording"):
        viewer.check_whole(tmp_path / "a.rrd")


@pytest.mark.parametrize("content", HALF.values(), ids=HALF)
def test_what_is_half_of_one_is_served_to_no_browser(content, attack, lab):
    (lab / "a.rrd").write_bytes(content)
    attack(lab, "view", "a.rrd", "--web").refused("a.rrd", "no whole recording")


def test_a_large_file_of_nothing_is_no_whole_recording(tmp_path):
    with (tmp_path / "a.rrd").open("wb") as file:
        file.write(b"RRF2")
        file.truncate(SPARSE)
    with pytest.raises(InputError, match="no whole recording"):
        viewer.check_whole(tmp_path / "a.rrd")


@pytest.mark.parametrize("command", ["view", "shot"])
def test_pipes_and_folders_are_no_recordings(command, attack, lab):
    os.mkfifo(lab / "a.rrd")
    (lab / "b.rrd").mkdir()
    for name in (".", "a.rrd", "b.rrd"):
        attack(lab, command, name).refused("no recording")


@pytest.mark.parametrize("name", ["--save=x", "-x", "rerun+http:", "http:", "[x](y)", "$x"])
def test_the_viewer_gets_absolute_paths(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir()
    (tmp_path / name / "a.rrd").write_bytes(viewer.BEGINS)
    assert viewer.newest(viewer.Path(name)) == tmp_path / name / "a.rrd"
