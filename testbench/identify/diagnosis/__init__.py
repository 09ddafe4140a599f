"""What may be wrong with readings, pairs and absolute ones alike: hypotheses beside a fit, each tested."""
