"""Models of an arm by their folders, of either kind."""

from pathlib import Path

from testbench.bench.absolute_model import CALIBRATION, read_whole
from testbench.bench.model_folder import check_arm, read_document
from testbench.bench.stiffness_model import STIFFNESS, read_stiffness
from testbench.correct.arm_model import ArmModel, of_calibration
from testbench.output.replace import reading

KINDS = {kind.name: kind for kind in (STIFFNESS, CALIBRATION)}


def load_model(folder: str | Path, arm: str | Path | None = None) -> ArmModel:
    """Read a model that `testbench identify` or `testbench calibrate` wrote.

    Args:
        folder: Holds model.json, posterior.npz and the arm's files.
        arm: Folder of the arm that it must be a model of, or the name of one that comes with testbench; None
            for any.

    Returns:
        The arm as it was identified.

    Raises:
        InputError: When the folder holds none, one of a later version, one that was changed by hand, or one
            of another arm.
    """
    folder = Path(folder)
    with reading(folder):
        found = read_document(folder, KINDS)
        if arm is not None:
            check_arm(folder, found, arm)
        if found.kind == STIFFNESS.name:
            return read_stiffness(folder, found)
        return of_calibration(*read_whole(folder, found))
