"""The engine of trials, killed, interrupted, out of disk, on a cluster: always the same bytes."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import dask
import pytest
import trial_study
import trial_work
from listening import listening
from pyarrow import parquet
from run_here import heed_ctrl_c, here, is_refused, until
from test_bench import DRAWS

from testbench.cli.program import program
from testbench.errors import BenchError
from testbench.runs import engine
from testbench.runs.engine import RETRIES, WorkersLost, do_chunk, on_cluster, on_cores, run_study
from testbench.runs.store import PARTS, TrialPlan, open_store, part_seeds, write_parquet

HERE = Path(__file__).resolve().parent
SCRIPT = HERE / "trial_study.py"
TRIALS = 30
ONE, TWO = partial(on_cores, workers=1), partial(on_cores, workers=2)
QUICK = partial(trial_work.trials, 0.0, "")


def store_of(out, *, trials=TRIALS, resume=False, row=trial_work.Toy):
    toy = TrialPlan("toy", {"size": trial_work.SIZE}, range(5, 5 + trials))
    return open_store(out, toy, row=row, resume=resume)


def study(out, backend, *, work=QUICK, trials=TRIALS, size=2, resume=False):
    """The counts that a study yields, and the bytes of its Parquet file."""
    with store_of(out, trials=trials, resume=resume) as store:
        counts = list(run_study(work, store, backend, size=size))
        return counts, write_parquet(store, out).read_bytes()


def run(*args):
    """The command of the trials, in this process."""
    return here(trial_study.app, *args, "--trials", TRIALS)


def stored(out):
    """Trials in the store of a run, perhaps one under way."""
    return sum(len(part_seeds(part)) for part in out.glob(f"{PARTS}/*.parquet"))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The bytes that every other way must give: one process, no trouble."""
    counts, data = study(tmp_path_factory.mktemp("alone"), ONE)
    assert counts == list(range(0, TRIALS + 1, 2))
    return data


@pytest.mark.parametrize("size", [1, 7])
def test_two_workers_and_other_chunks_give_the_same_bytes(tmp_path, alone, size):
    counts, data = study(tmp_path, TWO, size=size)
    assert data == alone
    assert (counts[0], counts[-1]) == (0, TRIALS)


def test_a_worker_killed_in_mid_study_costs_nothing(tmp_path, alone):
    pids = tmp_path / "pids"
    pids.mkdir()
    with store_of(tmp_path) as store:
        counts = run_study(partial(trial_work.trials, 0.02, str(pids)), store, TWO, size=2)
        while next(counts) < 6:
            pass
        victim = int(next(pids.iterdir()).name)
        assert victim != os.getpid()
        os.kill(victim, signal.SIGKILL)
        rest = list(counts)
        assert rest[-1] == TRIALS
        assert rest == sorted(rest)
        assert write_parquet(store, tmp_path).read_bytes() == alone
    assert len(list(pids.iterdir())) >= 3


def test_a_trial_that_kills_every_worker_is_given_up_and_the_others_are_kept(tmp_path, alone, monkeypatch):
    monkeypatch.setattr("testbench.runs.engine.RETRIES", 1)
    with pytest.raises(
        BenchError, match=r"\(2 times in a row\); (\d+) of 30 trials are stored; --resume continues"
    ):
        study(tmp_path, TWO, work=partial(trial_work.deadly_trials, 17))
    assert stored(tmp_path) > 0
    assert study(tmp_path, ONE, resume=True)[1] == alone


def test_workers_that_are_lost_again_and_again_are_lost_in_a_row_only_without_a_result(tmp_path, alone):
    """All workers die after every chunk: the study ends all the same."""

    def frail(work, chunks):
        yield do_chunk(work, next(iter(chunks)))
        raise WorkersLost("gone")

    assert TRIALS // 2 > RETRIES + 1
    assert study(tmp_path, frail)[1] == alone


def test_ctrl_c_says_how_to_resume_and_resuming_gives_the_same_bytes(tmp_path, alone):
    out = tmp_path / "out"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    words = [sys.executable, SCRIPT, out, *f"--trials {TRIALS} --workers 2 --endless".split()]
    with subprocess.Popen(words, **pipes, preexec_fn=heed_ctrl_c) as run_:
        try:
            until(lambda: stored(out) > 2)  # so a first chunk is counted as well as stored
            os.killpg(run_.pid, signal.SIGINT)  # as a terminal does: the workers get it too
            _, error = run_.communicate(timeout=30)
        finally:
            run_.kill()
    assert run_.returncode == 130
    kept = stored(out)
    said = rf"at least (\d+) of {TRIALS} trials are stored: --resume continues"
    found = re.fullmatch(rf"interrupted: earlier results are unchanged; {said}\n", error)
    assert found, error
    assert int(found[1]) <= kept <= int(found[1]) + 2  # the chunk that was being stored
    assert [p.name for p in out.iterdir()] == [PARTS]
    is_refused(run(out), "--resume continues")
    assert run(out, "--resume", "--workers", 2).returncode == 0
    assert [p.name for p in out.iterdir()] == ["trials.parquet"]
    assert (out / "trials.parquet").read_bytes() == alone


def test_no_stop_reaches_the_first_workers_of_a_program_while_they_start():
    script = """
import trial_work
from testbench.runs.engine import on_cores
for chunk in on_cores(trial_work.blocked_stops, [[1], [2]], workers=2):
    print(*(row.names for row in chunk.found[0]))
"""
    words = [sys.executable, "-c", script]
    fresh = subprocess.run(words, cwd=HERE, check=True, capture_output=True, text=True)
    assert fresh.stdout.splitlines() == 2 * ["SIGHUP SIGINT SIGTERM"]


# loky's thread may still ask for work that was cancelled when a trial failed: its own race, and harmless.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("backend", [ONE, TWO])
def test_a_problem_in_a_trial_is_told_with_its_seeds(tmp_path, backend):
    with pytest.raises(BenchError, match=r"^seeds \d+ to \d+: arm\.toml: line 3: expected a mass$"):
        study(tmp_path, backend, work=trial_work.bad_trials)
    assert not list(tmp_path.iterdir())


def test_a_fault_of_ours_in_a_worker_is_told_with_its_place(tmp_path):
    with pytest.raises(ZeroDivisionError, match="no trial of ours") as caught:
        study(tmp_path, TWO, work=trial_work.faulty_trials)
    assert "in faulty_trials" in str(caught.value.__cause__)


@pytest.mark.parametrize("workers", [0, 10_000])
def test_there_is_at_least_one_worker_and_workers_have_an_end(tmp_path, workers):
    with pytest.raises(BenchError, match="expected"):
        study(tmp_path, partial(on_cores, workers=workers))


CLUSTER = HERE.parents[1] / "docs" / "cluster.md"  #: How a cluster is started.


def certificates(folder):
    """Those of an authority of its own in a folder, made as the page says."""
    folder.mkdir()
    for line in re.findall(r"^    (openssl .*)$", CLUSTER.read_text(), re.MULTILINE):
        subprocess.run(line.split(), cwd=folder, check=True, capture_output=True)
    return folder


def settings(folder):
    """The page's settings of Dask with the certificates of a folder, in a file there."""
    text = re.search(r"```yaml\n(.*?)```", CLUSTER.read_text(), re.DOTALL)[1]
    file = folder / "dask.yaml"
    file.write_text(text.replace("/home/me/cluster", str(folder)))
    return file


def read(file):
    """Settings of a file, as `dask.config.set` takes them."""
    return dict(flat(dask.config.collect([str(file)], env={})))


def flat(tree, path=()):
    """Keys with dots, and values, of nested settings."""
    for key, value in tree.items():
        yield from flat(value, (*path, key)) if isinstance(value, dict) else [(".".join((*path, key)), value)]


def whole_json(file):
    """What a file says once it is written to its end; None before."""
    try:
        return json.loads(file.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return None


@pytest.fixture(scope="module")
def secure(tmp_path_factory):
    """A scheduler and two workers on this machine, as somebody else would have started them by the page.

    Yields:
        The scheduler's address, a function that starts another worker, all processes.
    """
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("dask")
    file, own = settings(certificates(folder / "keys")), []

    def start(kind, *args):
        flags = re.search(rf"^    dask {kind}( tls:\S+)? (.*)$", CLUSTER.read_text(), re.MULTILINE)[2]
        flags = re.sub(r"10\.0\.0\.\d", "127.0.0.1", flags.replace("--port 8786", "--port 0")).split()
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *flags, *args]
        paths = os.pathsep.join([str(HERE), *sys.path])
        environment = {**os.environ, "PYTHONPATH": paths, "DASK_CONFIG": str(file)}
        with (folder / f"{len(own)}.log").open("wb") as log:
            own.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=folder, env=environment))
        return own[-1]

    told = folder / "scheduler.json"
    start("scheduler", "--scheduler-file", str(told))
    try:
        address = until(lambda: whole_json(told))["address"]
        worker = partial(start, "worker", address, "--no-nanny", "--local-directory", str(folder))
        worker()
        worker()
        with dask.config.set(read(file)):
            yield address, worker, own
    finally:
        for process in own:
            process.kill()
            process.wait()


def test_a_cluster_gives_the_same_bytes_and_uses_all_its_workers(tmp_path, alone, secure):
    address, *_ = secure
    pids = tmp_path / "pids"
    pids.mkdir()
    until(lambda: workers_of(address) == 2)
    work = partial(trial_work.trials, 0.01, str(pids))
    _, data = study(tmp_path, partial(on_cluster, address=address), work=work)
    assert data == alone
    assert len(list(pids.iterdir())) == 2
    assert run(tmp_path / "script", "--cluster", address).returncode == 0
    assert (tmp_path / "script" / "trials.parquet").read_bytes() == alone


@pytest.mark.attack
def test_the_bench_finds_on_a_cluster_what_it_finds_here(tmp_path, secure):
    address, *_ = secure
    entry, found = tmp_path / "draws.py", []
    entry.write_text(DRAWS)
    until(lambda: workers_of(address) == 2)
    for name, *flags in (["here", "--workers", 1], ["there", "--cluster", address]):
        asked = (entry, "--task", "frame", "--seeds", 2, *flags, "--out", tmp_path / name)
        done = here(program(["bench"]), "bench", *asked)
        assert done.returncode == 0, done.stderr
        rows = parquet.read_table(tmp_path / name / "trials.parquet").to_pylist()
        found.append([{k: v for k, v in row.items() if k != "cpu_seconds"} for row in rows])
    assert found[0] == found[1]
    assert {row["status"] for row in found[1] if row["name"] == "draws" and row["prior"]} >= {"done"}


def workers_of(address):
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        return len(client.nthreads())


def test_strangers_are_not_let_into_a_cluster(tmp_path, secure):
    address, *_ = secure
    theirs = settings(certificates(tmp_path / "theirs"))
    plain = address.replace("tls:", "tcp:")
    other, none = read(theirs), {"distributed.comm.tls.ca-file": None}
    for there, told, changed in (
        (plain, f"no scheduler answers at {plain}$", other),
        (address, "no scheduler answers at .*, or none with a certificate that fits", other),
        (address, "needs certificates", none),
    ):
        with dask.config.set(changed), pytest.raises(BenchError, match=told):
            study(tmp_path / "out", partial(on_cluster, address=there, patience=1.0))
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_cluster_that_is_started_as_the_page_says_listens_on_its_address_alone(secure):
    address, _, own = secure
    until(lambda: workers_of(address) == 2)
    ports = [place for process in own[:3] for place in listening(process.pid)]
    assert len(ports) == 6  # each for its own, and for the page that is not shown
    assert {place.partition(":")[0] for place in ports} == {"0100007F"}


@pytest.mark.attack
def test_a_worker_of_a_cluster_that_is_killed_costs_nothing(tmp_path, alone, secure):
    address, worker, _ = secure
    pids = tmp_path / "pids"
    pids.mkdir()
    third = worker()
    until(lambda: workers_of(address) == 3)
    work = partial(trial_work.trials, 0.05, str(pids))
    with store_of(tmp_path) as store:
        for _ in run_study(work, store, partial(on_cluster, address=address), size=2):
            if third.poll() is None and (pids / str(third.pid)).exists():
                third.kill()
                third.wait()
        assert write_parquet(store, tmp_path).read_bytes() == alone
    assert third.poll() is not None


def test_problems_on_a_cluster_are_told(tmp_path, secure, monkeypatch):
    address, *_ = secure
    there = partial(on_cluster, address=address)
    with pytest.raises(BenchError, match=r"^seeds \d+ to \d+: arm\.toml: line 3"):
        study(tmp_path, there, work=trial_work.bad_trials)
    versions = engine.numeric_versions()
    for found, said in (
        ({**versions, "numpy": "0.1"}, rf"expected numpy {versions['numpy']}, as on this machine, got 0\.1"),
        (
            {**versions, "sources": "0" * 64},
            f"expected sources {versions['sources']}, as on this machine, got 000",
        ),
        ({}, f"expected python {versions['python']}, as on this machine, got none"),
        (ImportError("no testbench"), "does not report its versions: ImportError"),
    ):
        monkeypatch.setattr("distributed.Client.run", lambda *_, f=found, **__: {"tcp://there": f})
        with pytest.raises(BenchError, match=f"worker tcp://there:? {said}"):
            study(tmp_path, there)
    assert list(tmp_path.iterdir()) == []
