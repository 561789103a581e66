"""Score tests of errors that the models may have, and likelihoods of noise under several explanations."""
