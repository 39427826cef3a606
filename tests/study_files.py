"""Tiny studies that several test files share."""

from __future__ import annotations

import tomllib
from pathlib import Path

from vic_toolbox.experiments.study.definition import Study, parse

TINY = """
name = "tiny"
title = "A study of seconds"
seeds = [30]

[budget.peg-in-hole]
episodes = 2
sweep_episodes = 1
demonstrations = 3
held_out = 1
environments = 2
iterations = 12
cloning_steps = 20
transfer_iterations = 12
fresh_iterations = 2
fresh_divergence = 0.03

[[table]]
name = "I"
title = "Peg-in-Hole over tilts: success"
task = "peg-in-hole"
metric = "success"
scenarios = ["train", "tilt=0"]
actions = ["gain"]
controls = ["no-transfer", "random", "untrained", "expert", "matched"]
halved_step = ["tilt=0"]

[table.paper]
Gain-AIRL = [0.983, 1.0]
"""


def write(folder: Path, text: str = TINY, *, name: str = "tiny.toml") -> Path:
    """A study file."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text)
    return path


def tiny() -> Study:
    """The tiny study."""
    return parse(tomllib.loads(TINY), where="tiny.toml")
