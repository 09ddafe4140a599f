"""The virtual joint model: kinematics, structure of the unknowns, loaded stiffness, poses.

Arguments are the same everywhere: q are actuated joint angles, (runs, n) [rad]; wrench is force and moment in
world axes, (runs, 6) [N, N m]; point is where it acts, in the tool's frame, (runs, 3) [m]. What has another
shape or is not finite is a `BenchError`.
"""
