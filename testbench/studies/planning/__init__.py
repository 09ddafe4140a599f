"""Study of pose selection: plans by every criterion against random poses, verified by simulation."""
