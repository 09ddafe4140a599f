"""The virtual joint model: kinematics, structure of the unknowns, loaded stiffness, poses.

Arguments are the same everywhere: q are actuated joints, (runs, n) [rad, m]; wrench is force and moment in
world axes, (runs, 6) [N, N m]; point is where it acts, in the tool's frame, (runs, 3) [m];
targets are points that are read, in the tool's frame, (m, 3) [m]. theta are virtual joints, (runs, n_theta)
[m, rad]; C_theta is their compliance, may be singular, (n_theta, n_theta) [m/N, rad/(N m)]; K_w is the force
term of Eq. (7), (runs, n_theta, n_theta) [N/m, N, N m]. What has another shape or is not finite is a
`BenchError`.
"""
