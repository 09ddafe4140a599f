"""The wheel, installed where the checkout is not: our arms, the templates and the demo come with it."""

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytest.importorskip("pip", reason="a wheel is built and installed by pip")


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The command in a fresh venv that sees the packages of this interpreter, but not the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--no-input"]
    build = ["wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder, ROOT]
    subprocess.run([*pip, *build], check=True)
    [wheel] = folder.glob("*.whl")
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    install = ["install", "--no-deps", "--no-index", "--no-compile", wheel]
    subprocess.run([*pip, "--python", python, *install], check=True)
    [site] = (folder / "venv" / "lib").glob("python3.*/site-packages")
    others = [path for path in sys.path if "site-packages" in Path(path).parts]
    (site / "packages.pth").write_text("\n".join(others) + "\n")
    return python.with_name("testbench")


def run(program, cwd, *args):
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([program, *args], cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.study
def test_it_is_the_installed_package_that_answers(program, tmp_path):
    where = run(program.with_name("python"), tmp_path, "-c", "import testbench; print(testbench.__file__)")
    assert Path(where.strip()).is_relative_to(program.parents[1])
    assert "identify" in run(program, tmp_path, "--help")


@pytest.mark.study
def test_an_arm_that_comes_with_it_is_found_by_name(program, tmp_path):
    assert "markers P1, P2, P3" in run(program, tmp_path, "check", "kr500_l480")


@pytest.mark.study
def test_the_demo_runs_from_any_folder(program, tmp_path):
    said = run(program, tmp_path, "demo", "--quick", "--out", "results")
    report = json.loads((tmp_path / "results" / "report.json").read_text())
    assert f"Tie: {report['badge']['winner']} ties with" in " ".join(said.split())
    assert (tmp_path / "results" / "recording.rrd").stat().st_size > 100_000
    manifest = json.loads((tmp_path / "results" / "manifest.json").read_text())
    assert manifest["git"] == "unknown"
    assert manifest["seed"] == 1
    assert set(manifest["models"]["kr500_l480"]) == {"elastic.toml", "rigid.xml"}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results"]
