"""Gains on an arm: the mass matrix moves with the configuration, and the law leaves terms out or in."""
