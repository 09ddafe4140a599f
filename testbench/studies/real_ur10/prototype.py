"""Numbers of a prototype of this project, on the same UR10; nobody has published such a ladder of one arm."""

from collections.abc import Sequence

from testbench.report.table import Row
from testbench.studies.real_ur10.ladder import GEOMETRY, JOINTS, WAVES

THREE = "B, D and {}, all rows"
KNOWN: tuple[tuple[str, str, str, float, int | None], ...] = (
    (GEOMETRY.name, THREE.format("C"), "A", 0.472, None),
    (JOINTS.name, THREE.format("C"), "A", 0.439, None),
    (WAVES.name, THREE.format("C"), "A", 0.109, None),
    (GEOMETRY.name, THREE.format("A"), "C", 0.541, None),
    (JOINTS.name, THREE.format("A"), "C", 0.459, None),
    (WAVES.name, THREE.format("A"), "C", 0.372, None),
    (JOINTS.name, "1000 poses of C", "A", 0.535, 1000),
    (WAVES.name, "1000 poses of C", "A", 0.404, 1000),
    (WAVES.name, "50 poses of C", "C", 0.218, 50),
    (WAVES.name, "100 poses of C", "C", 0.159, 100),
    (WAVES.name, "200 poses of C", "C", 0.113, 200),
    (WAVES.name, "1000 poses of C", "C", 0.088, 1000),
)
"""Model, what trained it, series that judged it (50 of its poses for frame and target; C: poses of the same
series), mean error of a position [mm], and poses of C that trained it and nothing else."""


def known(numbers: Sequence[Row]) -> list[Row]:
    """These numbers, and ours where a model was trained alike."""
    ours = {(row.name, row.judged, row.poses): row.error.mean_mm for row in numbers}
    return [
        Row(
            name=name,
            trained=trained,
            judged=judged,
            prototype_mm=mm,
            here_mm=ours.get((name, judged, poses)),
        )
        for name, trained, judged, mm, poses in KNOWN
    ]
