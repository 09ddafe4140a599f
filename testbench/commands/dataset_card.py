"""What the public dataset says of itself: its card, Croissant 1.1 and DataCite."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from testbench import files
from testbench.campaign.perturbed_prior import PRIORS_CALLED, SCALE, SHAPE
from testbench.campaign.public_dataset import ARM, GRID, SCENARIO, TURNS
from testbench.campaign.true_arms import CALLED, TRUTHS

Kinds = Mapping[str, Mapping[str, str]]
"""What every column of every table holds, see `trials.tables.kinds`."""
VERSION, PUBLISHED = "1.0.0", "2026-11-28"
LICENCE, LICENCE_URL = "CC-BY-4.0", "https://creativecommons.org/licenses/by/4.0/"
AUTHORS = "the testbench authors"
NAME = "testbench-stiffness-calibration"
TITLE = "Stiffness calibration of a heavy robot arm: simulated campaigns"
ABOUT = (
    "Simulated calibrations of a KUKA KR 500 L480 class arm under a hung weight: readings of three markers "
    "before and after loading, a wrong prior, and apart from these the true deflections and compliances."
)
MEANINGS = {
    "campaign": "its number from 0",
    "arm": "number of the true arm",
    "split": "train, dev or test",
    "seed": "of poses, noise and prior",
    "prior_links": "6x6 compliance of each link by rows (beam frame; m/N, rad/(N m))",
    "prior_joints": "compliance of each joint (rad/(N m))",
    "set": "identification, check or workspace",
    "run": "run of the campaign",
    "pose": "pose of the campaign",
    "marker": "its name",
    "force_x_N": "load (world axes)",
    "moment_x_Nm": "its moment",
    "point_x_m": "where it acts (tool's frame)",
    "before_x_m": "marker unloaded (world axes)",
    "after_x_m": "marker loaded",
    "sigma_m": "standard deviation of a reading along an axis",
    "true_arm": "kind of the true arm",
    "prior_error": "what is wrong with the prior",
    "links": "true compliance of each link",
    "joints": "true compliance of each joint",
}
"""Of every column; of three axes the first."""
TYPES = {"int64": "sc:Integer", "double": "cr:Float64", "string": "sc:Text"}
CARD = """\
# {title}

{about}

{count} campaigns, each of {runs} runs in {poses} poses under {payload:g} kg, read with {sigma:g} um.
Licence [{licence}]({url}), authors: {authors}, version {version}, generator commit {commit}:
`testbench dataset build DIR --campaigns {count} --seed {seed}`

**Task.** From identification runs and prior of a campaign predict its deflections in `workspace` poses.
Of `arms/{arm}` use the kinematics: its compliances are nominal. Nothing may read the `truth_` files.

**Grid.** {rounds} of each kind of true arm with each error of the prior; {priors} campaigns share an arm.
Splits are by arm, of each kind {train} % train, {dev} % dev, {test} % test. `tubes` is one arm, in train.
True arms: {kinds}.
Priors, all but the first also {scale:g} times too soft and {shape:.0f} % off axis by axis: {errors}.

**Limits.** MuJoCo settles the arm, nobody measured it. No joint has backlash or friction; no own weight.

`manifest.json` has the SHA-256 of every file.

{columns}
"""
CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "sc": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "description": {"@container": "@language"},
    **{
        name: f"cr:{name}"
        for name in (
            "arrayShape citeAs column containedIn equivalentProperty extract field fileProperty fileObject "
            "fileSet format includes isArray isLiveDataset jsonPath key md5 parentField path recordSet "
            "references regex repeated replace samplingRate separator source subField transform"
        ).split()
    },
}
"""The context of Croissant 1.1."""


def card(kinds: Kinds, seeds: range) -> str:
    """README.md."""
    return CARD.format(
        title=TITLE,
        about=ABOUT,
        count=len(seeds),
        runs=SCENARIO.identification_runs + SCENARIO.check_runs,
        poses=SCENARIO.identification_poses + SCENARIO.check_poses,
        payload=SCENARIO.mass,
        sigma=1e6 * SCENARIO.sigma,
        licence=LICENCE,
        url=LICENCE_URL,
        authors=AUTHORS,
        version=VERSION,
        commit=files.git_commit(files.ROOT),
        seed=seeds[0],
        arm=ARM,
        rounds=len(seeds) // GRID,
        priors=len(PRIORS_CALLED),
        kinds=", ".join(f"`{name}` {CALLED[name]}" for name in TRUTHS),
        scale=SCALE,
        shape=100 * SHAPE,
        errors=", ".join(f"`{name}` {words}" for name, words in PRIORS_CALLED.items()),
        columns=_columns(kinds),
        **{name: 100 * TURNS.count(name) // len(TURNS) for name in TURNS},
    )


def _columns(kinds: Kinds) -> str:
    """The columns of every table, of several joints or axes the first, and what new ones are."""
    said: set[str] = set()
    lines = []
    for table, own in kinds.items():
        names = dict.fromkeys(map(_first, own))
        words = [f"`{name}`" if name in said else f"`{name}` {_meaning(name)}" for name in names]
        lines.append(f"**{table}**: {', '.join(words)}.")
        said |= {*names}
    return "\n\n".join(lines)


def _first(column: str) -> str:
    """The column of the first axis, or joint, of the same quantity."""
    return re.sub("_[xyz]_", "_x_", re.sub("^joint_[0-9]+", "joint_1", column))


def _meaning(column: str) -> str:
    return MEANINGS.get(_first(column), "joint angle")


def croissant(folder: Path, kinds: Kinds) -> dict[str, object]:
    """croissant.json, of all files that the folder has."""
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": NAME,
        "description": ABOUT,
        "license": LICENCE_URL,
        "creator": {"@type": "sc:Organization", "name": AUTHORS},
        "publisher": {"@type": "sc:Organization", "name": AUTHORS},
        "datePublished": PUBLISHED,
        "version": VERSION,
        "citeAs": f"{AUTHORS}: {TITLE}, version {VERSION}.",
        "distribution": [_file(folder, name) for name in files.inside(folder)],
        "recordSet": [_records(name, own) for name, own in kinds.items()],
    }


def _file(folder: Path, name: str) -> dict[str, object]:
    types = {".parquet": "application/x-parquet", ".md": "text/markdown", ".json": "application/json"}
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "contentSize": f"{(folder / name).stat().st_size} B",
        "encodingFormat": types.get(Path(name).suffix, "text/plain"),
        "sha256": files.digest(folder / name),
    }


def _records(table: str, kinds: Mapping[str, str]) -> dict[str, object]:
    name = table.removesuffix(".parquet")
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "field": [dict(_field(table, name, column, kind)) for column, kind in kinds.items()],
    }


def _field(table: str, records: str, column: str, kind: str) -> Iterator[tuple[str, object]]:
    several = kind.startswith("list")
    yield from {"@type": "cr:Field", "@id": f"{records}/{column}", "name": column}.items()
    yield "description", _meaning(column)
    yield "dataType", TYPES["double" if several else kind]
    if several:
        yield from {"isArray": True, "arrayShape": "-1"}.items()
    yield "source", {"fileObject": {"@id": table}, "extract": {"column": column}}


def datacite(folder: Path) -> dict[str, object]:
    """datacite.json, schema 4.5, without a DOI."""
    sizes = [(folder / name).stat().st_size for name in files.inside(folder)]
    return {
        "schemaVersion": "http://datacite.org/schema/kernel-4",
        "creators": [{"name": AUTHORS, "nameType": "Organizational"}],
        "titles": [{"title": TITLE, "lang": "en"}],
        "publisher": {"name": AUTHORS},
        "publicationYear": PUBLISHED[:4],
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "Simulated measurements"},
        "subjects": [{"subject": text} for text in ("robot calibration", "stiffness", "compliance")],
        "language": "en",
        "version": VERSION,
        "formats": ["application/x-parquet"],
        "sizes": [f"{sum(sizes)} B"],
        "rightsList": [{"rightsIdentifier": LICENCE, "rightsUri": LICENCE_URL}],
        "descriptions": [{"description": ABOUT, "descriptionType": "Abstract", "lang": "en"}],
    }
