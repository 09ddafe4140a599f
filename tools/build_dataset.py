"""Build the public dataset of simulated campaigns: readings, truth, card, Croissant 1.1 and DataCite.

    python tools/build_dataset.py DIR [--campaigns 3600] [--seed 100000] [--workers N] [--force]

In a round there is one campaign for each kind of true arm in FAMILY_TRUE_ARMS and error of a prior in PRIORS.
An arm is measured once with each prior, in other poses and with other noise. The campaign with number k has
seed root + k, and the true arm has that of its first campaign.

The same seed gives the same bytes, whatever the number of workers. All files or none are written. The texts
of card and metadata are in `tools/public_dataset`.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from testbench.arm.folder import find_arm, load_arm
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.files.write import columns
from testbench.plant.true_arms import FAMILY_TRUE_ARMS
from testbench.report.schema import KNOWN, TRUE_ARM_LABELS
from testbench.runs import manifest as files
from testbench.runs.engine import Chunks, on_cores
from testbench.runs.manifest import digests
from testbench.runs.whole import claim_folder, whole_folder
from testbench.studies.run import show_progress
from testbench.workflows.arm_models import copy_arm
from testbench.workflows.campaign import draw_poses, simulate_at, true_cell
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.load_dataset import (
    ARM,
    ARMS,
    CAMPAIGNS,
    DEFLECTIONS,
    READINGS,
    SCENARIO,
    TABLES,
    Cells,
)
from testbench.workflows.models import PRIORS, prior_of

COMMAND = "tools/build_dataset.py"
FOLDER = "tubes"  #: The kind that is the folder's own arm, the same for every seed: one arm, in one split.
GRID = len(FAMILY_TRUE_ARMS) * len(PRIORS)  #: Campaigns of a round.
ROUNDS = 100
TURNS = ("train", "dev", "test", *["train"] * 2, "test", *["train"] * 4)
"""The splits that arms of a kind are in, in turn."""
GROUP = 2**16  #: Rows of a row group.

Row = dict[str, dict[str, Cells]]
"""Of one campaign what stands in every table, by table and column."""


def build(out: Path, seeds: range, workers: int | None = None, *, force: bool = False) -> None:
    """Simulate one campaign per seed and write the folder.

    Args:
        out: Folder of the dataset.
        seeds: Of the campaigns, a multiple of the kinds of arms times the errors of the prior.
        workers: Processes; None for one per core.
        force: Whether a folder with other files may be replaced.

    Raises:
        BenchError: When seeds are no whole number of rounds, or the folder cannot be written.
    """
    rounds = range(len(seeds) // GRID)
    if not seeds or len(seeds) % GRID:
        problem = f"expected a multiple of {GRID}, kinds of arm times errors of prior"
        raise BenchError(f"--campaigns: {problem}, got {len(seeds)}")
    with (
        claim_folder(out, COMMAND, own=frozenset(), force=force),
        whole_folder(out) as folder,
        TemporaryDirectory() as parts,
    ):
        work = partial(write_rounds, seeds[0], parts)
        chunks = on_cores(work, [[k] for k in rounds], workers=workers)
        show_progress(_counted(chunks), len(rounds), "rounds", kept=False)
        for name in TABLES:
            join_tables([Path(parts, str(k), name) for k in rounds], folder / name)
        home = folder / "arms" / ARM
        home.mkdir(parents=True)
        copy_arm(load_arm(find_arm(ARM)), home)
        describe(folder, {name: kinds(folder / name) for name in TABLES}, seeds)
        scenario = SCENARIO.model_dump(mode="json")
        files.write_manifest(folder, command=COMMAND, scenario=scenario, seeds=seeds, models=digests([home]))


def _counted(chunks: Chunks) -> Iterator[int]:
    """How many are done; BenchError for one that cannot be done."""
    yield 0
    for k, chunk in enumerate(chunks, 1):
        if chunk.problem:
            raise BenchError(chunk.problem)
        yield k


def kind_of(first: int) -> str:
    """Return the true arm whose campaigns begin with this one, a multiple of the number of priors."""
    return list(FAMILY_TRUE_ARMS)[first % GRID // len(PRIORS)]


def split_of(first: int) -> str:
    """Return what all campaigns of an arm are for; kinds are not all in the same turn of a round."""
    turn = 0 if kind_of(first) == FOLDER else first // GRID + first % GRID // len(PRIORS)
    return TURNS[turn % len(TURNS)]


def write_rounds(root: int, folder: str, rounds: Sequence[int]) -> list[list[object]]:
    """Simulate some rounds, each into tables of a folder of its own; see `runs.engine.Work`.

    Args:
        root: Seed of all randomness.
        folder: Folder of the tables.
        rounds: Numbers of the rounds.

    Returns:
        No rows.
    """
    cell = build_cell(ARM)
    for k in rounds:
        arms = range(GRID * k, GRID * (k + 1), len(PRIORS))
        path, rows = Path(folder) / str(k), [row for first in arms for row in _rows(cell, first, root)]
        path.mkdir()
        for name in TABLES:
            write_table(path / name, _joined([row[name] for row in rows]))
    return [[] for _ in rounds]


def _joined(tables: Sequence[Mapping[str, Cells]]) -> dict[str, Cells]:
    return {name: np.concatenate([own[name] for own in tables]) for name in tables[0]}


def _rows(cell: Cell, first: int, root: int) -> Iterator[Row]:
    """All campaigns of an arm: what is known of each, and apart from that what is true."""
    kind = kind_of(first)
    true = true_cell(cell, kind, root + first)
    for number, error in enumerate(PRIORS, first):
        seed = root + number
        campaign = simulate_at(true, SCENARIO, seed, draw_poses(cell, SCENARIO, seed))
        head = {"campaign": number, "split": split_of(first)}
        about = _repeated(1, head | {"arm": 0 if kind == FOLDER else first, "seed": seed})
        yield {
            CAMPAIGNS: about | _compliance_cells(cell, prior_of(cell, error, seed).C_theta, "prior_"),
            READINGS: _points(
                cell, head, {"identification": campaign.identification, "check": campaign.check}
            ),
            DEFLECTIONS: _points(cell, head, {"check": campaign.check_true, "workspace": campaign.truth}),
            ARMS: about
            | _repeated(1, {"true_arm": kind, "prior_error": error})
            | _compliance_cells(cell, true.plant.arm.C_theta, ""),
        }


def _repeated(rows: int, values: Mapping[str, object]) -> dict[str, Cells]:
    return {name: np.array([value] * rows) for name, value in values.items()}


def _compliance_cells(cell: Cell, C: Array, prefix: str) -> dict[str, Cells]:
    """Of all links in their beam frames, row by row, and of all joints, a row each."""
    k, n = range(len(cell.arm.links)), 6 * len(cell.arm.links)
    links = C[:n, :n].reshape(len(k), 6, len(k), 6)[k, :, k]
    return {f"{prefix}links": links.reshape(1, -1), f"{prefix}joints": np.diag(C)[None, n:]}


def _points(cell: Cell, head: Mapping[str, object], sets: Mapping[str, Dataset]) -> dict[str, Cells]:
    """A row a marker of a run, in the columns of dataset.csv, of some sets of runs."""
    return _joined(
        [
            _repeated(data.n_points, {**head, "set": name})
            | {key: np.asarray(cells) for key, cells in columns(data, cell.arm).items()}
            for name, data in sets.items()
        ]
    )


def write_table(path: Path, columns: Mapping[str, Cells | Sequence[str]]) -> None:
    """Write columns by name; of an array (rows, n) each cell is a list.

    Args:
        path: Path of the file.
        columns: Columns by name, of equal length.
    """
    cells = {name: list(own) if np.ndim(own) > 1 else own for name, own in columns.items()}
    _write(path, pa.table(cells))


def join_tables(parts: Sequence[Path], path: Path) -> None:
    """Write the rows of several tables one behind the other; the same rows give the same bytes.

    Args:
        parts: Files of the tables.
        path: File of the whole.
    """
    _write(path, pa.concat_tables(parquet.read_table(part, memory_map=True) for part in parts))


def _write(path: Path, table: pa.Table) -> None:
    parquet.write_table(table.combine_chunks(), path, compression="zstd", row_group_size=GROUP)


def kinds(path: Path) -> dict[str, str]:
    """Name what each column of a table holds, in Arrow's words: int64, string, list<element: double>."""
    return {field.name: str(field.type) for field in parquet.read_schema(path)}


Kinds = Mapping[str, Mapping[str, str]]
"""What every column of every table holds, see `kinds`."""
HERE = Path(__file__).with_name("public_dataset")
TYPES = {"int64": "sc:Integer", "double": "cr:Float64", "string": "sc:Text"}
MEDIA = {".parquet": "application/x-parquet", ".md": "text/markdown", ".json": "application/json"}


def describe(folder: Path, kinds: Kinds, seeds: range) -> None:
    """Write README.md, datacite.json and croissant.json beside the tables."""
    words: dict[str, str] = json.loads(_text("columns.json"))
    (folder / "README.md").write_text(_card(words, kinds, seeds), encoding="utf-8")
    (folder / "datacite.json").write_text(_text("datacite.json"), encoding="utf-8")
    croissant = {
        **json.loads(_text("croissant.json")),
        "distribution": [_file(folder, name) for name in files.inside(folder)],
        "recordSet": [_records(table, own, words) for table, own in kinds.items()],
    }
    files.write_json(croissant, folder / "croissant.json")


def _text(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")


def _card(words: Mapping[str, str], kinds: Kinds, seeds: range) -> str:
    return _text("card.md").format(
        scenario=SCENARIO,
        count=len(seeds),
        seed=seeds[0],
        commit=files.git_commit(files.ROOT),
        rounds=len(seeds) // GRID,
        kinds=", ".join(f"`{name}` ({TRUE_ARM_LABELS[name]})" for name in FAMILY_TRUE_ARMS),
        errors=", ".join(f"`{name}` ({called})" for name, called in KNOWN["prior_error"].called.items()),
        columns=_columns(words, kinds),
    )


def _columns(words: Mapping[str, str], kinds: Kinds) -> str:
    """What columns are, each where it comes first."""
    left, lines = dict(words), []
    for table, own in kinds.items():
        new = [f"`{name}`: {left.pop(name)}" for name in map(_first, own) if name in left]
        lines.append(f"**{table}** has {'; '.join(new) or 'the columns of the table before, without noise'}.")
    return "\n\n".join(lines)


def _first(column: str) -> str:
    """The column of the first joint or axis of the same quantity."""
    return re.sub("_[xyz]_", "_x_", re.sub("^joint_[0-9]+", "joint_1", column))


def _file(folder: Path, name: str) -> dict[str, object]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "contentSize": f"{(folder / name).stat().st_size} B",
        "encodingFormat": MEDIA.get(Path(name).suffix, "text/plain"),
        "sha256": files.digest(folder / name),
    }


def _records(table: str, kinds: Mapping[str, str], words: Mapping[str, str]) -> dict[str, object]:
    name = table.removesuffix(".parquet")
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"{name}/{column}",
            "name": column,
            "description": words[_first(column)],
            "dataType": TYPES.get(kind, TYPES["double"]),
            **({} if kind in TYPES else {"isArray": True, "arrayShape": "-1"}),
            "source": {"fileObject": {"@id": table}, "extract": {"column": column}},
        }
        for column, kind in kinds.items()
    ]
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields}


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path, metavar="DIR")
    parser.add_argument("--campaigns", type=int, default=GRID * ROUNDS, help=f"a multiple of {GRID}")
    parser.add_argument("--seed", type=int, default=100_000, help="of the first campaign")
    parser.add_argument("--workers", type=int, help="processes; default: one per core")
    parser.add_argument("--force", action="store_true", help="replace a folder with other files")
    asked = parser.parse_args()
    seeds = range(asked.seed, asked.seed + asked.campaigns)
    try:
        build(asked.out, seeds, asked.workers, force=asked.force)
    except BenchError as err:
        sys.exit(f"error: {err}")
    print(f"{asked.out}: {len(seeds)} campaigns; README.md says what is in it")


if __name__ == "__main__":
    main()
