"""Two runs into one place, and one that is killed: what is there is of one run, never of two.

TESTBENCH_RACES=300 pytest tests/unit/test_two_writers.py runs as many races as asked for.
"""

import errno
import itertools
import json
import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from testbench import files
from testbench.errors import InputError
from testbench.output import lock
from testbench.output.place import PNG, check_folder, claim_file, claim_folder, whole_folder
from testbench.output.replace import reading, settle
from testbench.output.whole import whole_files

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


def claimed(out, tag):
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
    names = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file() and p.name[:5] != ".clai"}
    names = {name for name in names if not name.startswith(".new-")}
    assert names == set(manifest["files"]) == {*NAMES[manifest["scenario"]], "manifest.json"}
    assert {name: files.digest(out / name) for name in manifest["sha256"]} == manifest["sha256"]
    return manifest["scenario"]


def look_often(out):
    """A reader, who must see one run at any time."""
    for _ in range(20):
        with reading(out):
            whose(out)


@pytest.mark.parametrize("work", [write, claimed])
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
        assert not list(out.rglob(".*"))
    assert codes <= ({0} if work is write else {0, 2})


def test_a_second_run_is_refused_at_once_and_told_who_writes(tmp_path):
    """Also a file into the folder of a run, and a run into the folder of a file."""
    out, picture = tmp_path / "deep" / "run", tmp_path / "p.png"
    with (
        claim_folder(out, COMMAND, force=False),
        claim_file(picture, PNG),
        claim_file(tmp_path / "other.png", PNG),
    ):
        assert [code(forked(claimed, place, "two")) for place in (out, tmp_path)] == [2, 2]
        files_ = [claim_file(place, PNG) for place in (picture, out / "q.png")]
        for again in (claim_folder(out, COMMAND, force=True), *files_):
            with pytest.raises(InputError, match=f"is being written by another run, process {os.getpid()}:"):
                again.__enter__()
    assert not list(tmp_path.iterdir())
    claimed(out, "one")
    assert whose(out) == "one"


def test_claims_of_killed_runs_go_and_what_is_no_claim_stays(tmp_path):
    def die():
        with claim_file(tmp_path / "x.png", PNG):  # and, beside others, its folder
            os.kill(os.getpid(), signal.SIGKILL)

    assert code(forked(die)) == -signal.SIGKILL
    left = list(tmp_path.iterdir())
    assert len(left) == 2
    left[0].write_text("mine")
    write(tmp_path, "one")
    assert left[0].read_text() == "mine"
    assert not left[1].exists()
    for path in left:
        path.unlink(missing_ok=True)
        path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="cannot be written"):
        claimed(tmp_path, "two")
    assert not (tmp_path / "elsewhere").exists()
    assert whose(tmp_path) == "one"


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
        work(*args)

    return code(forked(counted_work))


def test_a_kill_at_any_moment_leaves_the_old_run_or_the_new_one(tmp_path, monkeypatch):
    found = []
    for k in range(30):
        out = tmp_path / str(k)
        write(out, "old")
        ended = killed_at(k, monkeypatch, write, out, "one")
        settle(out, read=True)
        check_folder(out, COMMAND, force=False)
        found.append(whose(out))
        write(out, "two")
        assert whose(out) == "two"
        assert not list(out.rglob(".*"))
        if ended == 0:
            break
    assert found == sorted(found)  # the old one until a moment, the new one from then on
    assert set(found) == {"old", "one"}
    assert len(found) > 5


def test_nothing_is_moved_where_something_else_stands_in_the_way(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    for name, text in (("one.csv", "got a folder"), ("meshes", "expected a folder")):
        out = tmp_path / f"run {name}"
        write(out, "old")
        if name == "meshes":
            shutil.rmtree(out / name)
            (out / name).symlink_to(tmp_path / "elsewhere")
        else:
            (out / name).mkdir()
        with pytest.raises(InputError, match=text):
            write(out, "one")
        assert (out / "a.json").read_text() == "old"
    assert not list((tmp_path / "elsewhere").iterdir())


BOTH, MANIFEST = '["manifest.json", "mine"]', "manifest.json"
PLANTED = {
    "removes": lambda ready, run: (ready / MANIFEST).write_text(run.replace(BOTH, "[]")),
    "names a file elsewhere": lambda ready, run: [
        (place / MANIFEST).write_text(text)
        for place, text in ((ready, run), (ready.parent, run.replace("mine", "/etc/hostname")))
    ],
    "replaces": lambda ready, run: (ready / "mine").write_text("theirs"),
    "links": lambda ready, run: (ready / "theirs").symlink_to("/etc/hostname"),
    "pipes": lambda ready, run: os.mkfifo(ready / "theirs"),
}


@pytest.mark.parametrize("kind", PLANTED)
def test_who_reads_a_strangers_folder_puts_nothing_of_it_in_place(tmp_path, kind):
    run = json.dumps({"command": COMMAND, "versions": {"testbench": "0"}, "files": ["manifest.json", "mine"]})
    (tmp_path / "manifest.json").write_text(run)
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".ready").mkdir()
    PLANTED[kind](tmp_path / ".ready", run)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match="is of no run that was killed"), reading(tmp_path):
        pass
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "mine").read_text() == "mine"


def write_several(folder, tag, *names):
    """Files that belong together, three of them if nothing else is said, one of them deeper."""
    with whole_files([folder / name for name in names or ("1.csv", "deep/2.csv", "3.csv")]) as parts:
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


@pytest.mark.parametrize(("earlier", "other"), [(True, False), (False, False), (True, True)])
def test_a_kill_never_leaves_an_earlier_file_beside_a_new_one(tmp_path, monkeypatch, earlier, other):
    """Nor do other files that begin with the same one cost a file of a run that was killed."""
    for k in range(20):
        folder = tmp_path / str(k)
        folder.mkdir()
        if earlier:
            write_several(folder, "old")
        ended = killed_at(k, monkeypatch, write_several, folder, "new")
        assert len(several(folder)[1]) <= 1
        if other:
            write_several(folder, "two", "1.csv", "3.csv")
        assert refused(monkeypatch, 0, ["write_text"], write_several, folder, "refused")
        names, tags = several(folder)  # what was begun is brought to its end by a run that fails too
        assert len(names) == (3 if earlier or names else 0)
        assert other or len(tags) <= 1
        write_several(folder, "two")
        assert several(folder)[1] == {"two"}
        assert not list(folder.rglob(".*"))
        if ended == 0:
            break
    assert 3 < k < 19


@pytest.mark.parametrize("names", [("rename", "replace"), ("mkdir",)])
@pytest.mark.parametrize("work", [write_several, write])
def test_what_the_disk_refuses_once_loses_nothing(tmp_path, monkeypatch, names, work):
    """A run that was named whole before is put in place by the next command."""
    for k in range(40):
        folder = tmp_path / str(k)
        work(folder, "old")
        before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        said = refused(monkeypatch, k, names, work, folder, "one")
        if said is None:
            break
        assert "cannot be written: Disk quota exceeded" in said
        assert ".new-" not in said
        if not (folder / ".ready").exists():
            assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
        settle(folder)
        work(folder, "two")
        assert not list(folder.rglob(".*"))
    assert 1 < k < 39


def test_a_reader_waits_for_a_run_that_is_put_in_place(tmp_path):
    write(tmp_path, "old")
    begin, go = os.pipe()

    def look():
        os.read(begin, 1)  # made before the turn is taken, which it would share
        look_often(tmp_path)

    child = forked(look)
    with lock.turn(tmp_path):
        os.write(go, b".")
        time.sleep(0.05)
        assert os.waitpid(child, os.WNOHANG) == (0, 0)
    assert code(child) == 0
