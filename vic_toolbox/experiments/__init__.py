"""Experiments: train, transfer, evaluate and report; what the ``vic`` command runs."""
