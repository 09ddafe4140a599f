"""The folder of a check of data: picture and recording, all of it or nothing."""

from pathlib import Path

from testbench import files
from testbench.bench.campaign import Cell
from testbench.bench.understood import Understood
from testbench.identify.registered import Registered
from testbench.output.run import whole_folder

COMMAND = "testbench data check"  #: As manifest.json names it.


def write(cell: Cell, name: str, found: Understood, registered: Registered, out: Path) -> None:
    """data.png, recording.rrd and manifest.json of a file; InputError when they cannot be written."""
    from testbench.views.data.figure import picture  # importing matplotlib and rerun takes two thirds
    from testbench.views.recording.data import write_data  # of a second

    with whole_folder(out) as folder:
        picture(cell, name, found, registered.data).savefig(folder / "data.png")
        write_data(folder / "recording.rrd", cell, name, found, registered)
        arms = [cell.arm.rigid.parent]
        files.write_manifest(folder, command=COMMAND, scenario={"data": name}, seeds=range(0), arms=arms)
