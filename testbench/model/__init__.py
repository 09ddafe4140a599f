"""The virtual joint model: kinematics, structure of the unknowns, loaded stiffness, poses."""
