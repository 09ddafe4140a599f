"""Poses that pay: plans by every criterion against random poses, verified by full simulation.

python scenarios/pose_selection.py --out runs/pose_selection
"""

from testbench.studies import main

if __name__ == "__main__":
    main("pose_selection")
