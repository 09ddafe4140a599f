"""The arm's folder of a stranger's robot: rigid.xml, elastic.toml and meshes."""

from dataclasses import replace
from pathlib import Path

from testbench.plant.import_robot.chain import Chain
from testbench.plant.import_robot.propose import propose
from testbench.plant.import_robot.surface import surfaces
from testbench.plant.import_robot.touching import always_touching
from testbench.plant.import_robot.wishes import Wishes
from testbench.plant.import_robot.write import rigid_mjcf


def write_arm(chain: Chain, wishes: Wishes, folder: Path) -> tuple[str, ...]:
    """Write everything of an arm's folder.

    Args:
        chain: The robot, as its file has it.
        wishes: What the engineer said of it.
        folder: An empty one.

    Returns:
        What was understood and done, a sentence each; rigid.xml says it too.

    Raises:
        BenchError: When MuJoCo refuses the arm.
        OSError: When the folder cannot be written.
    """
    proposal, looks = propose(chain, wishes), [surfaces(part) for part in chain.parts]
    rigid = rigid_mjcf(chain, looks, proposal)
    touching = always_touching(chain, rigid)
    if touching:
        pairs = ", ".join(f"{one} and {other}" for one, other in touching)
        note = f"hulls that touch in most poses, so their collisions do not count: {pairs}"
        chain = replace(chain, notes=(*chain.notes, note))
        rigid = rigid_mjcf(chain, looks, proposal, touching)
    (folder / "rigid.xml").write_text(rigid.xml, encoding="utf-8")
    (folder / "elastic.toml").write_text(proposal.elastic, encoding="utf-8")
    if rigid.meshes:
        (folder / "meshes").mkdir()
    for name, data in rigid.meshes.items():
        (folder / "meshes" / name).write_bytes(data)
    return chain.notes
