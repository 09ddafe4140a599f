"""Section 5.2: the illustrative 6R arm, full poses, LS against GCO, Tables I and II, and the order m.

python scenarios/six_dof_arm.py --out runs/six_dof_arm
"""

from testbench.studies import main

if __name__ == "__main__":
    main("six_dof_arm")
