"""Pictures of README and docs: each says inside which numbers it shows, and the docs hold these today."""

import re
import shutil
from pathlib import Path
from unittest import mock

import numpy as np
import opener
import pages
import pictures
import pytest
from PIL import Image
from read_reports import read_report
from run_here import app_of, do, here
from scipy.linalg import block_diag
from stamps import Stamp, digest, read_stamp, stamp

from testbench import Scenario, deflections, reduce, simulate
from testbench.errors import InputError
from testbench.identify.estimate import make_estimate
from testbench.model.laws import add_law_parameters
from testbench.model.load import first_order_deflection
from testbench.model.structure import all153
from testbench.model.vjm import evaluate_chain
from testbench.report import report as reports
from testbench.studies import run as studies

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SHOWN = re.compile(r"!\[[^]]*\]\(([^)]*\.(?:png|gif))\)")
NUMBER = re.compile(r"\d[\d,]*(?:\.\d+)?")
SAME = 0.02
"""Share by which a number may differ on another processor, and one more of its last digit."""


def numbers(text):
    """Decimals of a text, as they are written: those that are measured."""
    return [own for own in NUMBER.findall(text) if "." in own]


def file_of(name):
    return DOCS / f"{name}{'.gif' if name == pictures.FILM else '.png'}"


def test_every_picture_of_the_docs_is_one_that_make_pictures_draws():
    texts = [ROOT / "README.md", *DOCS.glob("*.md"), *(DOCS / "studies").glob("*.md")]
    shown = {(page.parent / own).resolve() for page in texts for own in SHOWN.findall(page.read_text())}
    drawn = {file_of(name) for name in pictures.PICTURES}
    drawn |= {DOCS / "studies" / f"{name}.png" for name in pages.STUDIES}
    drawn.add(pages.BOARD.with_suffix(".png"))
    assert shown == drawn
    assert {*DOCS.glob("*.png"), *DOCS.glob("*.gif"), *DOCS.glob("*/*.png")} == drawn


@pytest.mark.parametrize("name", pages.STUDIES)
def test_the_picture_of_a_study_is_of_the_tables_beside_its_page(name):
    """An older one fails here: `make pictures`, or the full run that it names, mends it."""
    assert read_stamp(pages.PAGES / f"{name}.png").numbers == digest(pages.PAGES / name)


def test_the_picture_of_the_leaderboard_is_of_the_tables_beside_its_page():
    assert read_stamp(pages.BOARD.with_suffix(".png")).numbers == digest(pages.BOARD)


@pytest.mark.parametrize("name", [name for name, own in pictures.PICTURES.items() if own.page])
def test_the_numbers_of_a_picture_are_those_of_its_page(name):
    own = numbers(read_stamp(file_of(name)).numbers)
    assert len(own) > 1
    assert set(own) <= set(numbers((ROOT / pictures.PICTURES[name].page).read_text()))


def in_process(program, *words):
    """A program of a picture."""
    return here(app_of(ROOT / words[0]), *words[1:]) if program == "python" else do(*words)


@pytest.mark.study
def test_commands_say_today_what_their_pictures_say(tmp_path, monkeypatch):
    """Of every picture of a command, that of the same run alike; figure, page and recording are not read."""
    monkeypatch.chdir(ROOT)
    with (
        mock.patch.object(reports, "_views", return_value=[]),
        mock.patch.multiple(studies, headed_figures=mock.Mock(return_value={}), write_run=mock.DEFAULT),
        mock.patch.object(studies, "write_page"),
    ):
        pictures.make(tmp_path, list(pictures.COMMANDS), in_process)
    for name, picture in pictures.PICTURES.items():
        then, now = read_stamp(file_of(name)), read_report(tmp_path / picture.run / "report.json").headline
        assert then.command == pictures.COMMANDS[picture.run]
        assert NUMBER.sub("#", then.numbers) == NUMBER.sub("#", now), name
        for old, new in zip(NUMBER.findall(then.numbers), NUMBER.findall(now), strict=True):
            last = 10.0 ** -len(old.partition(".")[2])
            assert float(new.replace(",", "")) == pytest.approx(
                float(old.replace(",", "")), rel=SAME, abs=1.5 * last
            ), name


def test_the_film_bends_the_arm_as_a_model_predicts_its_laws_of_the_joints_included(kr500):
    """To first order, at the markers."""
    data = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=1), 3).identification
    structure = add_law_parameters(all153(kr500.arm), kr500.arm)
    C = block_diag(kr500.arm.C_theta, 0.5 * np.eye(structure.n_laws))
    regression = reduce(kr500.vjm, structure, data)
    found = make_estimate(regression, structure.parameters_of(C), method="known", constraint="psd")
    theta = opener._bent(kr500, found, data.q, (data.wrench, data.point))
    moved = first_order_deflection(evaluate_chain(kr500.vjm, data.q), theta, kr500.vjm.markers)
    np.testing.assert_allclose(moved, deflections(kr500.vjm, found, data), rtol=0, atol=1e-12)


def test_a_target_of_the_film_shows_the_rms_error_over_the_markers_where_the_model_puts_the_tool():
    off = np.array([[[0.0, 0.0, 0.0]] * 2, [[3e-4, 5e-4, 4e-4], [3e-4, -5e-4, 4e-4]]])  # loads, markers, xyz
    miss = opener._miss(off, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(miss.size_mm, [0, np.sqrt(0.5)], rtol=1e-12)
    np.testing.assert_allclose(miss.way, [[0, 0], [0.6, 0.8]], rtol=1e-12)


def test_the_film_opens_with_its_answer_for_three_seconds_and_repeats_without_a_seam():
    loads = opener.played()
    with Image.open(file_of(pictures.FILM)) as film:
        assert (film.size, film.n_frames, film.info["loop"]) == ((800, 450), len(loads), 0)
        assert film.info["duration"] >= 3000
    assert loads[0] == max(loads) == opener.LOADS - 1
    assert max(abs(a - b) for a, b in zip(loads, [*loads[1:], loads[0]], strict=True)) <= opener.LIFTED
    assert file_of(pictures.FILM).stat().st_size <= 1_500_000


def test_runs_are_made_after_those_that_they_read():
    order = list(pictures.COMMANDS)
    assert pictures.needed({"predict"}) == {"demo", "model", "predict"}
    assert pictures.needed({"C", "six_dof_arm"}) == {"C", "six_dof_arm"}
    for run in order:
        assert max(map(order.index, pictures.needed({run}) - {run}), default=-1) < order.index(run)


@pytest.mark.parametrize("suffix", [".png", ".gif"])
def test_a_stamp_is_read_back_and_changes_no_pixel(tmp_path, suffix, rng):
    path, own = tmp_path / f"a{suffix}", Stamp("testbench demo", "0.164 mm, " * 60)
    frames = [Image.fromarray(rng.integers(0, 255, (20, 30), dtype=np.uint8)) for _ in range(3)]
    frames[0].save(path, **({"save_all": True, "append_images": frames[1:]} if suffix == ".gif" else {}))
    with pytest.raises(InputError, match="make pictures"):
        read_stamp(path)
    before = pixels(path)
    for each in (Stamp("older", "1"), own):
        stamp(path, each)
    assert read_stamp(path) == own
    np.testing.assert_array_equal(pixels(path), before)
    assert path.read_bytes().count(b"testbench demo") == 1
    assert b"older" not in path.read_bytes()


def pixels(path):
    with Image.open(path) as image:
        found = []
        for k in range(getattr(image, "n_frames", 1)):
            image.seek(k)
            found.append(np.array(image.convert("RGB")))
        return np.array(found)


def test_a_digest_is_of_the_numbers_alone_and_of_each_of_them(tmp_path):
    """Other words, headings and another order of rows are the same; a last digit is not."""
    source = DOCS / "studies" / "gravity_calibration"
    for name in ("same", "other"):
        shutil.copytree(source, tmp_path / name)
    file = tmp_path / "same" / "models.csv"
    head, *rows = file.read_text().replace("Joints", "Joint stiffness only").splitlines()
    file.write_text("\n".join([head.upper(), *rows[::-1]]))
    file = tmp_path / "other" / "models.csv"
    text = file.read_text()
    number = numbers(text)[0]
    file.write_text(text.replace(number, f"{number[:-1]}{(int(number[-1]) + 1) % 10}", 1))
    assert digest(tmp_path / "same") == digest(source) != digest(tmp_path / "other")
