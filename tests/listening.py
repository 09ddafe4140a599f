"""Where a process listens."""

from pathlib import Path


def listening(pid):
    """Addresses and ports on which a process listens, as the kernel writes them."""
    inodes = set(map(_inode, Path(f"/proc/{pid}/fd").iterdir()))
    tables = [Path(f"/proc/net/{name}").read_text() for name in ("tcp", "tcp6")]
    rows = [row.split() for table in tables for row in table.splitlines()]
    return [row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes]


def _inode(descriptor):
    """What a descriptor is of; nothing where it was closed meanwhile: so it is none that listens."""
    try:
        return descriptor.readlink().name
    except FileNotFoundError:
        return ""
