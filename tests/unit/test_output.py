"""Outputs replace what is of their kind, and nothing else."""

import hashlib
import json
import os
import subprocess
from pathlib import Path

import pytest

from testbench.errors import InputError
from testbench.runs.manifest import git_commit, write_manifest
from testbench.runs.whole import (
    PNG,
    check_file,
    check_folder,
    claim_folder,
    new_folder,
    whole_file,
    whole_folder,
)

OURS, OTHER = "testbench identify", "testbench plan"
PICTURE = b"\x89PNG\r\n\x1a\n"


def write_run(out, *names, command=OURS):
    with whole_folder(out) as folder:
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True, parents=True)
            (folder / name).write_text("new")
        said = {"command": command, "versions": {"testbench": "0"}, "files": [*names, "manifest.json"]}
        (folder / "manifest.json").write_text(json.dumps(said))


def folder_refused(out, text, **kwargs):
    with pytest.raises(InputError, match=text) as caught:
        claim_folder(out, OURS, **({"force": False} | kwargs)).__enter__()
    return str(caught.value)


def test_a_folder_with_anything_else_is_refused_and_the_file_named(tmp_path):
    write_run(tmp_path / "run", "a.json")
    (tmp_path / "run" / "thesis.tex").touch()
    assert "thesis.tex: was not written by testbench identify" in folder_refused(
        tmp_path / "run", "holds only runs"
    )
    check_folder(tmp_path / "run", OURS, force=True)
    write_run(tmp_path / "run", "b.json")
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["b.json", "manifest.json", "thesis.tex"]


def test_other_runs_links_files_and_inputs_are_refused(tmp_path):
    write_run(tmp_path / "plan", "a.json", command=OTHER)
    folder_refused(tmp_path / "plan", "holds a run of testbench plan")
    folder_refused(tmp_path / "plan" / "inside", "lies in the folder of a run")
    (tmp_path / "link").symlink_to(tmp_path)
    folder_refused(tmp_path / "link", "is a symbolic link")
    (tmp_path / "file").touch()
    folder_refused(tmp_path / "file", "expected a folder", force=True)
    folder_refused(tmp_path / "file" / "below", "cannot be written")
    data = tmp_path / "run" / "data.csv"
    write_run(data.parent, "data.csv")
    folder_refused(data.parent, "data.csv, which the command reads", force=True, inputs=[data])
    check_folder(data.parent / "out", OURS, force=True, inputs=[data.parent])
    (tmp_path / "run" / "manifest.json").unlink()
    (tmp_path / "run" / "manifest.json").symlink_to(tmp_path / "plan" / "manifest.json")
    folder_refused(tmp_path / "run", "holds a run of testbench plan")
    for long in (Path("x" * 300, "y"), Path("x" * 251)):
        folder_refused(tmp_path / long, "more than 250 bytes")


def test_a_folder_that_cannot_be_renamed_is_refused(tmp_path, monkeypatch):
    (tmp_path / "here" / "deeper").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here" / "deeper")
    for name in (".", "..", tmp_path / "here", "/proc"):
        folder_refused(Path(name), "is the working folder or a mount", force=True)


def test_a_failure_leaves_no_folder_behind(tmp_path):
    for make in (whole_folder, new_folder, whole_file):
        with pytest.raises(ZeroDivisionError), make(tmp_path / "made" / "deep" / "place"):
            _ = 1 / 0
    assert not list(tmp_path.iterdir())


def test_a_file_is_replaced_by_one_of_its_kind_only(tmp_path):
    def refused(path, text, **kwargs):
        with pytest.raises(InputError, match=text):
            check_file(path, PNG, **kwargs)

    old, new, link = tmp_path / "old.png", tmp_path / "new.png", tmp_path / "link"
    old.write_bytes(PICTURE)
    check_file(old, PNG)
    check_file(new, PNG)
    new.write_text("my thesis")
    refused(new, "exists and is not a PNG picture")
    check_file(new, PNG, force=True)
    link.symlink_to(old)
    refused(link, "is a symbolic link")
    check_file(link, PNG, force=True)
    refused(link, "is read by this command", force=True, inputs=[old])
    refused(new, "is read by this command", force=True, inputs=[tmp_path])
    check_file(old, PNG, inputs=[tmp_path])
    os.mkfifo(tmp_path / "pipe")
    for other in (tmp_path, tmp_path / "pipe", "/dev/null"):
        refused(tmp_path / other, "got a folder or a device", force=True)
    refused(tmp_path / "x" / ("y" * 300), "more than 250 bytes")
    write_run(tmp_path / "run", "a.json")
    refused(tmp_path / "run" / "x.png", "a run folder holds only runs")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that root cannot write")
def test_a_place_that_cannot_be_written_is_found_before_anything_is_made(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        check_file(tmp_path / "/proc/new/x.png", PNG)
    folder_refused(tmp_path / "/proc/new", "cannot be written")


def test_a_run_takes_the_place_of_one_of_its_kind_with_all_of_its_files_and_folders(tmp_path):
    """An arm's meshes lie in a folder of their own; guests in it are refused."""
    run, part = tmp_path / "deep" / "run", tmp_path / "part"
    check_folder(run, OURS, force=False)
    assert not run.parent.exists()
    write_run(run, "a.json", "meshes/fine/1.stl", "meshes/2.stl")
    check_folder(run, OURS, force=False)
    write_run(run, "a.json", "meshes/2.stl")
    check_folder(run, OURS, force=False)
    assert sorted(p.name for p in run.rglob("*")) == ["2.stl", "a.json", "manifest.json", "meshes"]
    (run / "meshes" / "mine.stl").touch()
    assert "meshes/mine.stl: was not written by" in folder_refused(run, "mine.stl")
    (run / "meshes" / "mine.stl").unlink()
    part.mkdir()
    (part / "b.json").touch()
    manifest = run / "manifest.json"
    manifest.write_text(manifest.read_text().replace("a.json", "../../part/b.json"))
    write_run(run, "c.json")
    assert (part / "b.json").exists()
    assert not (run / "meshes").exists()


def test_what_is_of_no_run_is_never_removed_even_by_force(tmp_path):
    """It moves with the folder, into which it was put before or while the run was made."""
    mine = ["meshes/mine.stl", "notes/deep/thesis.tex", "trials.log"]
    write_run(tmp_path / "run", "meshes/1.stl", "a.json")
    for name in mine:
        (tmp_path / "run" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "run" / name).write_text("mine")
    (tmp_path / "run" / "empty").mkdir()
    (tmp_path / "run" / "link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "link").symlink_to(tmp_path / "run")
    for out in (tmp_path / "run", tmp_path / "link"):
        write_run(out, "b.json")
        assert all((out / name).read_text() == "mine" for name in mine)
        found = {p.name for p in out.iterdir()}
        assert found == {"b.json", "manifest.json", "meshes", "notes", "trials.log", "empty", "link"}
    for out in ("run/empty", "run/notes"):
        with pytest.raises(InputError, match=f"{out}.*got a folder; move it away"):
            write_run(tmp_path / "run", Path(out).name)
    assert all((tmp_path / "run" / name).read_text() == "mine" for name in mine)
    (tmp_path / ".run.lock").write_text("mine")
    write_run(tmp_path / "run", "c.json")
    (tmp_path / ".run.new").mkdir()
    (tmp_path / ".run.new" / "mine").touch()
    with pytest.raises(InputError, match=r"\.run\.new: is not a leftover of a killed run"):
        write_run(tmp_path / "run", "d.json")
    found = {p.relative_to(tmp_path).as_posix() for p in tmp_path.glob("*")}
    assert found == {"run", "link", ".run.lock", ".run.new"}
    assert (tmp_path / ".run.new" / "mine").exists()
    assert (tmp_path / "run" / "c.json").exists()


def test_the_commit_of_a_checkout_says_whether_it_was_changed(tmp_path):
    """Of a folder that is no checkout, or lies in another one's, nothing is known."""
    me = ["-c", "user.name=A", "-c", "user.email=a@example.org"]

    def git(*args):
        done = subprocess.run(["git", "-C", tmp_path, *me, *args], check=True, capture_output=True, text=True)
        return done.stdout.strip()

    assert git_commit(tmp_path) == "unknown"
    git("init", "--quiet")
    (tmp_path / "inside").mkdir()
    (tmp_path / "a.txt").write_text("one")
    git("add", "a.txt")
    git("commit", "--quiet", "--message", "one")
    commit = git("rev-parse", "HEAD")
    assert git_commit(tmp_path) == commit
    (tmp_path / "a.txt").write_text("two")
    assert git_commit(tmp_path) == f"{commit}-dirty"
    assert git_commit(tmp_path / "inside") == "unknown"


def test_a_manifest_lists_files_of_inner_folders_too_each_with_its_checksum(tmp_path):
    for name in ("a.csv", "inner/b.csv", "inner/deep/c.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    write_manifest(tmp_path, command=OURS, scenario={}, seeds=range(0), models={})
    found = json.loads((tmp_path / "manifest.json").read_text())
    assert found["files"] == ["a.csv", "inner/b.csv", "inner/deep/c.csv", "manifest.json"]
    sums = {name: hashlib.sha256(name.encode()).hexdigest() for name in found["files"][:-1]}
    assert found["sha256"] == sums
