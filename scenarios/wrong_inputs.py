"""Are wrong inputs found out: mistakes in readings, loads and folders, planted one by one.

python scenarios/wrong_inputs.py --out runs/wrong_inputs
"""

from testbench.studies import main

if __name__ == "__main__":
    main("wrong_inputs")
