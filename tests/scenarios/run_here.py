"""A command or a scenario run in this process: starting Python and its libraries takes two seconds a time."""

import contextlib
import csv
import importlib.util
import io
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from checks import check_markdown
from page_checks import check_winner, drawn_in
from pyarrow import parquet
from read_back import document, series, sound

from testbench.cli.program import program
from testbench.report import report as reports
from testbench.report.markdown import as_plain
from testbench.report.recording.stream import snake
from testbench.runs import command
from testbench.runs import manifest as files
from testbench.studies import find_study, run
from testbench.workflows.model_names import in_words

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    "dataset.csv",
    "report.json",
    "report.md",
    "report.html",
    "manifest.json",
    "run.log",
    "recording.rrd",
    "trials.parquet",
}
"""What every study leaves beside its figures, and every command but data and trials."""


def here(app, *args):
    """What the program would have said, and its exit code."""
    out, err = io.StringIO(), io.StringIO()
    argv = mock.patch.object(sys, "argv", ["program", *map(str, args)])
    with argv, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = command.run(app, err.write)
    return subprocess.CompletedProcess(args, code, out.getvalue(), err.getvalue())


def do(*args):
    """A command of testbench, its name first."""
    return here(program([str(args[0])]), *args)


def fine(*args):
    """A command that does what it is asked for, with no word of trouble; all that it says on one line."""
    done = do(*args)
    assert (done.returncode, done.stderr) == (0, "")
    return " ".join(done.stdout.split())


def held(folder):
    """All files below a folder, and what is in them."""
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def is_refused(done, said=""):
    """One line that says what is wrong, and exit code 2."""
    assert done.returncode == 2, done.stdout
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert len(done.stderr) < 2100
    assert said in done.stderr
    return done.stderr


def refused(*args, said="", below=None):
    """A command that says in one line what is wrong, and touches nothing below a folder; the line."""
    before = below and {*below.rglob("*")}, below and held(below)
    line = is_refused(do(*args), said)
    assert (below and {*below.rglob("*")}, below and held(below)) == before
    return line


def table(path):
    """Rows of a CSV file by column."""
    return list(csv.DictReader(path.read_text().splitlines()))


@contextlib.contextmanager
def numbers_alone():
    """Studies leave their numbers alone, commands all but pictures, recording and page.

    These take longer than most trials and fits: whole runs of studies and tests of each command have them.
    """

    def write(_study, found, _header):
        files.write_json(found.report.json(), found.folder / "report.json")
        return []

    with mock.patch.object(run, "_write", write), mock.patch.object(reports, "_views", return_value=[]):
        yield


def heed_ctrl_c():
    """Before a program starts: a background job of a shell without job control has Ctrl-C ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def until(happened):
    """Wait for something, as long as a busy machine may take."""
    for _ in range(12_000):
        if found := happened():
            return found
        time.sleep(0.01)
    return pytest.fail("it did not happen in time")


def app_of(script):
    """The typer app of a scenario's script."""
    spec = importlib.util.spec_from_file_location(f"scenario_{script.stem}", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.app if hasattr(module, "app") else app_of_study(script.stem)


def app_of_study(name):
    """The typer app of a study."""
    return run.app(find_study(name))


def quick_study(app, *flags, less=contextlib.nullcontext):
    """Fixtures of a study's tests: the folder of a quick run and what it said, its report, its rows.

    Args:
        app: The study's typer app.
        flags: Of the command line.
        less: Makes a context in which the study has less to do.
    """

    @pytest.fixture(scope="module")
    def quick(tmp_path_factory):
        out = tmp_path_factory.mktemp("quick")
        with less():
            done = here(app, *flags, "--out", out, "--quick", "--workers", 1)
        assert done.returncode == 0, done.stderr
        return out, done

    @pytest.fixture(scope="module")
    def report(quick):
        return json.loads((quick[0] / "report.json").read_text())

    @pytest.fixture(scope="module")
    def rows(quick):
        return parquet.read_table(quick[0] / "trials.parquet").to_pylist()

    return quick, report, rows


def check_files(quick, *figures, data="dataset.csv"):
    """A quick run leaves the files of the contract and these figures, says where, and no word of trouble."""
    out, done = quick
    files = {*FILES - {"dataset.csv"}, data, *figures}
    assert {p.name for p in out.iterdir() if p.is_file()} == files
    assert done.stderr == ""
    for name in files - {"manifest.json", "run.log"}:
        assert str(out / name) in done.stdout
    check_markdown((out / "report.md").read_text())
    check_winner(out)
    badge = json.loads((out / "report.json").read_text())["badge"]["words"]
    assert badge in document(check_recording(out), "/summary")
    assert " ".join(as_plain(badge).split()) in " ".join(done.stdout.split())


def check_folder(out, *more):
    """What a command leaves in a folder: its views, these, and a badge that says the same everywhere."""
    files = {*FILES - {"dataset.csv", "trials.parquet"}, *more}
    assert {path.name for path in out.iterdir()} == files
    whole = {path.as_posix() for path in held(out)}
    assert {*json.loads((out / "manifest.json").read_text())["files"]} == whole
    check_winner(out)
    check_recording(out)


def check_recording(out, report="report.json"):
    """A recording is sound, has the answer of the report, and in its charts the numbers of the page's.

    Returns:
        Its chunks.
    """
    found = json.loads((out / report).read_text())
    chunks = sound(out / "recording.rrd", found["said"]["answer"] or found["badge"]["words"])
    entities = {chunk.entity_path for chunk in chunks}
    for chart in drawn_in(out / "report.html")["runs"]:
        for line in chart["lines"]:
            end = f"/{snake(chart['title'])}/{snake(in_words(line['name']).removeprefix('the '))}"
            [path] = [entity for entity in entities if entity.endswith(end)]
            shown, drawn = series(chunks, path), np.array(line["values"], dtype=float)
            np.testing.assert_allclose(np.sort(shown), np.sort(drawn), rtol=1e-3)
    return chunks
