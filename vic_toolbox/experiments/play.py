"""Watch a policy: in a window, or as a film beside the expert."""

from __future__ import annotations

from pathlib import Path

from vic_toolbox.errors import DependencyError, integer
from vic_toolbox.experiments.evaluation import START_NOISE
from vic_toolbox.experiments.film import film
from vic_toolbox.experiments.skill import Skill
from vic_toolbox.experiments.trace import record_trace
from vic_toolbox.tasks import VectorEnvironment
from vic_toolbox.tasks.rendering import Window


def film_skill(skill: Skill, scenario: str | None, path: Path) -> str:
    """Write a film of the policy beside the expert; returns what to tell the user.

    Raises
    ------
    InputError
        The name does not end in ``.mp4``, or the scenario cannot be used.
    FileError
        It cannot be written.
    """
    task = skill.task(scenario)
    traces = {
        "expert": record_trace(task, task.expert_action),
        skill.look: record_trace(task, skill.judged.act),
    }
    caption = film(path, traces, task)
    return f"{path}\n{caption}"


def show_skill(skill: Skill, scenario: str | None, *, seed: int = 0) -> str:
    """Run one episode in a window, in real time; returns what to tell the user.

    Parameters
    ----------
    skill : Skill
        The policy.
    scenario : str, optional
        A name, or text that the task's ``as_scenario`` reads; by default that of the run.
    seed : int
        Draws a small variation of the start; 0 starts exactly at the scenario.

    Raises
    ------
    DependencyError
        There is no display.
    """
    task = skill.task(scenario)
    seed = integer("seed", seed, low=0)
    try:
        window = Window(task.picture_spec(), period=task.dt)
    except DependencyError as error:
        raise DependencyError(f"{error} Or write a film: vic play RUN --video FILE.mp4") from error
    environment = VectorEnvironment(task, 1)
    info: dict = {}
    try:
        observation, _ = environment.reset(seed=seed, options={"start_noise": START_NOISE if seed else 0.0})
        for _ in range(task.horizon):
            window.show(environment.simulation.qpos[0])
            observation, _, _, _, info = environment.step(skill.judged.act(observation))
    finally:
        window.close()
    succeeded, failed = task.outcome_text
    return f"score {info['score'][0]:.1f}; {succeeded if info['success'][0] else failed}"
