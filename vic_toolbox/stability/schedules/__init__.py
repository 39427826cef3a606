"""Gains that vary in time: storage functions with constant and varying α, moving masses, periodic and held gains."""
