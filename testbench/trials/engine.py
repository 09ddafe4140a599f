"""The engine: the trials that a store lacks are done on a backend, and stored as they come."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import islice
from typing import Any

from testbench.errors import BenchError
from testbench.trials.chunk import Backend, Work, WorkersLost
from testbench.trials.local import here
from testbench.trials.store import TrialStore

RETRIES = 3  #: Times in a row that workers may be lost without a single new result.


def run_study(
    work: Work, store: TrialStore[Any], backend: Backend, *, size: int = 1, remote: bool = False
) -> Iterator[int]:
    """Do all trials that are not stored yet; yields how many are, first those from before.

    Results depend on the seeds alone: not on the backend, its workers, the order in which they finish, or on
    where a run was stopped and resumed. (Processors of another kind give other last digits.) See `chunk.Work`
    for what keeps them bit-equal. A chunk has `size` seeds, 0.1 to 1 s of work: a stop loses the chunks under
    way. A study that is one chunk is done by this process, but where the backend is `remote`, which somebody
    asked for; what is left of a larger one is not, as it may be what workers die of.

    Raises:
        BenchError: When a trial cannot be done, the store cannot be written, or workers die again and again.
    """
    if size < 1:
        raise BenchError(f"size: expected chunks of at least 1 seed, got {size}")
    done, lost, every = store.count, 0, len(store.experiment.seeds)
    backend = here if every <= size and not remote else backend
    yield done
    while done < every:
        before = done
        try:
            for done in _attempt(work, store, backend, size):
                yield done
        except WorkersLost as err:
            lost = 1 if done > before else lost + 1
            if lost > RETRIES:
                raise _resumable(f"{err}, {lost} times in a row", store) from err
        except BenchError as err:
            raise _resumable(str(err), store) from err


def _attempt(work: Work, store: TrialStore[Any], backend: Backend, size: int) -> Iterator[int]:
    done = store.count
    with closing(backend(work, _chunks(store.missing(), size))) as chunks:
        for chunk in chunks:
            if chunk.problem:
                raise BenchError(chunk.problem)
            store.append(chunk.seeds, chunk.found)
            done += len(chunk.seeds)
            yield done


def _chunks(seeds: Iterator[int], size: int) -> Iterator[Sequence[int]]:
    while chunk := tuple(islice(seeds, size)):
        yield chunk


def _resumable(problem: str, store: TrialStore[Any]) -> BenchError:
    if not store.count:
        return BenchError(problem)
    held = f"{store.count} of {len(store.experiment.seeds)} trials are stored"
    return BenchError(f"{problem}; {held}, --resume goes on with them")
