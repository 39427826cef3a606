"""Every kind of verdict has a picture, and it shows what the verdict says."""

from __future__ import annotations

import numpy as np
import pytest

from vic_toolbox.stability import Certificate, CounterExample, Verdict
from vic_toolbox.stability.schedules.floquet import floquet
from vic_toolbox.stability.schedules.held_gains import held_gains
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.schedules.moving_mass import moving_mass

ROUND = np.linspace(0, 2 * np.pi, 200)
WAVE = 12 + 10 * np.sin(ROUND)


def verdicts() -> dict[str, Verdict]:
    t = np.linspace(0, 3, 60)
    bare = CounterExample("a recording", t, np.ones((60, 3)), np.linspace(-1, 2, 60))
    many = CounterExample(
        "six axes", t, np.ones((60, 12)), np.exp(t), gains={"stiffness": np.exp(t)[:, None, None] * np.eye(6)}
    )
    quadratic = Certificate("AᵀP + PA ≺ 0", {"P": np.diag([2.0, 1.0])}, 0.1)
    large = Certificate("AᵀP + PA ≺ 0", {"P": np.eye(4)}, 0.1)
    return {
        "proved": kronander_billard(10, WAVE, 9, time=ROUND),
        "disproved": kronander_billard(10, WAVE, 1, time=ROUND),
        "inconclusive": kronander_billard(10, WAVE, 5, time=ROUND),
        "jump": kronander_billard(10, np.where(ROUND < 3, 1.0, 2.0), 5, time=ROUND),
        "periodic, proved": floquet(10, lambda t: 12 + 10 * np.sin(t), 3, period=2 * np.pi),
        "periodic, disproved": floquet(10, lambda t: 12 + 10 * np.sin(t), 1, period=2 * np.pi),
        "moving": moving_mass(2 * (1 + t) ** 2, 500, 3 * (1 + t), time=t),
        "held": held_gains(1, [2, 1, 2], 0, time=[0, 1.1107, 2.6815]),
        "bare": Verdict("disproved", "a question", "a method", witness=bare),
        "six axes": Verdict("disproved", "a question", "a method", witness=many),
        "quadratic": Verdict("proved", "a question", "a method", 1.0, "m", {}, quadratic),
        "large": Verdict("proved", "a question", "a method", 1.0, "m", {}, large),
        "nothing": Verdict("inconclusive", "a long question " * 20, "a method", reason="no reason " * 40),
    }


@pytest.mark.parametrize("name", list(verdicts()))
def test_every_kind_is_drawn(name: str, tmp_path, recwarn: pytest.WarningsRecorder):
    verdict = verdicts()[name]
    figure = verdict.plot()
    figure.savefig(tmp_path / "verdict.png")
    texts = [text.get_text() for part in figure.subfigs for text in part.texts]
    assert verdict.status in texts
    assert not [w for w in recwarn if "Glyph" in str(w.message) or "layout" in str(w.message)]


def test_a_disproof_shows_the_motion_the_energy_and_the_stiffness():
    figure = verdicts()["disproved"].plot()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["error e [m]", "energy [J]", "stiffness [N/m]"]
