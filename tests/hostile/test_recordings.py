"""Recordings of strangers: what is none is told at once in a line, and no name of one is a flag."""

import os

import pytest

from testbench.report.recording import stream as viewer

HEAD, NOISE = b"RRF2\0\x29\0\0\x02\0\0\0", bytes(range(256)) * 20
NONE, HALF = "not a Rerun recording", "not a complete Rerun recording"
JUNK = {
    "nothing": (b"", NONE),
    "text": (b"hello\n" * 1000, NONE),
    "noise": (NOISE, NONE),
    "an old one": (b"RRF1" + bytes(4000), NONE),
    "half a head": (b"RRF", NONE),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(100), NONE),
    "a head alone": (HEAD, HALF),
    "noise behind a head": (HEAD + NOISE, HALF),
    "noise between head and end": (HEAD + NOISE + viewer.ENDS + bytes(8), HALF),
    "5 GB of nothing": (b"RRF2", HALF),
}


@pytest.mark.parametrize("name", JUNK)
def test_what_is_no_recording_or_half_of_one_is_told_at_once(attack, lab, name):
    content, said = JUNK[name]
    (lab / "a.rrd").write_bytes(content)
    if "GB" in name:
        os.truncate(lab / "a.rrd", 5 * 2**30)
    attack(lab, "view", "a.rrd", "--web").refused("a.rrd", said)
    if said == NONE:
        attack(lab, "view", ".").refused("a.rrd", said)


def test_pipes_and_folders_are_no_recordings(attack, lab):
    os.mkfifo(lab / "a.rrd")
    (lab / "b.rrd").mkdir()
    for name in (".", "a.rrd", "b.rrd"):
        attack(lab, "view", name).refused("no recording")


@pytest.mark.parametrize("name", ["--save=x", "-x", "rerun+http:", "http:", "[x](y)", "$x"])
def test_the_viewer_gets_absolute_paths(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir()
    (tmp_path / name / "a.rrd").write_bytes(viewer.BEGINS)
    assert viewer.newest(viewer.Path(name)) == tmp_path / name / "a.rrd"
