"""The virtual joint method (VJM): kinematics, model structures, loaded stiffness, joint laws, poses.

This package turns an arm into the linear model dX = A(q, w) pi of Eq. (11) and (12), and into the loaded
equilibrium behind Eq. (7). `identify`, `design` and `correct` build on it; it shares no code with the
simulated truth.

Arguments are the same everywhere. q: actuated joints, (runs, n) [rad, m]. wrench: force and moment in world
axes, (runs, 6) [N, N m]. point: where the wrench acts, in the tool's frame, (runs, 3) [m]. targets: points
that the tracker reads, in the tool's frame, (m, 3) [m]. theta: virtual joint coordinates, (runs, n_theta) [m,
rad]. C_theta: compliance of the virtual joints, which may be singular, (n_theta, n_theta) [m/N, rad/N, rad/(N
m)]. K_w: force term of Eq. (7), (runs, n_theta, n_theta) [N/m, N, N m]. An array of another shape, or with a
number that is not finite, raises a `BenchError`.
"""
