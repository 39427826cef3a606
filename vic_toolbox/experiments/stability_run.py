"""A run: its policy rolled out, the gains that it chose, and the policy itself with everything that it may do."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from vic_toolbox import stability
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.skill import Skill, load_skill
from vic_toolbox.experiments.stability_rollout import Moved, action_policy, moved, roll_out, wrench_policy
from vic_toolbox.experiments.stability_settings import StabilitySettings
from vic_toolbox.experiments.stability_study import Study, filter_note, replays
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.stability import Analysis
from vic_toolbox.tasks import Task


def study_run(path: str | os.PathLike[str], settings: StabilitySettings, *, progress: Progress) -> Study:
    """Analyse a run; see :func:`~vic_toolbox.experiments.stability_study.study`."""
    if settings.mass or settings.robot is not None:
        raise InputError(
            f"{path} is a run: its mass is that of its task; leave --mass, --robot and --tool out."
        )
    progress.stage("rolling out the policy")
    skill = load_skill(path)
    task = skill.task(settings.scenario)
    traces = roll_out(skill, task, episodes=settings.episodes, seed=settings.seed)
    period = settings.period or task.dt / task.substeps
    mass = moved(traces[0])
    analyses: dict[str, Analysis] = {}
    starts: tuple[str, ...] = ()
    found = {}
    if task.action == "gain":
        progress.stage("analysing the gains that it chose")
        analyses["rollout"] = _of_trace(traces[0], mass, task, settings, period=period)
        starts = (
            analyses["rollout"]["schedule"].status,
            *(
                _of_trace(trace, moved(trace), task, settings, period=None)["schedule"].status
                for trace in traces[1:]
            ),
        )
        found = replays(analyses["rollout"], settings)
    elif settings.tank is not None or settings.filter is not None:
        raise InputError(f"{path} sets forces, not gains: there is nothing for --tank or --filter to change.")
    progress.stage("analysing the policy")
    analyses["policy"] = _of_policy(skill, task, traces, mass, settings, period)
    notes = (mass.note,) if mass.note else ()
    if "rollout" in analyses:
        notes += filter_note(analyses["rollout"], settings)
    kind = f"{skill.run.method}, {task.action} action, history {task.history}"
    return Study(
        f"Stability of {skill.folder.path.name}",
        f"{task.title} ({kind}), scenario {task.scenario.name}, {len(traces)} rollout{'s' * (len(traces) > 1)}",
        settings,
        period,
        analyses,
        found,
        starts,
        notes,
    )


def _of_trace(
    trace: Trace, mass: Moved, task: Task, settings: StabilitySettings, *, period: float | None
) -> Analysis:
    return stability.analyse(
        trace,
        mass.model,
        q=mass.q,
        axes=settings.axes or None,
        period=period,
        hold=settings.hold or task.dt,
        physical_damping=settings.friction,
        velocity=settings.velocity,
        delay_steps=settings.delay_steps,
        environment_stiffness=settings.environment,
    )


def _of_policy(
    skill: Skill, task: Task, traces: list[Trace], mass: Moved, settings: StabilitySettings, period: float
) -> Analysis:
    unit = np.tile(task.observation_unit, task.history)
    seen: dict[str, Any] = {
        "rollout": np.concatenate([trace.observations for trace in traces]) * unit,
        "history": task.history,
        "seed": settings.seed,
    }
    if task.action == "gain":
        seen["parametrisation"] = task.gains
        policy = action_policy(skill, task)
    else:
        policy, damping = wrench_policy(skill, task)
        seen |= {"output": "wrench", "damping": damping}
    return stability.analyse(
        policy,
        mass.last,
        period=period,
        physical_damping=settings.friction,
        velocity=settings.velocity,
        delay_steps=settings.delay_steps,
        environment_stiffness=settings.environment,
        **seen,
    )
