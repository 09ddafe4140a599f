"""Numbers of a prototype of this project, on the same UR10; nobody has published such a ladder of one arm."""

from dataclasses import dataclass

from testbench.studies.real_ur10.ladder import GEOMETRY, JOINTS, WAVES


@dataclass(frozen=True)
class Known:
    """A mean position error of the prototype."""

    model: str
    trained: str  #: What trained it.
    judged: str  #: Series that judged it, 50 of its poses for frame and target; C: poses of the same series.
    mean_mm: float
    poses: int | None = None  #: Poses of C that trained it, and nothing else; None where other series did.


THREE = "B, D and {}, all rows"
KNOWN = (
    Known(GEOMETRY.name, THREE.format("C"), "A", 0.472),
    Known(JOINTS.name, THREE.format("C"), "A", 0.439),
    Known(WAVES.name, THREE.format("C"), "A", 0.109),
    Known(GEOMETRY.name, THREE.format("A"), "C", 0.541),
    Known(JOINTS.name, THREE.format("A"), "C", 0.459),
    Known(WAVES.name, THREE.format("A"), "C", 0.372),
    Known(JOINTS.name, "1000 poses of C", "A", 0.535, 1000),
    Known(WAVES.name, "1000 poses of C", "A", 0.404, 1000),
    Known(WAVES.name, "50 poses of C", "C", 0.218, 50),
    Known(WAVES.name, "100 poses of C", "C", 0.159, 100),
    Known(WAVES.name, "200 poses of C", "C", 0.113, 200),
    Known(WAVES.name, "1000 poses of C", "C", 0.088, 1000),
)
