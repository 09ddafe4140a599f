"""The one line by which a wrong file is refused."""

import pytest

from testbench.errors import InputError, printable


def one_line(err, file):
    """What an error says of a file: one line of bearable length that begins with the file's name."""
    line = str(err)
    assert line.startswith(printable(str(file)))
    assert len(line.splitlines()) == 1
    assert len(line) <= 2000
    return line


def refused(read, file, *args):
    """The line by which a file is refused."""
    with pytest.raises(InputError) as info:
        read(file, *args)
    return one_line(info.value, file)
