"""Checksums of a model: what changed since it was written is found. They detect accidents, not forgery."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from testbench.errors import InputError

CHECKSUM = "checksum"  #: The field of model.json that the checksum leaves out.


def sealed(document: Mapping[str, object], posterior: bytes) -> dict[str, object]:
    """What model.json is to hold, as plain data, with checksums of posterior.npz and of itself."""
    whole = {**document, "posterior": hashlib.sha256(posterior).hexdigest()}
    return {**whole, CHECKSUM: checksum(whole)}


def checksum(document: Mapping[str, object]) -> str:
    """SHA-256 of a model.json as one line of JSON, keys sorted, without the checksum itself."""
    own = {key: value for key, value in document.items() if key != CHECKSUM}
    return hashlib.sha256(json.dumps(own, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def check_document(path: Path, text: str, said: str | None) -> None:
    """Refuse a model.json of another checksum than it says, or none.

    Raises:
        InputError: Names the file.
    """
    if said is None:
        raise InputError(path, CHECKSUM, "expected one, as this format has it")
    try:
        found = checksum(json.loads(text))
    except (ValueError, RecursionError) as err:
        raise InputError(path, "", f"expected JSON that Python reads: {err}") from err
    if found != said:
        raise InputError(path, CHECKSUM, "the file has changed since the model was written")


def check_posterior(path: Path, raw: bytes, said: str | None) -> None:
    """Refuse a posterior.npz of another checksum than model.json says; None asks nothing.

    Raises:
        InputError: Names the file.
    """
    if said is not None and hashlib.sha256(raw).hexdigest() != said:
        raise InputError(path, "", "has changed since the model was written")
