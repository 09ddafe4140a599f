"""Two runs into one place, and one that is killed: what is there is of one run, never of two.

TESTBENCH_RACES=300 pytest tests/unit/test_two_writers.py runs as many races as asked for.
"""

import errno
import itertools
import json
import os
import signal
from pathlib import Path

import pytest

from testbench.errors import InputError
from testbench.report.terminal import plain_console
from testbench.runs import manifest as files
from testbench.runs.whole import (
    claim_folder,
    claimed,
    new_folder,
    reading,
    restore,
    whole_files,
    whole_folder,
)
from testbench.studies.paper import single_link
from testbench.studies.run import run
from testbench.workflows.options import Common

RACES = int(os.environ.get("TESTBENCH_RACES", "8"))
COMMAND = "testbench identify"
NAMES = {one: ["a.json", "b.png", f"{one}.csv", "meshes/c.stl"] for one in ("old", "one", "two")}


def write(out, tag):
    """A run whose files all say whose they are."""
    with whole_folder(out) as folder:
        for name in NAMES[tag]:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(tag)
        files.write_manifest(folder, command=COMMAND, scenario=tag, seeds=range(0), models={})


def claimed_write(out, tag):
    with claim_folder(out, COMMAND, force=False):
        write(out, tag)


def forked(work, *args):
    """The process that does it; 0 if it ends well, 2 if it is refused, else something else broke."""
    child = os.fork()
    if child:
        return child
    code = 70
    try:
        work(*args)
        code = 0
    except InputError:
        code = 2
    finally:
        os._exit(code)


def code(child):
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def whose(out):
    """The run of a folder; fails where its files are of several."""
    manifest = json.loads((out / "manifest.json").read_text())
    names = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    assert names - {"mine"} == set(manifest["files"]) == {*NAMES[manifest["scenario"]], "manifest.json"}
    assert {name: files.digest(out / name) for name in manifest["sha256"]} == manifest["sha256"]
    return manifest["scenario"]


def look_often(out):
    """A reader, who sees one run or is told that another one has come."""
    for _ in range(20):
        said = ""
        try:
            with reading(out):
                whose(out)
        except InputError as err:
            said = str(err)
        assert said in ("", f"{out}: another run replaced it while it was read: try again")


@pytest.mark.parametrize("work", [write, claimed_write])
def test_two_writers_of_a_folder_leave_the_files_of_one(tmp_path, work):
    codes = set()
    for race in range(RACES):
        out = tmp_path / str(race)
        write(out, "old")
        children = [forked(work, out, "one"), forked(work, out, "two")]
        reader = forked(look_often, out)
        codes |= set(map(code, children))
        assert code(reader) == 0
        assert whose(out) in ("one", "two")
        assert not list(tmp_path.glob(".*"))
    assert codes <= ({0} if work is write else {0, 2})


def test_a_second_run_is_refused_at_once(tmp_path):
    out = tmp_path / "deep" / "run"
    with claim_folder(out, COMMAND, force=False):
        assert code(forked(claimed_write, out, "two")) == 2
        assert code(forked(new_folder(out).__enter__)) == 2
        write(out, "old")  # its own one
    assert whose(out) == "old"
    assert not list(out.parent.glob(".*"))
    claimed_write(out, "one")
    assert whose(out) == "one"


def begin_study(out):
    """A study of one trial; it ends if it waits for another one."""
    signal.alarm(60)
    options = single_link.STUDY.options()
    run(single_link.STUDY, Common(out=out, seeds=1, workers=1), options, plain_console())


def test_a_second_run_of_a_study_is_refused_before_its_trials(tmp_path):
    """Its trials have no lock of their own."""
    with claimed(tmp_path / "run"):
        assert code(forked(begin_study, tmp_path / "run")) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore:flock not supported")
def test_locks_of_the_disk_are_not_needed(tmp_path, monkeypatch):
    """Where a file system has none, a file that names its process stands in."""

    def no_locks(*_):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", no_locks)
    with claimed(tmp_path / "run"):
        assert code(forked(claimed_write, tmp_path / "run", "two")) == 2
        write(tmp_path / "run", "one")
    assert whose(tmp_path / "run") == "one"
    assert not list(tmp_path.glob(".*"))


def at_call(k, act, names, monkeypatch):
    """From now on the k-th of these calls of paths, counted from 0, does something else first."""
    calls = itertools.count()

    def counting(original):
        def counted(self, *args, **kwargs):
            if next(calls) == k:
                act(self)
            return original(self, *args, **kwargs)

        return counted

    for name in names:
        monkeypatch.setattr(Path, name, counting(getattr(Path, name)))
    return calls


def killed_at(k, monkeypatch, work, *args):
    """Do it in a process that is killed before the k-th rename or removal of a file of it."""

    def counted_work():
        names = ("replace", "rename", "unlink")
        at_call(k, lambda _: os.kill(os.getpid(), signal.SIGKILL), names, monkeypatch)
        if k < 0:  # while what is over is removed
            monkeypatch.setattr("shutil.rmtree", lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL))
        work(*args)

    return code(forked(counted_work))


def test_a_kill_at_any_moment_leaves_the_old_run_or_the_new_one_and_what_is_of_none(tmp_path, monkeypatch):
    found = []
    for k in range(-1, 30):
        out = tmp_path / str(k)
        write(out, "old")
        (out / "mine").write_text("mine")
        ended = killed_at(k, monkeypatch, write, out, "one")
        restore(out)
        found.append(whose(out))
        write(out, "two")
        assert whose(out) == "two"
        assert (out / "mine").read_text() == "mine"
        assert not list(tmp_path.glob(".*"))
        if ended == 0:
            break
    assert found[1:] == sorted(found[1:])  # the old one until a moment, the new one from then on
    assert set(found) == {"old", "one"}
    assert len(found) > 5


def test_a_folder_that_is_made_after_a_kill_does_not_cost_the_earlier_run(tmp_path, monkeypatch):
    write(out := tmp_path / "run", "old")
    for k in range(30):
        killed_at(k, monkeypatch, write, out, "one")
        if not out.exists():
            break
    out.mkdir()
    with pytest.raises(InputError, match=r"a killed process moved an earlier run to .*\.run\.new/earlier"):
        write(out, "two")
    out.rmdir()
    write(tmp_path / "other", "two")
    restore(out)
    assert whose(out) == "old"


def write_several(folder, tag):
    """Files that belong together, one of them deeper."""
    with whole_files([folder / name for name in ("1.csv", "deep/2.csv", "3.csv")]) as parts:
        for part in parts:
            part.write_text(tag)


def several(folder):
    """The files that are in their places, and what they hold."""
    found = {p.name: p.read_text() for p in (*folder.glob("*.csv"), *folder.glob("deep/*.csv"))}
    return found, set(found.values())


def refused(monkeypatch, k, names, work, *args):
    """What is said where the disk refuses the k-th of these calls; None where it is not called so often."""

    def refuse(path):
        raise OSError(errno.EDQUOT, "Disk quota exceeded", str(path), None, str(path))

    with monkeypatch.context() as patched:
        calls = at_call(k, refuse, names, patched)
        try:
            work(*args)
        except InputError as err:
            return str(err)
    assert next(calls) <= k
    return None


@pytest.mark.parametrize("earlier", [True, False])
def test_a_kill_never_leaves_an_earlier_file_beside_a_new_one(tmp_path, monkeypatch, earlier):
    for k in range(20):
        folder = tmp_path / str(k)
        folder.mkdir()
        if earlier:
            write_several(folder, "old")
        ended = killed_at(k, monkeypatch, write_several, folder, "new")
        assert len(several(folder)[1]) <= 1
        write_several(folder, "two")
        assert several(folder)[1] == {"two"}
        assert not list(folder.rglob(".*"))
        if ended == 0:
            break
    assert 3 < k < 19


@pytest.mark.parametrize("names", [("rename", "replace"), ("mkdir",), ("write_text",)])
@pytest.mark.parametrize("work", [write_several, write])
def test_what_the_disk_refuses_once_loses_nothing(tmp_path, monkeypatch, names, work):
    for k in range(40):
        folder = tmp_path / str(k)
        work(folder, "old")
        before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        said = refused(monkeypatch, k, names, work, folder, "one")
        if said is None:
            break
        assert "cannot be written: Disk quota exceeded" in said
        assert ".new" not in said
        moved = list(tmp_path.glob(".*/earlier"))  # the new one has its place, and its guests have not
        if not moved:
            assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
        work(folder, "two")
        assert not list(tmp_path.glob(".*")) + list(folder.rglob(".*"))
    assert 1 < k < 39


def test_a_folder_in_the_place_of_one_of_several_files_stays(tmp_path):
    (tmp_path / "3.csv").mkdir()
    (tmp_path / "1.csv").write_text("old")
    with pytest.raises(InputError, match=r"3\.csv: cannot be written: 3\.csv is a folder"):
        write_several(tmp_path, "new")
    assert (tmp_path / "1.csv").read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["1.csv", "3.csv"]
