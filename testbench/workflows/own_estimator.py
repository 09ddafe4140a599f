"""User estimators beside ours: their flags, their models, and the checks of their answers."""

import importlib
import math
import multiprocessing
import os
import random
import re
import resource
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.util import module_from_spec, spec_from_file_location
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from typing import Annotated

import numpy as np
import scipy.linalg  # noqa: F401 - its BLAS has to be loaded before it can be limited
import typer
from threadpoolctl import threadpool_limits

from testbench.arm.elastic import SYMMETRY_TOLERANCE, unit_diagonal_scale
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, printable
from testbench.identify.estimate import Estimate, deflections, make_estimate
from testbench.identify.prior import Prior
from testbench.identify.regression import Regression, reduce
from testbench.model.structure import Structure, all153
from testbench.model.vjm import Vjm
from testbench.runs import manifest as files
from testbench.workflows.cell import Cell
from testbench.workflows.models import MODELS, Model

# --- Estimators of users, each call in a process of its own with a limit of time and one of memory ----------

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


# --- User estimators beside ours: their flags, their models, and the checks of their answers ----------------

FLAG = "--estimator"
FORM = "[NAME=]FILE.py:function or [NAME=]module:function"
ASKED = re.compile(r"(?:(?P<name>[^=:/]*)=)?(?P<source>[^:]+):(?P<function>[^\W\d]\w*)")
ESTIMATOR_NAME = re.compile(r"[^\W\d][\w-]{0,39}")
MAX_COMPLIANCE = 1.0
"""Largest compliance and covariance of an answer [SI]: no arm gives way by a metre under a newton."""
MODULE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*")


@dataclass(frozen=True)
class LimitOptions:
    """Hold the flags of what a call may use."""

    estimator_timeout: Annotated[
        float, typer.Option(min=0.01, max=86_400, metavar="S", help="Time limit per call of your estimator.")
    ] = 60.0
    estimator_memory: Annotated[
        float,
        typer.Option(min=0.01, max=1000, metavar="GB", help="Memory limit per call of your estimator."),
    ] = 2.0

    @property
    def limits(self) -> Limits:
        """Return the limits of a call."""
        return Limits(self.estimator_timeout, int(1e9 * self.estimator_memory))


@dataclass(frozen=True)
class EstimatorOptions(LimitOptions):
    """Hold the flags of every command and study that tries a user's estimators."""

    estimator: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE.py:function", help="Your own estimator; repeatable."),
    ] = None

    @property
    def own(self) -> tuple[EstimatorSource, ...]:
        """Read the estimators that were asked for; BenchError as `read_estimators`."""
        return read_estimators(self.estimator or (), self.limits, tuple(MODELS))


def read_estimators(
    texts: Sequence[str], limits: Limits, taken: Sequence[str], flag: str = FLAG
) -> tuple[EstimatorSource, ...]:
    """Read estimators from the command line; each is imported once, in a process apart.

    BenchError when one cannot be imported, lacks its function, or has a name that is taken.

    Args:
        texts: Values of the flag.
        limits: Limits of a call.
        taken: Names that are taken.
        flag: Name of the flag, for messages.

    Returns:
        The estimators.
    """
    estimator_sources = tuple(_read(text, limits, flag) for text in texts)
    names = [estimator_source.name for estimator_source in estimator_sources]
    for name in names:
        if names.count(name) > 1 or name.casefold() in map(str.casefold, taken):
            raise BenchError(f"{flag}: the name {name!r} is taken: put another before it, NAME=...")
    return estimator_sources


def _read(text: str, limits: Limits, flag: str) -> EstimatorSource:
    found = ASKED.fullmatch(text)
    source = found["source"] if found else ""
    if not found or not (source.endswith(SUFFIX) or MODULE.fullmatch(source)):
        raise BenchError(f"{flag}: expected {FORM}, got {text!r}")
    name = found["function"] if found["name"] is None else found["name"]
    if not ESTIMATOR_NAME.fullmatch(name):
        raise BenchError(f"{flag}: expected a name of letters, digits, _ and -, got {name!r}")
    if source.endswith(SUFFIX):
        source = str(Path(source).resolve())
        files.digest(Path(source))  # refuses what is no file
    estimator_source = EstimatorSource(name, source, found["function"], limits)
    try:
        return replace(estimator_source, sha256=files.digest(file_of(estimator_source)))
    except BenchError as err:
        raise BenchError(f"{flag}: {source}: {err}") from err


def digests_of(estimator_sources: Sequence[EstimatorSource]) -> dict[str, dict[str, str]]:
    """Collect SHA-256 of the files of estimators, by the estimator's name, for manifest.json."""
    return {"estimators": {each.name: each.sha256 for each in estimator_sources}} if estimator_sources else {}


Models = Callable[[Cell, Prior | None], list[Model]]


def check_unchanged(estimator_sources: Sequence[EstimatorSource]) -> None:
    """Refuse, by BenchError, a file that is not the one that was asked for."""
    for each in estimator_sources:
        if files.digest(file_of(each)) != each.sha256:
            raise BenchError(f"{FLAG}: {each.source} has changed since the run began")


def estimator_models(estimator_sources: Sequence[EstimatorSource]) -> Models:
    """Return a function that makes their models of a cell and the prior of a trial.

    Raises:
        BenchError: When a file has changed, see `check_unchanged`.
    """
    check_unchanged(estimator_sources)
    return lambda cell, prior: [
        Model(each.name, replace(all153(cell.arm), name=f"own {k}"), UserEstimator(each, prior))
        for k, each in enumerate(estimator_sources, 1)
    ]


@dataclass(frozen=True)
class UserEstimator:
    """Call a user's estimator like any method."""

    own: EstimatorSource
    prior: Prior | None  #: Of the trial; None where there is none.

    def __call__(self, vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        """Its answer, judged as every estimate is; BenchError where it has none."""
        pi = parameters_of(structure, call_estimator(self.own, (vjm, structure, data, self.prior)).values)
        words = f"own estimator {self.own.function}"
        estimate = make_estimate(reduce(vjm, structure, data), pi, method=words, constraint="own")
        check_reach(deflections(vjm, estimate, data), vjm)
        return estimate


def check_reach(moved: Array, vjm: Vjm) -> None:
    """Refuse predictions that no arm can have.

    Args:
        moved: Predicted deflections, (runs, m, 3) [m].
        vjm: The arm.

    Raises:
        BenchError: When one is no number, or longer than the arm reaches.
    """
    most = np.linalg.norm(moved, axis=-1).max()
    if not most <= vjm.reach:
        raise BenchError(f"predicts a deflection of {most:,.0f} m: the arm reaches {vjm.reach:.3g} m")


def parameters_of(structure: Structure, found: Array) -> Array:
    """Read parameters from an answer: they, or compliances (n_theta, n_theta).

    Args:
        structure: The unknowns.
        found: The answer.

    Returns:
        Parameters, (n,).

    Raises:
        BenchError: When it has another shape, has a number that no arm can have, or its compliances are not
            symmetric or have entries that are no unknowns.
    """
    n, size = structure.n_parameters, structure.n_theta
    if found.shape not in ((n,), (size, size)):
        raise BenchError(f"wrong shape: expected ({n},) or ({size}, {size}), got {found.shape}")
    if not np.isfinite(found).all():
        raise BenchError("expected finite numbers, got NaN or infinity")
    if np.abs(found).max() > MAX_COMPLIANCE:
        raise BenchError(f"expected compliances of at most {MAX_COMPLIANCE:g} in SI units, got a larger one")
    if found.ndim == 1:
        return found
    scale = unit_diagonal_scale(found)
    if np.abs((found - found.T) / np.outer(scale, scale)).max() > SYMMETRY_TOLERANCE:
        raise BenchError("not symmetric: expected compliances that are their own transpose")
    rest = np.argwhere((found != 0) & (structure.C_theta_of(np.ones(structure.n_parameters)) == 0))
    if len(rest):
        a, b = rest[0]
        raise BenchError(
            f"expected 0 between {structure.row_labels[a]} and {structure.row_labels[b]}: no unknown there"
        )
    return structure.parameters_of(found)
