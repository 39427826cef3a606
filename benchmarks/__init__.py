"""Measures of speed and cost: each module prints its progress, and one JSON object as its last line."""
