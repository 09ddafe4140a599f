"""Independent trials of a study on several processes, in order, whatever their number."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config

from testbench.errors import BenchError

T = TypeVar("T")


def run_trials(
    study: Callable[[Sequence[int]], list[T]],
    seeds: Sequence[int],
    *,
    workers: int | None = None,
    size: int = 1,
) -> Iterator[list[T]]:
    """Results of a study on chunks of seeds, in the order of the seeds, each as soon as it is there.

    Args:
        study: Does a chunk of seeds; a module's function or a partial of one. What several seeds share, such
            as an arm, it builds once a chunk.
        seeds: One root of randomness a trial.
        workers: Processes, each with one BLAS thread; None for one a core.
        size: Seeds of a chunk.

    Raises:
        BenchError: When workers or size is below 1.
    """
    if (workers is not None and workers < 1) or size < 1:
        raise BenchError(f"workers: expected at least 1 and chunks of at least 1, got {workers}, {size}")
    chunks = [seeds[k : k + size] for k in range(0, len(seeds), size)]
    processes = min(len(chunks), workers or cpu_count())
    with parallel_config(backend="loky", inner_max_num_threads=1):
        results: Iterable[list[T]] = Parallel(n_jobs=processes, return_as="generator")(
            delayed(study)(chunk) for chunk in chunks
        )
        yield from results
