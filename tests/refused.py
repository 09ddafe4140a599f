"""The one line by which a wrong file is refused."""

import pytest

from testbench.errors import InputError, shown


def refused(read, file, *args):
    """What is said of a file: one line of bearable length that begins with the file's name."""
    with pytest.raises(InputError) as info:
        read(file, *args)
    line = str(info.value)
    assert line.startswith(shown(str(file)))
    assert len(line.splitlines()) == 1
    assert len(line) <= 2000
    return line
