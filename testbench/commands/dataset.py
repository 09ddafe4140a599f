"""testbench dataset build: the public dataset, its card and its metadata, all or nothing."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from rich.console import Console

from testbench import files
from testbench.arm.folder import find_arm, load_arm
from testbench.campaign.model_folder import copy_arm, digests
from testbench.campaign.public_dataset import ARM, GRID, SCENARIO, TABLES, write_rounds
from testbench.commands.dataset_card import describe
from testbench.errors import BenchError
from testbench.output.place import claim_folder, whole_folder
from testbench.output.whole import temporary_folder
from testbench.shell.trials import show_progress
from testbench.trials.engine import Chunks
from testbench.trials.local import on_cores
from testbench.trials.tables import join_tables, kinds

COMMAND = "testbench dataset build"


def build(out: Path, seeds: range, workers: int | None, console: Console, *, force: bool) -> None:
    """Simulate a campaign a seed and write the folder.

    Raises:
        BenchError: When seeds are no whole number of rounds, or the folder cannot be written.
    """
    rounds = range(len(seeds) // GRID)
    if len(seeds) % GRID:
        problem = f"expected a multiple of {GRID}, kinds of arm times errors of prior"
        raise BenchError(f"--campaigns: {problem}, got {len(seeds)}")
    with (
        claim_folder(out, COMMAND, own=frozenset(), force=force),
        whole_folder(out) as folder,
        temporary_folder() as parts,
    ):
        work = partial(write_rounds, seeds[0], str(parts))
        chunks = on_cores(work, ([k] for k in rounds), workers=workers)
        show_progress(_counted(chunks), len(rounds), "rounds", kept=False)
        for name in TABLES:
            join_tables([parts / str(k) / name for k in rounds], folder / name)
        home = folder / "arms" / ARM
        home.mkdir(parents=True)
        copy_arm(load_arm(find_arm(ARM)), home)
        describe(folder, {name: kinds(folder / name) for name in TABLES}, seeds)
        scenario = SCENARIO.model_dump(mode="json")
        files.write_manifest(folder, command=COMMAND, scenario=scenario, seeds=seeds, models=digests([home]))
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    text = f"{out}: {len(seeds)} campaigns, {size / 1e6:.1f} MB; README.md says what is in it"
    console.print(text, soft_wrap=True)


def _counted(chunks: Chunks) -> Iterator[int]:
    """How many are done; BenchError for one that cannot be done."""
    yield 0
    for k, chunk in enumerate(chunks, 1):
        if chunk.problem:
            raise BenchError(chunk.problem)
        yield k
