"""Recordings of strangers: what is none is told at once in a line, and no name of one is a flag."""

import os

import pytest

from testbench.report.recording import stream as viewer

HEAD, NOISE = b"RRF2\0\x29\0\0\x02\0\0\0", bytes(range(256)) * 20
JUNK = {
    "nothing": b"",
    "text": b"hello\n" * 1000,
    "noise": NOISE,
    "an old one": b"RRF1" + bytes(4000),
    "half a head": b"RRF",
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "a head alone": HEAD,
    "noise behind a head": HEAD + NOISE,
    "noise between head and end": HEAD + NOISE + viewer.ENDS + bytes(8),
    "5 GB of nothing": b"RRF2",
}


@pytest.mark.parametrize("name", JUNK)
def test_what_is_no_recording_or_half_of_one_is_told_at_once(attack, lab, name):
    (lab / "a.rrd").write_bytes(JUNK[name])
    if "GB" in name:
        os.truncate(lab / "a.rrd", 5 * 2**30)
    attack(lab, "view", "a.rrd", "--web").refused("a.rrd", "is not a complete Rerun recording")


def test_pipes_and_folders_are_no_recordings(attack, lab):
    os.mkfifo(lab / "a.rrd")
    (lab / "b.rrd").mkdir()
    for name in (".", "a.rrd", "b.rrd"):
        attack(lab, "view", name).refused("no recording")


@pytest.mark.parametrize("name", ["--save=x", "-x", "rerun+http:", "http:", "[x](y)", "$x"])
def test_the_viewer_gets_absolute_paths(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir()
    (tmp_path / name / "a.rrd").write_bytes(b"RRF2")
    assert viewer.newest(viewer.Path(name)) == tmp_path / name / "a.rrd"
