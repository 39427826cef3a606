"""The variants of ``benchmarks.peg_sensitivity`` change what they say, and nothing else."""

from __future__ import annotations

import numpy as np

from benchmarks.peg_sensitivity import VARIANTS, VariedPegInHole, chamfer, success
from vic_toolbox.tasks.peg_in_hole import CONSTANTS, PegInHole
from vic_toolbox.tasks.peg_scene import SCENARIOS, build_spec, physics_model

TRAINING = SCENARIOS["train"]


def test_the_first_variant_is_the_task():
    task, usual = VariedPegInHole(VARIANTS[0], tilt=-2.0), PegInHole()
    model = task.simulation(1).model
    same = physics_model(TRAINING.geometry)
    for field in (
        "geom_size",
        "geom_user",
        "geom_solref",
        "geom_solimp",
        "site_pos",
        "actuator_biasprm",
        "body_inertia",
    ):
        np.testing.assert_array_equal(getattr(model, field), getattr(same, field), err_msg=field)
    assert model.opt.timestep == same.opt.timestep
    assert task.scenario == usual.scenario
    assert task.tip == usual.tip
    np.testing.assert_allclose(VARIANTS[0].matched, CONSTANTS["matched"])
    observation = np.random.default_rng(0).normal(0.0, 1e-3, (5, 12))
    np.testing.assert_array_equal(task.expert.action(observation), usual.expert_action(observation))


def test_a_chamfer_keeps_everything_else():
    spec = build_spec(TRAINING)
    usual = spec.compile()
    chamfer(0.7e-3)(spec)
    model = spec.compile()
    hole = model.geom("block").id, usual.geom("block").id
    assert model.geom_user[hole[0], 2] == 0.7e-3
    for field in (
        "geom_friction",
        "geom_solref",
        "geom_solimp",
        "geom_contype",
        "geom_conaffinity",
        "geom_condim",
    ):
        np.testing.assert_array_equal(
            getattr(model, field)[hole[0]], getattr(usual, field)[hole[1]], err_msg=field
        )


def test_every_variant_can_be_simulated():
    assert len({variant.name for variant in VARIANTS}) == len(VARIANTS)
    for variant in VARIANTS:
        task = VariedPegInHole(variant, tilt=-2.0)
        model = task.simulation(1).model
        assert model.opt.timestep * task.substeps == task.dt
        np.testing.assert_allclose(model.site("goal").pos, task.goal)


def test_a_wide_chamfer_saves_the_constant_gain():
    by_name = {variant.name: variant for variant in VARIANTS}
    assert success(by_name["chamfer 1 mm"], 3)["constant"][1] == 1.0
    assert success(by_name["chamfer 0.2 mm"], 3)["constant"][1] == 0.0
