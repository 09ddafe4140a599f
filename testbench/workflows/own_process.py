"""Estimators of users, each call in a process of its own with a limit of time and one of memory."""

import importlib
import math
import multiprocessing
import os
import random
import resource
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread

import numpy as np
import scipy.linalg  # noqa: F401 - its BLAS has to be loaded before it can be limited
from threadpoolctl import threadpool_limits

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, printable
from testbench.identify.prior import Prior
from testbench.identify.regression import Regression
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

SIZE = Path("/proc/self/statm")  #: Begins with the memory that a process has, in pages.
SUFFIX = ".py"  #: Of a file; without it a source is a module.
MAX_ARRAY_BYTES = 2**26  #: Largest array of an answer [byte].
MAX_MESSAGE = 200  #: Of a message [characters].
ENDED = "its process ended without an answer"
DAEMON = (
    "needs a process of its own, which this worker of a cluster may not start: start workers with "
    "distributed.worker.daemon: false, see docs/cluster.md"
)

Given = tuple[Vjm, Structure, Dataset | Regression, Prior | None]
"""What `estimate(kinematics, structure, data, prior)` is called with."""


@dataclass(frozen=True)
class Limits:
    """Limit the time and memory of a call."""

    seconds: float = 60.0  #: Longest time [s].
    memory: int = 2 * 10**9  #: Most memory beside what its libraries take [byte].


@dataclass(frozen=True)
class EstimatorSource:
    """Describe a user's estimator: plain data, for manifest.json and for workers."""

    name: str  #: As every view calls it.
    source: str  #: Path of its file, or name of its module.
    function: str
    limits: Limits  #: Of a call.
    sha256: str = ""  #: Of its file.


@dataclass(frozen=True)
class EstimatorAnswer:
    """Hold what a call returned."""

    values: Array  #: Of any shape: parameters (n,) or compliances.
    covariance: Array | None  #: The second of two arrays; None where there was one.
    cpu_seconds: float  #: Processor time of the call.


def call_estimator(estimator_source: EstimatorSource, given: Given) -> EstimatorAnswer:
    """Call an estimator in a fork of a process that has loaded the library: nothing lasts from call to call.

    Args:
        estimator_source: The estimator.
        given: Its arguments.

    Returns:
        The answer.

    Raises:
        BenchError: Why it has no answer.
    """
    answer = _called(estimator_source, given)
    assert isinstance(answer, EstimatorAnswer)
    return answer


def file_of(estimator_source: EstimatorSource) -> Path:
    """Import an estimator, and return the file that has its function.

    Raises:
        BenchError: When it cannot be imported, or lacks the function.
    """
    return Path(str(_called(estimator_source, None)))


def _called(estimator_source: EstimatorSource, given: Given | None) -> EstimatorAnswer | str:
    """Run a call in a process, which is ended with all of its group."""
    if multiprocessing.current_process().daemon:
        raise BenchError(DAEMON)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, "joblib"])  # its workers name a way to start that it knows
    ours, theirs = context.Pipe(duplex=False)
    with ours:
        process = context.Process(target=_serve, args=(theirs, estimator_source, given))
        process.start()
        assert process.pid  # 0 would be our own group
        theirs.close()
        try:
            ours.recv()  # it has begun: to load the library takes no time of the call
            slow = BenchError(f"too slow: stopped after {estimator_source.limits.seconds:g} s")
            found: EstimatorAnswer | str | BenchError = (
                ours.recv() if ours.poll(estimator_source.limits.seconds) else slow
            )
        except EOFError:
            found = BenchError(ENDED)
        finally:
            process.kill()
            with suppress(ProcessLookupError):  # all of the group have ended
                os.killpg(process.pid, signal.SIGKILL)
            process.join()
    if isinstance(found, BenchError):
        raise BenchError(printable(" ".join(str(found).split()))[:MAX_MESSAGE])
    return found


def _serve(link: Connection, estimator_source: EstimatorSource, given: Given | None) -> None:
    """Answer one call, in a process group of its own; what is printed goes to the standard error."""
    try:
        os.setsid()
        os.dup2(2, 1)
        Thread(target=_end_with_parent, daemon=True).start()
        _limit(estimator_source.limits)
        link.send(None)
        with threadpool_limits(1):
            link.send(_answer(estimator_source, given))
    finally:
        os._exit(0)  # without what an estimator has left to be done at the end


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent
    parent.join()
    os.killpg(0, signal.SIGKILL)


def _limit(limits: Limits) -> None:
    """Hold this process to limits of memory and processor time."""
    if SIZE.exists():
        pages = int(SIZE.read_text().split()[0])
        _at_most(resource.RLIMIT_AS, pages * resource.getpagesize() + limits.memory)
    _at_most(resource.RLIMIT_CPU, math.ceil(limits.seconds) + 1)


def _at_most(kind: int, most: int) -> None:
    hard = resource.getrlimit(kind)[1]
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (most, most))


def _answer(estimator_source: EstimatorSource, given: Given | None) -> EstimatorAnswer | str | BenchError:
    """What its function returns; without an argument where its file is."""
    sys.dont_write_bytecode = True  # nothing is left beside the file
    random.seed(0)  # who draws from global generators draws the same in every process
    np.random.seed(0)  # noqa: NPY002
    try:
        function, file = _function(estimator_source)
        if given is None:
            return file
        start = time.process_time()
        found = function(*given)
        seconds = time.process_time() - start
        parts = found if isinstance(found, tuple) and len(found) == 2 else (found,)
        arrays = [_array(part) for part in parts]
        return EstimatorAnswer(arrays[0], arrays[1] if len(arrays) > 1 else None, seconds)
    except BenchError as err:
        return BenchError(str(err))  # one that can travel
    except BaseException as err:  # any, SystemExit among them: it is the user's code
        return BenchError(f"raised {type(err).__name__}: {err}".rstrip(": "))


def _function(estimator_source: EstimatorSource) -> tuple[Callable[..., object], str]:
    """The function, imported anew, and the path of its file."""
    if estimator_source.source.endswith(SUFFIX):
        spec = spec_from_file_location(f"own_estimator_{estimator_source.name}", estimator_source.source)
        assert spec
        assert spec.loader  # of any file of Python
        module = module_from_spec(spec)
        sys.modules[module.__name__] = module  # where dataclasses look for their module
        spec.loader.exec_module(module)
    else:
        module = importlib.import_module(estimator_source.source)
    function, file = getattr(module, estimator_source.function, None), getattr(module, "__file__", None)
    if not callable(function):
        raise BenchError(f"it has no function {estimator_source.function!r}")
    if file is None:
        raise BenchError("it has no file")
    return function, file


def _array(found: object) -> Array:
    """An array of numbers.

    Raises:
        BenchError: When it is none, or too large to be one of parameters or compliances.
    """
    if found is None:
        raise BenchError("expected an array, got None")
    try:
        array = np.asarray(found, dtype=float)
    except (TypeError, ValueError) as err:
        raise BenchError(f"expected an array of numbers, got {type(found).__name__}") from err
    if array.nbytes > MAX_ARRAY_BYTES:
        raise BenchError(f"wrong shape: expected parameters or compliances, got {array.shape}")
    return array
