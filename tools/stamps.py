"""Inside every picture of the docs: the command that it is of, and the numbers that it was drawn from.

A PNG holds them as a text chunk, a GIF as its comment; both are JSON. `tests/views/test_pictures.py` compares
them with what the docs say today, so that a picture that is older than its numbers is found.
"""

import csv
import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from testbench.errors import InputError

CHUNK = "comment"  #: Key of the text in what Pillow reads of either format.
BLOCK = 255  #: Most bytes of a part of a GIF's comment.


@dataclass(frozen=True)
class Stamp:
    """Where a picture comes from."""

    command: str  #: That made the run.
    numbers: str  #: Answer of the run with its numbers, or `digest` of its tables.


def stamp(picture: Path, own: Stamp) -> None:
    """Write a stamp into a PNG or GIF, in place of one that it has."""
    text = json.dumps(asdict(own))
    if picture.suffix == ".gif":
        picture.write_bytes(_commented(picture.read_bytes(), text.encode()))
        return
    with Image.open(picture) as image:
        image.load()
    info = PngInfo()
    info.add_text(CHUNK, text)
    image.save(picture, pnginfo=info, optimize=True)


def read_stamp(picture: Path) -> Stamp:
    """Read the stamp of a picture.

    Raises:
        InputError: When it has none.
    """
    with Image.open(picture) as image:
        text = image.info.get(CHUNK, "")
    try:
        return Stamp(**json.loads(text))
    except (TypeError, ValueError):
        raise InputError(picture, "", "expected a picture of `make pictures`, with its numbers") from None


def digest(folder: Path) -> str:
    """Give the SHA-256 of the numbers in a folder's CSV files, whatever their order and headings."""
    found = []
    for file in sorted(folder.glob("*.csv")):
        with file.open(encoding="utf-8", newline="") as rows:
            cells = [cell for row in csv.reader(rows) for cell in row]
        found.append([file.name, *sorted(filter(_is_number, cells))])
    return hashlib.sha256(json.dumps(found).encode()).hexdigest()


def _is_number(cell: str) -> bool:
    try:
        float(cell.removesuffix(" %").replace(" x 10^", "e"))
    except ValueError:
        return False
    return True


def _commented(gif: bytes, text: bytes) -> bytes:
    """A GIF with a comment right behind its global colours, where one of before is replaced."""
    colours = 2 << (gif[10] & 7) if gif[10] & 0x80 else 0
    start = 13 + 3 * colours
    rest = gif[start:]
    if rest.startswith(b"\x21\xfe"):
        rest = rest[2 + len(b"".join(_blocks(rest[2:]))) + 1 :]
    parts = (text[k : k + BLOCK] for k in range(0, len(text), BLOCK))
    blocks = b"".join(bytes([len(part)]) + part for part in parts)
    return b"".join([gif[:start], b"\x21\xfe", blocks, b"\0", rest])


def _blocks(data: bytes) -> Iterable[bytes]:
    """Parts of a comment with their lengths, up to the empty one."""
    while size := data[0]:
        yield data[: size + 1]
        data = data[size + 1 :]
