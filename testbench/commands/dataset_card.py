"""What the public dataset says of itself: its card, Croissant 1.1 and DataCite.

Words and constants are those of the files in `public_dataset`, so that they stand in one place.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path

from testbench import files
from testbench.campaign.perturbed_prior import PRIORS_CALLED
from testbench.campaign.public_dataset import GRID, SCENARIO
from testbench.campaign.true_arms import CALLED, TRUTHS

Kinds = Mapping[str, Mapping[str, str]]
"""What every column of every table holds, see `trials.tables.kinds`."""
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
        kinds=", ".join(f"`{name}` {CALLED[name]}" for name in TRUTHS),
        errors=", ".join(f"`{name}` {called}" for name, called in PRIORS_CALLED.items()),
        columns=_columns(words, kinds),
    )


def _columns(words: Mapping[str, str], kinds: Kinds) -> str:
    """What columns are, each where it comes first."""
    left, lines = dict(words), []
    for table, own in kinds.items():
        new = [f"`{name}` {left.pop(name)}" for name in map(_first, own) if name in left]
        lines.append(f"**{table}**: {'; '.join(new) or 'as the table before, without noise'}.")
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
