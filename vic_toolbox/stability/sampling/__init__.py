"""Gains under a sampling controller: exact stability of the held loop, passivity of a sampled wall, Z-width maps."""
