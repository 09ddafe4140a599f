"""The folder of a model of an arm: model.json and posterior.npz beside the files of the arm.

What is common to all kinds of models: which files, whose arm, what is refused. Checksums find what changed
since a model was written: they detect accidents, not forgery.
"""

import contextlib
import hashlib
import io
import json
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from testbench import files
from testbench.arm.document import Strict
from testbench.arm.folder import Arm, find_arm, load_arm
from testbench.arm.mesh import MAX_BYTES as MESH_BYTES
from testbench.arm.mjcf import assets, read_mjcf
from testbench.campaign.model_document import Document, Head
from testbench.errors import Array, BenchError, InputError, check_array, open_file, read_bytes, read_text
from testbench.identify.arm_model import About
from testbench.model.weights import Weights

DOCUMENT, POSTERIOR, FITS = "model.json", "posterior.npz", "models.json"
ARM = ("rigid.xml", "elastic.toml")  #: Of the arm's folder.
MAX_BYTES, MAX_ROOT = 50_000_000, 300_000_000
MOST_ROWS = 10_000  #: Of an array of posterior.npz, and columns: real ones have some hundreds.
LARGEST_OF_ROOT = 1e100  #: Of posterior.npz: sums of squares are finite.
D = TypeVar("D", bound=Strict)


def copy_arm(arm: Arm, folder: Path) -> dict[str, str]:
    """Copy the files of an arm, meshes among them; SHA-256 of each, by its path."""
    names, own = _arm_files(arm.rigid.parent), arm.rigid.parent
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with open_file(own / name, MESH_BYTES) as source, (folder / name).open("wb") as copy:
            shutil.copyfileobj(source, copy)
    return {name: files.digest(folder / name) for name in names}


def _arm_files(folder: Path) -> tuple[str, ...]:
    """The files of an arm by their paths in its folder: what else lies there is none of ours."""
    rigid = folder / ARM[0]
    return (*ARM, *assets(rigid, read_mjcf(rigid)))


def digests(folders: Iterable[Path]) -> dict[str, dict[str, str]]:
    """SHA-256 of every file of arms, or of models of arms, by the folder's name and the path in it."""
    found = {}
    for folder in folders:
        model = {name: MAX_ROOT for name in (DOCUMENT, POSTERIOR) if (folder / name).is_file()}
        sizes = dict.fromkeys(_arm_files(folder), MESH_BYTES) | model
        found[folder.resolve().name] = {name: files.digest(folder / name, k) for name, k in sizes.items()}
    return found


def read_document(folder: Path, *kinds: type[Document]) -> Document:
    """What model.json says, of one of these kinds; InputError where it has changed since it was written."""
    path = folder / DOCUMENT
    if not path.is_file():
        problem = f"expected the folder of a model, with {DOCUMENT}"
        if (folder / FITS).is_file():
            problem = f"has fits of an earlier version and no {DOCUMENT}: identify again"
        raise InputError(folder, "", problem)
    text = read_text(path, MAX_BYTES)
    head = _valid(Head, text, path)
    kind = next((own for own in kinds if head.kind == own.KIND), None)
    if kind is None:
        expected = " or ".join(f"{own.KIND!r} ({own.COMMAND})" for own in kinds)
        raise InputError(path, "kind", f"expected {expected}, got {head.kind[:80]!r}")
    if head.format not in kind.FORMATS:
        known = " and ".join(map(str, kind.FORMATS))
        problem = f"is a {head.kind} of format {head.format}, this version reads {known}"
        raise InputError(path, "format", problem)
    found = _valid(kind, text, path)
    if found.format >= kind.SEALED or found.checksum is not None:
        _check_sealed(path, text, found.checksum)
    return found


def _check_sealed(path: Path, text: str, said: str | None) -> None:
    """Refuse a model.json of another checksum than it says, or none."""
    if said is None:
        raise InputError(path, "checksum", "expected one, as this format has it")
    try:
        found = _checksum(json.loads(text))
    except (ValueError, RecursionError) as err:
        raise InputError(path, "", f"expected JSON that Python reads: {err}") from err
    if found != said:
        raise InputError(path, "checksum", "the file has changed since the model was written")


def sealed(document: Mapping[str, object], posterior: bytes) -> dict[str, object]:
    """What model.json is to hold, as plain data, with checksums of posterior.npz and of itself."""
    whole = {**document, "posterior": hashlib.sha256(posterior).hexdigest()}
    return {**whole, "checksum": _checksum(whole)}


def _checksum(document: Mapping[str, object]) -> str:
    """SHA-256 of a model.json as one line of JSON, keys sorted, without the checksum itself."""
    own = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(own, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _valid(document: type[D], text: str, path: Path) -> D:
    try:
        return document.model_validate_json(text)
    except ValidationError as err:
        first = err.errors(include_url=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(path, place, f"{first['msg']}, got {str(first.get('input'))[:80]!r}") from err


@contextlib.contextmanager
def numbers_of(folder: Path) -> Iterator[None]:
    """What the block cannot make of the numbers of a model is told as an InputError of its model.json."""
    try:
        yield
    except InputError:
        raise
    except (BenchError, ValueError, IndexError) as err:
        raise InputError(folder / DOCUMENT, "", f"numbers do not belong together: {err}") from err


def read_parts(
    folder: Path, found: Document, arm: str | Path | None
) -> tuple[Arm, Weights, About, tuple[Array, ...]]:
    """Arm, weights, origin and arrays of a model, which must belong to its model.json, and to an `arm`."""
    if arm is not None:
        _check_arm(folder, found, arm)
    _check_same(folder, ARM, found)
    if found.format >= found.SEALED:
        _check_same(folder, assets(folder / ARM[0], read_mjcf(folder / ARM[0])), found)
    own = replace(load_arm(folder), name=found.arm)
    arrays = read_arrays(folder, found)
    with numbers_of(folder):
        if (found.about is None) != (found.format < found.SEALED):
            raise ValueError(f"about: expected from format {found.SEALED} on")
        row, bodies = found.about, own.n_joints + 2
        about = About(found.KIND)
        if row is not None:
            about = About(row.method, row.data, tuple(row.doubts), row.force_N, row.moment_Nm)
        weights = Weights(
            check_array(np.array(found.weights.mass_kg), (bodies,), "mass [kg]"),
            check_array(np.array(found.weights.centre_m), (bodies, 3), "centre [m]"),
        )
    return own, weights, about, arrays


def _check_same(folder: Path, names: Sequence[str], found: Document) -> None:
    for path, said in ((folder / name, found.digests.get(name)) for name in names):
        if not path.is_file() or files.digest(path, MESH_BYTES) != said:
            raise InputError(path, "", "is not the arm of the model; it has changed")


def _check_arm(folder: Path, found: Document, arm: str | Path) -> None:
    """Refuse a model of another arm than one in a folder, or of ours by its name."""
    place = find_arm(arm)
    for name in ARM:
        own = files.digest(place / name, MESH_BYTES) if (place / name).is_file() else "none"
        if own != found.digests.get(name):
            digests = f"{name}: digest {str(found.digests.get(name))[:12]}, that of {place} has {own[:12]}"
            raise InputError(folder, "", f"is a model of another arm, {found.arm} ({digests})")


def write_parts(
    kind: type[Document], arm: Arm, weights: Weights, said: Mapping[str, object], folder: Path, **own: Array
) -> None:
    """Copy an arm's files, write arrays as posterior.npz, and what is said as model.json with checksums."""
    said = {"format": kind.FORMATS[-1], "kind": kind.KIND, "arm": arm.name, **said}
    said["weights"] = {"mass_kg": weights.mass.tolist(), "centre_m": weights.centre.tolist()}
    document = kind.model_validate({"digests": copy_arm(arm, folder), **said})
    np.savez_compressed(folder / POSTERIOR, **own)  # type: ignore[arg-type]  # stubs: allow_pickle
    whole = sealed(document.model_dump(), (folder / POSTERIOR).read_bytes())
    files.write_json(whole, folder / DOCUMENT)


def about_said(method: str, data: Mapping[str, str], doubts: Sequence[str], loads: Array) -> object:
    """Where a model comes from, under which loads about the tool's origin, (rows, 6) [N, N m]."""
    force, moment = np.linalg.norm(loads.reshape(-1, 2, 3), axis=2).max(axis=0).tolist()
    return {
        "method": method,
        "data": dict(data),
        "doubts": list(doubts),
        "force_N": force,
        "moment_Nm": moment,
        "versions": files.versions(),
    }


def read_arrays(folder: Path, found: Document) -> tuple[Array, ...]:
    """Arrays of posterior.npz, of any size, finite; InputError where it is not what the command wrote."""
    raw = read_bytes(path := folder / POSTERIOR, MAX_ROOT)
    if found.posterior not in (None, hashlib.sha256(raw).hexdigest()):
        raise InputError(path, "", "has changed since the model was written")
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
            for entry in packed.infolist():
                _check_rows(packed, entry.filename)
        if size > MAX_ROOT:
            raise BenchError(f"at most {MAX_ROOT} bytes when unpacked, got {size}")
        with np.load(io.BytesIO(raw), allow_pickle=False) as data:
            return tuple(_numbers(data[name], name) for name in found.ARRAYS)
    except (
        Exception
    ) as err:  # of bytes that are no such file numpy, zipfile and lzma raise errors of 15 kinds
        raise InputError(path, "", f"expected the posterior of a model: {err}") from err


def _check_rows(packed: zipfile.ZipFile, name: str) -> None:
    """Refuse an array of more rows than any has before it is unpacked."""
    with packed.open(name) as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise BenchError(f"{name}: expected an array of NumPy's format 1.0")
        shape, _, _ = np.lib.format.read_array_header_1_0(file)
    if max(shape, default=0) > MOST_ROWS:
        raise BenchError(f"{name}: expected at most {MOST_ROWS} rows and columns, got {shape}")


def _numbers(array: npt.NDArray[np.generic], name: str) -> Array:
    if array.dtype != np.float64:
        raise BenchError(f"{name}: expected numbers of double precision, got {array.dtype}")
    found = check_array(array, (None,) * array.ndim, name)
    if np.abs(found).max(initial=0.0) > LARGEST_OF_ROOT:
        raise BenchError(f"{name}: expected numbers up to {LARGEST_OF_ROOT:g}")
    return found
