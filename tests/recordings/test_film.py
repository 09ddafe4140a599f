"""Films: how long each picture stands, that they stay small, and what ffmpeg is asked for."""

import io

import numpy as np
import pytest
from PIL import Image

from testbench.errors import BenchError
from testbench.views.recording import film, shot
from testbench.views.recording.film import LARGEST, LONGEST, MOVING, REST, write_film


def png(pixels):
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG")
    return data.getvalue()


def steps(count):
    """A bar that grows on grey, as PNGs."""
    pictures = np.full((count, 60, 300, 3), 40, np.uint8)
    for k in range(count):
        pictures[k, 20:40, : 1 + k * 10] = (0, 158, 115)
    return [png(picture) for picture in pictures]


def test_a_film_shows_every_step_and_rests_at_both_ends(tmp_path):
    write_film(tmp_path / "part", ".gif", steps(21))
    shown, rests = [], []
    with Image.open(tmp_path / "part") as gif:
        assert gif.info["loop"] == 0
        for k in range(gif.n_frames):
            gif.seek(k)
            rests.append(gif.info["duration"])
            shown.append(int((np.asarray(gif.convert("RGB"))[30, :, 1] > 100).sum()))
    assert shown == [1 + 10 * k for k in range(21)]
    assert rests[0] == rests[-1] == REST
    assert sum(rests[1:-1]) == pytest.approx(MOVING, rel=0.1)
    assert max(rests[1:-1]) <= LONGEST


def test_a_large_film_shrinks_until_it_plays_at_once(tmp_path, rng):
    noise = [png(rng.integers(0, 256, (320, 480, 3), dtype=np.uint8)) for _ in range(10)]
    write_film(tmp_path / "part", ".gif", noise)
    assert (tmp_path / "part").stat().st_size <= LARGEST
    with Image.open(tmp_path / "part") as gif:
        assert gif.n_frames == 10
        assert gif.width / gif.height == pytest.approx(480 / 320, rel=0.01)


def test_what_stays_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(film, "LARGEST", 100)
    with pytest.raises(BenchError, match="choose a smaller --size"):
        write_film(tmp_path / "part", ".gif", steps(3))


def ffmpeg(folder, monkeypatch, *lines):
    """A program of that name, and no other program."""
    program = folder / "ffmpeg"
    program.write_text("\n".join(["#!/bin/sh", *lines]))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


def test_an_mp4_is_made_by_ffmpeg_of_all_pictures(tmp_path, monkeypatch):
    ffmpeg(tmp_path, monkeypatch, "for last; do :; done", 'echo "$@" > "$last"')
    write_film(tmp_path / "part", ".mp4", steps(21))
    said = (tmp_path / "part").read_text()
    assert "-f mp4" in said
    assert said.split()[-1] == str(tmp_path / "part")


def test_an_mp4_without_ffmpeg_or_with_one_that_fails_is_one_line(tmp_path, monkeypatch):
    ffmpeg(tmp_path, monkeypatch, "echo no such codec >&2", "exit 3")
    with pytest.raises(BenchError, match="exit code 3: no such codec"):
        write_film(tmp_path / "part", ".mp4", steps(2))
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    with pytest.raises(BenchError, match="needs the program ffmpeg"):
        write_film(tmp_path / "part", ".mp4", steps(2))


def test_a_film_goes_through_its_timeline_from_its_first_place(monkeypatch):
    """The load is hung on step by step, not taken off."""
    gone, picture = [], png(np.zeros((200, 10, 3), np.uint8))
    for name, answer in {"has": False, "hide_bars": None, "settled": picture, "still": picture}.items():
        monkeypatch.setattr(shot.headless, name, lambda *_, answer=answer: answer)
    monkeypatch.setattr(shot.headless, "places", lambda *_: ("load", 3, 40))
    monkeypatch.setattr(shot.headless, "go", lambda _, timeline, at: gone.append((timeline, at)))
    pictures = list(shot._frames(None, shot.Sight()))
    first, *steps = gone
    assert first == steps[0] == ("load", 3)
    assert steps[-1] == ("load", 40)
    assert steps == sorted(steps)
    assert len(pictures) == len(steps)
