"""Wheel and sdist, installed where the checkout is not: arms, templates and demo are in them."""

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from strangers import light_urdf
from wheel import PIP, build_wheel, install_wheel

from testbench.files.read_pairs import read_csv
from testbench.files.robot.meshes import MESH_SUFFIXES
from testbench.workflows.campaign import Scenario, simulate, true_cell
from testbench.workflows.cell import build_cell
from testbench.workflows.model_names import in_words

ROOT = Path(__file__).resolve().parents[2]
BLOCK, PRINTED = re.search(
    r"```python\n(.*?)```\n```text\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL
).groups()
pytest.importorskip("pip", reason="a wheel is built and installed by pip")


def pythons():
    """The oldest and the newest Python of this machine that the package allows, of pyenv's too."""
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = {}
    for minor in range(11, 15):
        own = [sys.executable] if sys.version_info[1] == minor else []
        own += [*map(str, versions.glob(f"3.{minor}.*/bin/python3")), shutil.which(f"python3.{minor}")]
        for python in filter(None, own):
            ask = [python, "-c", "import ensurepip, sys; print(sys.version_info[1])"]
            done = subprocess.run(ask, capture_output=True, text=True, check=False)
            if done.stdout.strip() == str(minor):
                found[minor] = python
                break
    return [found[minor] for minor in sorted({min(found), max(found)})]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The wheel and the sdist of the checkout."""
    folder = tmp_path_factory.mktemp("built")
    wheel = build_wheel(ROOT, folder)
    sdist = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder]
    subprocess.run(sdist, cwd=ROOT, check=True, capture_output=True)
    [archive] = folder.glob("*.tar.gz")
    return wheel, archive


@pytest.fixture(scope="module")
def program(built, tmp_path_factory):
    """The command in a fresh venv that sees the packages of this interpreter, but not the checkout."""
    return install_wheel(built[0], tmp_path_factory.mktemp("wheel") / "venv").with_name("testbench")


def run(program, cwd, *args):
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    clean |= {"PATH": f"{program.parent}{os.pathsep}{clean['PATH']}", "MPLBACKEND": "Agg"}
    done = subprocess.run([program, *args], cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    return done.stdout


@pytest.mark.study
def test_the_demo_runs_from_any_folder_and_measures_cast_links_that_no_template_holds(program, tmp_path):
    where = run(program.with_name("python"), tmp_path, "-c", "import testbench; print(testbench.__file__)")
    assert Path(where.strip()).is_relative_to(program.parents[1])
    said = run(program, tmp_path, "demo", "--quick", "--out", "results")
    report = json.loads((tmp_path / "results" / "report.json").read_text())
    assert f"Tie: {in_words(report['badge']['winner'])} matches" in " ".join(said.split())
    assert (tmp_path / "results" / "recording.rrd").stat().st_size > 100_000
    manifest = json.loads((tmp_path / "results" / "manifest.json").read_text())
    assert manifest["git"] == "unknown"
    assert manifest["seed"] == 1
    assert set(manifest["models"]["kr500_l480"]) == {"elastic.toml", "rigid.xml"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results"]
    assert (report["true_arms"], report["cells"]["by_arm"]) == ({"cast": 1}, [])
    cell, scenario = build_cell("kr500_l480"), Scenario(arm="kr500_l480", workspace_poses=40)
    data = read_csv(tmp_path / "results" / "dataset.csv", cell.arm)
    cast, folder = (simulate(true_cell(cell, name, 1), scenario, 1).measured for name in ("cast", "tubes"))
    assert data.deflection == pytest.approx(cast.deflection, abs=1e-12)
    # the noise is the same: what differs is the arm
    assert np.abs(data.deflection - folder.deflection).max() > 1e-4


@pytest.mark.study
def test_the_sdist_makes_the_wheel_of_the_checkout(built, tmp_path):
    wheel, sdist = built
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    [source] = tmp_path.iterdir()
    names = [zipfile.ZipFile(own).namelist() for own in (wheel, build_wheel(source, tmp_path))]
    assert names[0] == names[1]
    assert {"testbench/models/ur10/rigid.xml", "testbench/entries/ridge.py"} <= set(names[0])


@pytest.fixture(scope="module", params=pythons(), ids=lambda path: Path(path).parts[-3])
def fresh(request, built, tmp_path_factory):
    """A venv of the oldest and newest Python with what pip brings for the wheel, in newest releases."""
    folder = tmp_path_factory.mktemp("fresh") / "venv"
    subprocess.run([request.param, "-m", "venv", folder], check=True)
    own = folder / "bin" / "python"
    got = subprocess.run(
        [own, *PIP, "install", "--no-compile", built[0]], capture_output=True, text=True, check=False
    )
    if re.search("ConnectionError|ConnectTimeout|Retrying", got.stderr):
        pytest.skip("no package index can be reached")
    assert got.returncode == 0, got.stderr
    return own


@pytest.mark.study
def test_readme_prints_what_it_says_in_a_fresh_venv(fresh, tmp_path):
    said, number = run(fresh, tmp_path, "-c", BLOCK), re.compile(r"\d+\.\d+")
    assert number.sub("", said) == number.sub("", PRINTED)
    shown, found = ([float(x) for x in number.findall(text)] for text in (PRINTED, said))
    assert found == pytest.approx(shown, rel=0, abs=0.02)
    assert "marker P3: 0.16 -0.12 -0.4 m" in run(
        fresh.with_name("testbench"), tmp_path, "check", "kr500_l480"
    )


@pytest.mark.study
def test_meshes_of_every_kind_are_read_in_a_fresh_venv(fresh, tmp_path):
    """trimesh imports what a format needs when it meets one."""
    file = light_urdf(tmp_path)
    [mesh] = tmp_path.rglob("link.stl")
    for suffix in MESH_SUFFIXES:
        trimesh.load(mesh).export(mesh.with_suffix(f".{suffix}"))
    before, *parts = file.read_text().split("link.stl")  # in turn
    kinds = itertools.cycle(MESH_SUFFIXES)
    file.write_text(before + "".join(f"link.{next(kinds)}{part}" for part in parts))
    assert "not read" not in run(fresh.with_name("testbench"), tmp_path, "new", "arm", "--from", file)
    assert len(list((tmp_path / "arm").rglob("*.stl"))) == len(parts)


@pytest.mark.study
def test_a_run_is_fitted_and_drawn_in_a_fresh_venv(fresh, tmp_path):
    program, flags = fresh.with_name("testbench"), ("--poses", "6", "--payload-kg", "460")
    run(program, tmp_path, "simulate", "kr500_l480", *flags, "--out", "data.csv")
    run(program, tmp_path, "identify", "kr500_l480", "data.csv", "--no-intervals", "--out", "model")
    assert {"report.html", "recording.rrd"} <= {path.name for path in (tmp_path / "model").iterdir()}
