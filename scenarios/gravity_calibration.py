"""Section 6 in simulation: a heavy arm, 460.3 kg, three markers, LS against GCO.

python scenarios/gravity_calibration.py --seed 1 --out runs/demo
"""

from testbench.studies import main

if __name__ == "__main__":
    main("gravity_calibration")
