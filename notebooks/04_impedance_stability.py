# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 4 · Impedance stability: positive gains are not enough
#
# A stiffness and a damping that are positive at every moment can still make an arm shake itself off the table. **Is
# it stable, how far from the edge, and if not, show me.** Nine questions, and each has its method:
#
# 1. how can positive gains grow?
# 2. a schedule K(t): what can be proved of it
# 3. a range of gains, changed by nobody knows whom
# 4. the paper's peg expert
# 5. a schedule that pumps, and two filters that stop it
# 6. a computer that samples: the virtual wall
# 7. an arm in contact, with a filter and a delay
# 8. an arm whose mass moves
# 9. a policy that reacts
#
# Everything is in `vic_toolbox.stability`, and every answer is a `Verdict`: *proved* (with a certificate, checked by
# another route), *disproved* (with a motion that grows and can be replayed) or *inconclusive*. Derivations and a
# table of which method to take are in the documentation, page *Is it stable?*. The notebook takes about half a
# minute.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import display
from scipy.linalg import expm

from vic_toolbox import control, stability, tasks
from vic_toolbox.experiments.figures import style

FAST = os.environ.get("VIC_FAST") == "1"  # small settings, for a quick check that everything runs
plt.rcParams.update(style.RC | {"figure.dpi": 110, "figure.constrained_layout.use": True})
BLUE, ORANGE, GREEN, PINK, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", style.QUIET

# %% [markdown]
# ## 1 · How can positive gains grow?
#
# One axis, $m\ddot e + d\,\dot e + k(t)\,e = 0$, with the energy $V = \tfrac12 m\dot e^2 + \tfrac12 k e^2$. Along the
# motion
#
# $$ \dot V = -d\,\dot e^2 + \tfrac12\,\dot k\,e^2 . $$
#
# The second term is the whole problem: **a spring that is stiffened while it is stretched stores energy that nobody
# paid for.** The simplest pump has no damper: stiff while moving in, $k = 2$, soft while moving out, $k = 1$. Each
# half turn multiplies the speed by $\sqrt{k_{in}/k_{out}} = \sqrt2$. Nobody has to switch so cleverly: $k = 12 + 10
# \sin t$ on 10 kg with 1 Ns/m, $k$ never below 2, does it too.

# %%
switched = stability.worst_case_switching(1.0, (1.0, 2.0), 0.0)
print(switched)


def wave(t):
    """A stiffness that breathes [N/m]."""
    return 12 + 10 * np.sin(t)


breathing = stability.floquet(10.0, wave, 1.0, period=2 * np.pi)
print()
print(breathing)

# %% [markdown]
# A counter-example is a motion: time, state, energy, gains, and `replay()` integrates it again with another method.

# %%
figure, panels = plt.subplots(1, 3, figsize=(9.4, 3.1), width_ratios=(1, 1.2, 1.2))
motion = switched.witness
shown = motion.time < 8.6
stiff = motion.gains["stiffness"].ravel() > 1.5
for which, colour, label in ((stiff, ORANGE, "k = 2"), (~stiff, BLUE, "k = 1")):
    e, rate = (np.where(which & shown, x, np.nan) for x in motion.state.T / np.abs(motion.state[0]).max())
    panels[0].plot(e, rate, color=colour, label=label)
panels[0].set(title="soft out, stiff in", xlabel="error  e", ylabel="rate  ė")
panels[0].set_ylim(-3.2, 3.6)
panels[0].legend(loc="upper center", ncols=2)
motion = breathing.witness
shown = motion.time < 8 * np.pi + 1e-6
grown = panels[1].twinx()
grown.plot(motion.time[shown], wave(motion.time[shown]), color=GREY, lw=1, ls=":")
grown.set(ylim=(0, 60), yticks=[2, 12, 22])
grown.grid(visible=False)
grown.tick_params(colors=GREY)
panels[1].plot(motion.time[shown], motion.state[shown, 0] / np.abs(motion.state[0]).max(), color=BLUE)
panels[1].set(title="k = 12 + 10 sin t (dotted, right axis)", xlabel="time  [s]", ylabel="error  e")
panels[2].plot(motion.time[shown], motion.energy[shown] / motion.energy[0], color=BLUE, label="energy")
rounds = 2 * np.pi * np.arange(5)
multiplier = breathing.values["spectral_radius"]
panels[2].plot(rounds, multiplier ** (2 * np.arange(5)), "o", color=ORANGE, ms=4, label="ρ² for each period")
panels[2].set(title="its energy, over that at the start", xlabel="time  [s]")
panels[2].legend()
plt.show()

# %% [markdown]
# **What to see.** Left: blue arcs are circles, orange ones ellipses, and at each change the curve is farther out.
# Middle and right: the error swings wider every period, and the energy falls between the pushes (the damper works)
# but less than it rises. The dots are Floquet's multiplier $\rho = 1.273$, from the linear algebra of *one* period:
# it knows what a simulation shows only after a while.
#
# The frozen poles, those of each $k$ as if it stayed, are never in the right half-plane. They prove nothing.
#
# ## 2 · What can be proved of a schedule?
#
# Kronander and Billard (2016) take another energy, $V = \tfrac12 m(\dot e + \alpha e)^2 + \tfrac12(k + \alpha d -
# \alpha^2 m)\,e^2$ with a free number $\alpha \ge 0$. It never grows if
#
# $$ \alpha\, m \le d \qquad\text{and}\qquad \dot k + \alpha \dot d \le 2\alpha k \qquad\text{at every instant.} $$
#
# Both are linear in $\alpha$, so the $\alpha$ that serve are an interval, and it is found exactly: a lower end
# that the gains need, an upper end that the damper allows.

# %%
time = np.linspace(0, 2 * np.pi, 401)
for damping in (1.0, 6.0, 9.0):
    verdict = stability.kronander_billard(10.0, wave(time), damping, time=time)
    needed, allowed = verdict.values["alpha"], verdict.values["alpha_max"]
    print(f"d = {damping:.0f} Ns/m: needs α ≥ {needed:.4f}, allows α ≤ {allowed:.1f} 1/s: {verdict.status}")

# %% [markdown]
# At 6 Ns/m this is *inconclusive*: the certificate is not there, and neither is a motion that grows. An
# $\alpha(t)$ that moves with the gains proves more (a cone program over a spline), and Floquet is exact where the
# gains repeat. How much damping does each of them ask for?

# %%
for name, method, gains, options in (
    ("one constant α", stability.kronander_billard, wave(time), {"time": time}),
    ("α(t)", stability.alpha_schedule, wave(time), {"time": time}),
    ("Floquet (exact)", stability.floquet, wave, {"period": 2 * np.pi}),
):
    least = stability.smallest_damping(method, 10.0, gains, 1.0, tolerance=1e-2 if FAST else 1e-4, **options)
    print(f"{name:16} {least:6.3f} Ns/m")

found = stability.kb_map(10.0, 12.0, 1.0, schedule=not FAST)
figure = found.plot()
figure.axes[0].plot(1 / np.sqrt(1.2), 10 / 12, "o", color="white", mec=style.INK, ms=6)
display(figure)

# %% [markdown]
# **What to see.** Every sinusoidal stiffness at once: how fast it breathes (right) and how deep (up), with 1
# Ns/m. The constant $\alpha$ proves the dark blue, $\alpha(t)$ the pale blue as well, Floquet says that all grey
# is stable and the orange tongues are not: parametric resonance at $\omega = 2\sqrt{k/m}/n$. The circle is the
# schedule of section 1. The steps of this ladder lie inside each other; what a lower step does not prove is not
# therefore unstable.
#
# ## 3 · A range of gains
#
# A learned policy has no schedule, but its gains have bounds. For **any** $k(t) \in [k_1, k_2]$, however fast it
# changes, the worst is known for one axis: soft on the way out, stiff on the way in, as in section 1. It grows
# each half turn by
#
# $$ \sqrt{k_2/k_1}\;\exp\bigl(-\tfrac{b}{2m}(t_{out} + t_{in})\bigr), $$
#
# which gives the exact critical damping. For several axes one looks for one $P \succ 0$ with
# $A_i^TP + PA_i \prec 0$ at all corners of the range, an LMI. For one axis that needs
# $b > \sqrt m(\sqrt{k_2} - \sqrt{k_1})$: somewhat too much.

# %%
print(stability.common_lyapunov(1.0, [1.0, 9.0], 1.9).status, "by a common quadratic Lyapunov function, but")
print(
    stability.worst_case_switching(1.0, (1.0, 9.0), 1.9).status,
    "by the worst switching: k in [1, 9], b = 1.9",
)
for method in ("switching", "common_lyapunov"):
    wide = stability.safe_range(1.0, 1.0, 2.0, method=method)
    print(f"m = 1, b = 2: k may change anyhow between 1 and {wide.values['stiffness_high']:.2f} ({method})")

task = tasks.make("peg-in-hole", scenario="tilt=-6")
mass = np.diag([0.5, 0.5, 0.5, 8.2e-4, 8.2e-4, 3e-4])  # the peg and its holder [kg, kg m²], from robots/peg
low, high, damping = task.gains.minimum, task.gains.maximum, np.array(task.gains.damping)

ratio = np.geomspace(1.01, 1e4, 30 if FAST else 120)
exact = [stability.worst_case_switching(1.0, (1.0, r), 1.0).values["critical_damping"] for r in ratio]
figure, panel = plt.subplots(figsize=(6.6, 3.6))
panel.fill_between(ratio, np.sqrt(ratio) - 1, 3e3, color=GREEN, alpha=0.25, lw=0, label="proved by one P")
panel.fill_between(
    ratio, exact, np.sqrt(ratio) - 1, color=BLUE, alpha=0.25, lw=0, label="stable all the same"
)
panel.fill_between(ratio, 1e-3, exact, color=ORANGE, alpha=0.25, lw=0, label="some switching grows")
panel.plot(ratio, exact, color=style.INK, lw=1.2)
for axis, name in ((0, "x, y"), (2, "z"), (3, "tilt"), (5, "turn")):
    scale = np.sqrt(mass[axis, axis] * low[axis])
    panel.plot(high[axis] / low[axis], damping[axis] / scale, "o", color=style.INK, ms=5)
    panel.annotate(name, (high[axis] / low[axis], damping[axis] / scale), (6, -3), textcoords="offset points")
panel.set(xscale="log", yscale="log", xlim=(1.01, 1e4), ylim=(1e-2, 3e3))
panel.set(title="dots: the axes of Peg-in-Hole", xlabel="k₂ / k₁", ylabel="b / √(m k₁)")
panel.legend(loc="lower right")
plt.show()

# %% [markdown]
# **What to see.** The two borders are close: a common $P$ wastes less than a factor of two. The dots lie in the
# green: **whatever anybody does with the stiffness of the peg task, within its bounds, a free motion cannot
# grow.** That is the task's damping, not the skill of its expert.
#
# ## 4 · The paper's peg expert
#
# The expert is a fixed stiffness at the peg's tip, written as six gains that change on the way
# ($k_i e_i = (K_{COM}\,e)_i$, notebook 5). One insertion from 6°, and three questions: does the schedule have a
# certificate? What do the jumps at 50 Hz put in? Is the expert, as a policy $K(e)$, stable?

# %%
from vic_toolbox.experiments.trace import record_trace

trace = record_trace(task, task.expert_action)
rate = trace.observations[:, 6:]
stiffness = trace.stiffness[:, :, None] * np.eye(6)

smooth = stability.kronander_billard(mass, stiffness, np.diag(damping), time=trace.time)
print(f"as a smooth schedule: {smooth.status}; {smooth.reason}")
lateral = stability.kronander_billard(mass[0, 0], trace.stiffness[:, 0], damping[0], time=trace.time)
print(
    f"x alone: {lateral.status}; needs α ≥ {lateral.values['alpha']:.0f}, "
    f"allows α ≤ {lateral.values['alpha_max']:.0f} 1/s"
)
held = stability.held_gains(
    mass,
    stiffness,
    np.tile(np.diag(damping), (len(trace.time), 1, 1)),
    time=trace.time,
    error=trace.error,
    error_rate=rate,
)
print(
    f"jumps: the largest puts in {1e3 * held.values['largest_injection']:.2f} mJ at "
    f"{held.values['largest_injection_time']:.2f} s; the damper takes {1e3 * held.values['dissipated_energy']:.0f} mJ"
)
region = stability.policy_stability(
    task.expert, mass, rollout=np.hstack([trace.error, rate]), samples=16 if FAST else 64
)
print(
    f"as a policy, along this insertion: {region.status}; softest direction "
    f"{region.values['effective_stiffness']:.0f} N/m (or Nm/rad), curl {region.values['curl']:.0f} N/rad, "
    f"{1e3 * region.values['loop_energy']:.1f} mJ for a slow turn in x and tilt"
)
bounded = stability.policy_stability(task.expert_action, mass, parametrisation=task.gains)
print(f"as any policy with these bounds: {bounded.status}, {bounded.witness.statement}")

# %%
figure, panels = plt.subplots(1, 3, figsize=(9.4, 3.0))
first = trace.time < 1.0
panels[0].step(trace.time[first], trace.stiffness[first, 0], where="post", color=BLUE)
panels[0].set(title="lateral stiffness $K_x$", xlabel="time  [s]", ylabel="[N/m]")
moments, needs, allows = (lateral.values[f"profile_{name}"] for name in ("time", "needed", "allowed"))
panels[1].plot(moments, np.clip(needs, 1, None), color=ORANGE, label="needed")
panels[1].plot(moments, allows, color=GREEN, label="allowed")
panels[1].set(
    title="α, Kronander-Billard, x", xlabel="time  [s]", ylabel="[1/s]", yscale="log", xlim=(-0.02, 1)
)
panels[1].legend()
power = np.einsum("ni,i,ni->n", rate, damping, rate)
taken = np.concatenate([[0], np.cumsum(0.5 * (power[1:] + power[:-1]) * task.dt)])
panels[2].plot(trace.time[first], 1e3 * taken[first], color=GREEN, label="taken by the damper")
panels[2].step(
    trace.time[first],
    1e3 * np.cumsum(held.values["injected"])[first],
    where="post",
    color=ORANGE,
    label="put in by jumps",
)
panels[2].set(title="account of energy", xlabel="time  [s]", ylabel="[mJ]")
panels[2].legend()
plt.show()

# %% [markdown]
# **What to see.** The stiffness leaps from 12 to almost 400 N/m in the first step, and jumps again when the peg
# meets the chamfer. No constant $\alpha$ serves: at the start the gains need eight times what the damper allows.
# The account explains why nothing happens: the jumps put in a few millijoule, the damper takes almost fifty times
# that. And the last line of output settles it: **for every gain sequence within the bounds** there is a common
# $P$ (section 3).
#
# Read the fourth line twice. Every $K(e)$ of the expert is diagonal and positive, yet what the peg feels,
# $\partial(Ke)/\partial e$, has a negative direction and a curl: $k_x$ depends on the tilt, so the spring has no
# potential, and who leads the peg slowly round the right loop gains 13 mJ each time. It is the damping that keeps
# the expert safe. (All this is free motion; what the hole does to the peg is notebook 5.)
#
# ## 5 · A schedule that pumps, and two filters
#
# Gains that are held for a control step *jump*, and a jump of the stiffness puts in exactly
# $\tfrac12 e^T\Delta K\,e$. Two runtime filters watch that:
#
# - an **energy tank** pays for every jump upwards with what the damper took before (credited is
#   $\Delta e^T B\,\Delta e/\Delta t$, never more than was dissipated), so that
#   $V + \text{tank} \le V_0 + \text{tank}_0$;
# - a **gain filter** measures nothing: it lets $K$ rise only as fast as a chosen $\alpha$ allows,
#   $\Phi^TP_{next}\Phi \preceq P$ for each step.
#
# Here is a "policy" that wants 600 N/m on the way in and 200 on the way out, at 100 Hz on 1 kg with 1 Ns/m.

# %%
STEP, START = 0.01, np.array([0.1, 0.0])


def run(law=None, duration=3.0):
    """The pump in closed loop through a filter: time, states, allowed K, and the energy ½mė² + ½Ke²."""
    x, state, rows = START.copy(), None, []
    for i in range(round(duration / STEP)):
        wanted = {"stiffness": [600.0 if x[0] * x[1] < 0 else 200.0], "damping": [1.0]}
        seen = {"error": x[:1]} if isinstance(law, control.EnergyTank) else {}
        if law is None:
            k = wanted["stiffness"][0]
        else:
            state = law.step(state, **wanted, **seen, elapsed=STEP) if state else law.start(**wanted, **seen)
            k = float(state.stiffness[0])
        rows.append([i * STEP, *x, k, 0.5 * x[1] ** 2 + 0.5 * k * x[0] ** 2])
        x = expm(np.array([[0.0, 1.0], [-k, -1.0]]) * STEP) @ x
    return np.array(rows)


laws = {
    "none": None,
    "energy tank": control.EnergyTank(energy=0.2),
    "gain filter": control.GainFilter(mass=1.0, alpha=0.5),
}
runs = {name: run(law) for name, law in laws.items()}
bad = runs["none"]

figure, panels = plt.subplots(1, 3, figsize=(9.4, 3.0))
for (name, rows), colour in zip(runs.items(), (ORANGE, BLUE, GREEN), strict=True):
    kept = rows[:, 0] < 1.2
    panels[0].plot(rows[:, 0], np.clip(1e3 * rows[:, 1], -320, 320), color=colour, lw=1.3, label=name)
    panels[1].step(rows[kept, 0], rows[kept, 3], where="post", color=colour, lw=1.3)
    panels[2].semilogy(rows[:, 0], rows[:, 4], color=colour, lw=1.3)
panels[0].set(title="error", xlabel="time  [s]", ylabel="[mm]", xlim=(0, 2), ylim=(-300, 300))
panels[1].set(title="stiffness", xlabel="time  [s]", ylabel="[N/m]")
panels[2].set(title="energy ½mė² + ½Ke²", xlabel="time  [s]", ylabel="[J]")
panels[2].axhline(runs["energy tank"][0, 4] + 0.2, color=BLUE, lw=1, ls=":")
style.shared_legend(figure, panels[0])
plt.show()

# %% [markdown]
# The same filters on a *recording*: what would they have changed?

# %%
replay = control.replay_filter(
    control.EnergyTank(energy=0.2, reserve=0.01),
    bad[:80, 0],
    error=bad[:80, 1],
    stiffness=bad[:80, 3],
    damping=np.ones(80),
)
print(replay.summary())
figure = replay.plot()
figure.set_size_inches(7.2, 5.2)
display(figure)

peg = control.replay_filter(
    control.EnergyTank(energy=5e-3),
    trace.time,
    error=trace.error,
    stiffness=trace.stiffness,
    damping=np.tile(damping, (len(trace.time), 1)),
)
print("\nthe peg expert through a tank of 5 mJ:")
print(peg.summary())

# %% [markdown]
# **What to see.** Without a filter the pump wins. The tank spends its 0.2 J, then allows a stiffness only as the
# damper earns it: the energy stays below the dotted line, which is what it promises. The filter, which knows
# nothing of the motion, takes most of the change away from the start and is calmer for it. On a recording the
# motion stays as it was, wild, so the tank earns and spends more than it would have in the loop. And the expert
# goes through a tank of 5 mJ without noticing.
#
# ## 6 · A computer that samples
#
# A virtual wall $u_k = -K x_k - B\,(x_k - x_{k-1})/T$, held over $T$, sees the position late by half a period on
# average, and a late spring is a negative damper of $K T/2$. Colgate and Schenkel (1997): the wall is
# **passive**, safe for every hand that is, iff the device's own friction is
#
# $$ D > \tfrac12 K T + |B| . $$
#
# **Stable** on one given mass is less, and exact as well: the eigenvalues of the zero-order-hold map. Here: 1 kHz, a
# handle of 0.1 kg with a damper of $D = 5$ Ns/m, and three walls.

# %%
PERIOD, HANDLE, FRICTION = 1e-3, 0.1, 5.0
walls = {"A": (8e3, 0.5, GREEN), "B": (40e3, 60.0, BLUE), "C": (40e3, 0.0, ORANGE)}
for name, (k, b, _) in walls.items():
    passive = stability.sampled_passivity(k, b, period=PERIOD, physical_damping=FRICTION)
    stable, light = (
        stability.sampled_stability(m, k, b, period=PERIOD, physical_damping=FRICTION, velocity="backward")
        for m in (HANDLE, 0.02)
    )
    print(
        f"{name}: K = {k:.0f} N/m, B = {b:g} Ns/m: passivity {passive.status} (needs "
        f"{passive.values['required_damping']:.2f} Ns/m), stability on 100 g {stable.status}, on 20 g {light.status}"
    )

found = stability.z_width(
    HANDLE,
    period=PERIOD,
    physical_damping=FRICTION,
    stiffness=np.linspace(0, 90e3, 400),
    damping=np.linspace(-10, 210, 400),
)
figure = found.plot()
for name, (k, b, colour) in walls.items():
    ink = style.INK if name == "C" else "white"
    figure.axes[0].plot(k / 1e3, b, "o", color=colour, mec="white", ms=8, zorder=6)
    figure.axes[0].annotate(name, (k / 1e3, b), (7, 4), textcoords="offset points", color=ink, weight="bold")
display(figure)

# %% [markdown]
# **What to see.** The region of stable gains has a tip, the stiffest wall that this device can render, about 75
# kN/m. Passive gains are the small triangle in the corner. Wall B is stable here but not passive, and on a handle
# of 20 g it is not stable any more: passivity is the promise that holds whatever the hand does.
#
# A real wall only pushes. When C becomes unstable, the handle is thrown out, comes back and is thrown out again:

# %%


def press(k, b, *, duration=0.4, push=20.0):
    """A hand of constant force pushes the handle against the wall at x > 0: time [s] and position [m]."""
    system = np.array([[0, 1, 0], [0, -FRICTION / HANDLE, 1 / HANDLE], [0, 0, 0.0]])
    step = expm(system * PERIOD)[:2]
    x, before, path = np.array([-2e-3, 0.0]), -2e-3, []
    for _ in range(round(duration / PERIOD)):
        path.append(x[0])
        wall = max(k * x[0] + b * (x[0] - before) / PERIOD, 0.0) if x[0] > 0 else 0.0
        before = x[0]
        x = step @ [*x, push - wall]
    return PERIOD * np.arange(len(path)), np.array(path)


figure, panels = plt.subplots(1, 3, figsize=(9.4, 2.6), sharey=True)
for panel, (name, (k, b, colour)) in zip(panels, walls.items(), strict=True):
    moments, path = press(k, b)
    panel.axhspan(0, 7, color=style.GRID, lw=0)
    panel.plot(moments, 1e3 * path, color=colour, lw=1.2)
    panel.set(title=f"{name}: K = {k / 1e3:g} kN/m, B = {b:g} Ns/m", xlabel="time  [s]", ylim=(-18, 7))
panels[0].set_ylabel("position  [mm]")
plt.show()
_, path = press(*walls["C"][:2], duration=2.0)
print(f"C, in the second second: from {1e3 * path[1000:].min():.1f} to {1e3 * path[1000:].max():.1f} mm")

spring = np.diag(task.gains.maximum)
for period in (20e-3, 1e-3):
    verdict = stability.sampled_stability(mass, spring, np.diag(damping), period=period)
    print(f"the peg's stiffest law held over {1e3 * period:.0f} ms: {verdict.status}")

# %% [markdown]
# **What to see.** In the grey the handle is in the wall. A and B come to rest (A bounces, its damping is small).
# C is thrown out again and again, a limit cycle of two centimetres: each contact gives what the way through the
# air takes. The last two lines are a warning for Peg-in-Hole: its *gains* may be held for 20 ms (section 4), but
# its *law* may not, nor for 1 ms. The damping of 1.8 Nms/rad is too much for an inertia of $8.2\cdot10^{-4}$ kg
# m² at 1 kHz ($B < 2I/T = 1.64$). So the task leaves these springs to the simulator's implicit integrator, as a
# good low-level controller would.
#
# ## 7 · In contact, with a filter and a delay
#
# An admittance-controlled arm follows $M\ddot x + B\dot x = -F$ with the *measured* force, which comes filtered
# ($t_f$) and late ($\tau$). On a spring $K_e$ without delay, Routh gives
#
# $$ K_{e,max} = \frac{B\,(M + B\,t_f)}{M\,t_f}; $$
#
# with a delay the edge is where a root of $f_0(s) + K_e f_1(s)$ crosses the axis, exact, without a Padé
# approximation.

# %%
verdict = stability.contact(5.0, 0.0, 100.0, filter_time=0.02, delay=0.005, environment_stiffness=3000.0)
print(verdict)
display(verdict.plot())

dampings = np.geomspace(10, 1000, 8 if FAST else 30)
figure, panel = plt.subplots(figsize=(6.6, 3.2))
for delay, colour in ((0.0, GREEN), (0.005, BLUE), (0.02, ORANGE)):
    largest = [
        stability.contact(5.0, 0.0, b, filter_time=0.02, delay=delay).values["max_environment_stiffness"]
        for b in dampings
    ]
    panel.loglog(dampings, np.array(largest) / 1e3, color=colour, label=f"delay {1e3 * delay:.0f} ms")
panel.set(title="stiffest environment, M = 5 kg, filter 20 ms", xlabel="damping B  [Ns/m]", ylabel="[kN/m]")
panel.legend()
plt.show()

# %% [markdown]
# **What to see.** Nyquist curve, root locus over the environment's stiffness, step response and decay rate; the
# python-control systems behind them are `verdict.open_loop()`, `closed_loop()` and `root_locus_system()`. Below:
# against a stiffer world an admittance needs damping, and more of it the later the force comes. Impedance control
# of the same mass has no such limit (`kind="impedance"`: every $K_e$), until its own law is filtered or late.
#
# ## 8 · An arm whose mass moves
#
# The paper's law cancels all of $C(x,\dot x)\,\dot x$, and what remains is
# $M(x)\ddot e + B\dot e + Ke = -F_{ext}$. Its energy changes by
#
# $$ \dot V = -\dot e^T\bigl(B - \tfrac12\dot M\bigr)\dot e - \dot e^TF_{ext} , $$
#
# so it takes $B \succeq \tfrac12\dot M$ along the motion. A law that keeps $C\dot e$ needs nothing ($\dot M - 2C$ is
# skew-symmetric). The Fanuc, reaching for the plate with the stiffest and least damped gains of Cup-on-Plate:

# %%
from vic_toolbox.models import load_robot
from vic_toolbox.spatial import pose_from, quat_wxyz_to_rotation
from vic_toolbox.tasks import cup_on_plate, cup_scene

arm = load_robot("fanuc_lrmate200id7l", tool="cup_gripper")
upright = quat_wxyz_to_rotation(cup_scene.TOOL_DOWN_QUAT_WXYZ)
goal = control.Reference(pose_from(cup_scene.GOAL, upright))
gains = cup_on_plate.GAINS.to_gains([1.0] * 6 + [-1.0])
law = control.CartesianLaw(model=arm)


def exact(_, q, v):
    """The paper's law."""
    return law.impedance(q, v, reference=goal, gains=gains).torque


def shortcut(_, q, v):
    """``C q̇ + g + Jᵀ F_fb``: the joint bias as it is, so M(x) J̇ q̇ is left out."""
    wrench = control.feedback_wrench(*law.error(q, v, reference=goal), gains=gains)
    return arm.bias(q, v) + np.vecmat(wrench, arm.jacobian(q))


start = arm.inverse_kinematics(pose_from([0.35, -0.35, 0.45], upright))
reach = {
    f: control.simulate(arm, f, q=start, duration=1.0 if FAST else 2.0, timestep=4e-3)
    for f in (exact, shortcut)
}
path = reach[exact]
for factor in (1.0, 0.05):
    for kept in ("exact", "reference"):
        verdict = stability.arm_passivity(
            arm, gains.stiffness, factor * gains.damping, time=path.time, q=path.q, v=path.v, coriolis=kept
        )
        print(f"{factor:4g} × B, {'C ẋ cancelled' if kept == 'exact' else 'C ė kept':13}: {verdict.status:9} "
              f"{verdict.values['damping_factor']:.3f} × the damping is enough")  # fmt: skip

full = stability.arm_passivity(arm, gains.stiffness, gains.damping, time=path.time, q=path.q, v=path.v)
other = reach[shortcut]
left = stability.path_inertia(arm, other.q, other.v)
force = np.linalg.norm(left.without_jacobian_rate[:, :3], axis=1)
figure, panels = plt.subplots(1, 3, figsize=(9.4, 2.9))
panels[0].plot(full.values["share_time"], 100 * full.values["share"], color=BLUE)
panels[0].axhline(0, color=GREY, lw=0.8)
panels[0].set(title="damping eaten by ½Ṁ", xlabel="time  [s]", ylabel="[%]")
panels[1].plot(other.time, force, color=ORANGE)
panels[1].set(title="force that the shortcut leaves", xlabel="time  [s]", ylabel="[N]")
for (name, motion), colour in zip(
    {"the paper's law": path, "shortcut": other}.items(), (BLUE, ORANGE), strict=True
):
    panels[2].plot(1e3 * motion.pose[:, 0, 3], 1e3 * motion.pose[:, 1, 3], color=colour, label=name)
panels[2].set(title="path from above", xlabel="x  [mm]", ylabel="y  [mm]")
panels[2].plot(*1e3 * np.array(cup_scene.GOAL[:2]), "o", color=style.INK, ms=4, label="goal")
panels[2].set_aspect("equal", adjustable="datalim")
panels[2].legend(loc="center right")
plt.show()
print(
    f"without J̇: up to {force.max():.1f} N, {1e3 * force.max() / gains.stiffness[0, 0]:.0f} mm of a 200 N/m spring"
)

# %% [markdown]
# **What to see.** On this reach the moving mass eats a sixth of the damping at its worst: proved, with room. With
# a twentieth of the damping it is disproved, but not for the law that keeps $C\dot e$. Leaving out $\dot J$ is
# another kind of mistake: not an instability, but a force of 34 N that nobody asked for, and a path that bends
# away.
#
# ## 9 · A policy that reacts
#
# A learned policy sees the error and its rate. Then $\dot K$ is a *total* derivative, and the arm does not feel
# $K$ but the slope of the wrench $w = K(e,\dot e)\,e + B\,\dot e$:
#
# $$ S = \frac{\partial w}{\partial e} = K + \frac{\partial K}{\partial e}e, \qquad
# E = \frac{\partial w}{\partial\dot e} = B + \frac{\partial K}{\partial\dot e}\,e . $$
#
# This one looks like what a network learns, smooth, saturated, and never below 100 N/m: it softens when it moves
# outwards. It holds a load of 20 N, thus $e = 20$ mm, and there $E = 20 - 1500 \cdot 0.02 = -10$.

# %%


def yielding(observation):
    """K [N/m] between 100 and 1900, softer the faster it moves in +e; B [Ns/m]."""
    return 1000 - 900 * np.tanh(1500 * observation[:, 1] / 900), 20.0


loaded = stability.policy_stability(yielding, 1.0, load=20.0)
print(loaded)

loads = np.linspace(0, 25, 6 if FAST else 26)
growth = [stability.policy_stability(yielding, 1.0, load=load).values["growth_rate"] for load in loads]
motion = loaded.witness
figure, panels = plt.subplots(1, 3, figsize=(9.4, 2.9))
panels[0].plot(motion.time, 1e3 * motion.state[:, 0], color=BLUE)
panels[0].set(title="error under 20 N", xlabel="time  [s]", ylabel="[mm]")
panels[1].plot(motion.time, motion.gains["stiffness"].ravel(), color=ORANGE)
panels[1].set(title="stiffness on the way", xlabel="time  [s]", ylabel="[N/m]", ylim=(0, None))
panels[2].plot(loads, growth, color=BLUE)
panels[2].axhline(0, color=GREY, lw=0.8)
panels[2].axvline(20 / 1.5, color=GREY, lw=0.8, ls="--")
panels[2].set(title="growth rate, largest Re λ", xlabel="load  [N]", ylabel="[1/s]")
plt.show()

# %% [markdown]
# And a policy that softens with the *error*, $k(e) = 1000\,e^{-e^2/2s^2}$ with $s$ = 10 mm: positive everywhere,
# and beyond $s$ the spring pushes outwards.

# %%


def shy(observation):
    """K [N/m] that falls with the error."""
    return 1000 * np.exp(-(observation[:, 0] ** 2) / (2 * 0.01**2))


verdict = stability.policy_stability(shy, 1.0, damping=20.0, region=[0.03, 0.3])
print(verdict.status, f"in the region; holds {verdict.values['largest_force']:.5f} N at most, ", end="")
print(f"softest {verdict.values['effective_stiffness']:.0f} N/m")
for load in (6.0, 6.1):
    print(f"under {load} N: {stability.policy_stability(shy, 1.0, damping=20.0, load=load).status}")

# %% [markdown]
# **What to see.** Every stiffness that the first policy sets is positive, and the arm oscillates, because the
# policy takes the damping away wherever a load keeps the error from zero. The edge is at $20/1.5 = 13.3$ N
# (dashed): *unloaded* it is stable, and a test without load would have passed. The second policy cannot hold more
# than 6.07 N, whatever its gains say. In a region a black box is never *proved*: samples prove nothing about the
# states between them, and the verdict says so.
#
# ## Which question, which method?
#
# | question | method |
# |---|---|
# | a schedule K(t), D(t) | `kronander_billard`, `alpha_schedule`; jumps: `held_gains`; M changes: `moving_mass` |
# | a schedule that repeats | `floquet` (exact) |
# | any gains within a range | `common_lyapunov`, one axis `worst_case_switching` (exact); how wide: `safe_range` |
# | the control period | `sampled_stability` (exact), `sampled_passivity`, `z_width` |
# | touching something | `contact` (exact), any passive thing: `port_passivity` |
# | an arm that moves fast | `arm_passivity` |
# | a policy K(e, ė) | `policy_stability` |
# | at runtime | `EnergyTank`, `GainFilter`, `replay_filter` |
#
# `vic stability FILE --out DIR` asks what applies of a fit, a run or a table of gains, and writes a report.
