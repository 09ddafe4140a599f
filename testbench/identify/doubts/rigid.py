"""Rigid motions of points, and a loss for which a few wrong points do not matter."""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.model.vjm import rotation


@dataclass(frozen=True)
class Rigid:
    """x -> R x + t."""

    R: Array  #: Orthogonal, (3, 3).
    t: Array  #: (3,) [m].

    def of(self, points: Array) -> Array:
        """Points, (..., 3), moved."""
        return np.asarray(points @ self.R.T + self.t)

    @property
    def turn(self) -> Array:
        """Rotation vector of a rotation, (3,) [rad]."""
        from scipy.spatial.transform import Rotation  # here: it takes long to import

        return np.asarray(Rotation.from_matrix(self.R).as_rotvec())


STILL = Rigid(np.eye(3), np.zeros(3))


def turned_by(vector: Array) -> Array:
    """Rotation matrix of a rotation vector, (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    return np.eye(3) if angle < 1e-15 else rotation(vector / angle, angle)


def weights(residual: Array, scale: float) -> Array:
    """Weights of Cauchy's loss, of residuals, (..., 3) [m]."""
    return np.asarray(1 / (1 + np.square(residual / scale).sum(axis=-1) / 3))


def losses(residual: Array, scale: float) -> Array:
    """Cauchy's loss of residuals, (..., 3): minus the logarithm of a density in three dimensions [nats]."""
    return np.asarray(1.5 * np.log1p(np.square(residual / scale).sum(axis=-1) / 3))


def cost(residual: Array, scale: float) -> float:
    """Cauchy's loss of all residuals, (..., 3) [nats]."""
    return float(losses(residual, scale).sum())
