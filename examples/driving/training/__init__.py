"""Trains the networks of the example. Needs `requirements-training.txt`; the example does not."""
