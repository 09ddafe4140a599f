"""What the model does not know: each disturbance of the true arm alone and all together, beside the noise.

python scenarios/model_error.py --out runs/model_error
"""

from testbench.studies import main

if __name__ == "__main__":
    main("model_error")
