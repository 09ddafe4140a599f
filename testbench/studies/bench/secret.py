"""Seeds that nobody knew: drawn from a secret, committed to by its SHA-256 before entries are read."""

import hashlib
import re
import secrets
from pathlib import Path

from testbench.errors import InputError
from testbench.output.whole import write_whole

SECRET = re.compile(r"[0-9a-f]{64}")


def kept_secret(file: Path) -> str:
    """The secret in a file, drawn where there is none; its commitment beside it, for `sha256sum -c`."""
    if not file.exists():
        new = secrets.token_hex(32)
        write_whole(f"{commitment(new)}  {file.name}\n", file.with_name(f"{file.name}.sha256"))
        write_whole(new, file)
    text = file.read_text(encoding="ascii", errors="replace")
    if not SECRET.fullmatch(text):
        raise InputError(file, "", "expected a secret of `testbench bench --judge`: 64 hexadecimal digits")
    return text


def commitment(secret: str) -> str:
    """What a secret is committed to by."""
    return hashlib.sha256(secret.encode("ascii")).hexdigest()


def first_seed(secret: str) -> int:
    """The first of the seeds, from 2^32 up: none of them is public."""
    return 2**32 + int(hashlib.sha256(f"seeds {secret}".encode("ascii")).hexdigest()[:15], 16)
