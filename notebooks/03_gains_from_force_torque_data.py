# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 3 · Gains from force/torque data
#
# Somebody leads a robot by the hand to put a cup on a plate. A sensor in the wrist logs forces and
# moments, the controller logs poses. **How stiff was the hand, in which direction, at which moment, and how
# sure is that?** Eight steps:
#
# 1. a raw log: what is in it, and what does not belong there
# 2. the paper's window of ten samples, and why it is not enough
# 3. all samples together: splines with error bands
# 4. what excitation buys
# 5. what else is in the wrench
# 6. coupled gains
# 7. back to the log: thirty demonstrations against the truth
# 8. using the gains
#
# The model is the same everywhere, $F = K(t)\,e + B(t)\,\dot e$ + noise, with the pose error $e$ and its rate.
# Derivations are in the documentation, pages *Recordings* and *Gains from a recording*. The
# notebook takes about a minute.

# %%
import os
import tempfile
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from vic_toolbox import recordings
from vic_toolbox.experiments.figures import style
from vic_toolbox.gains import AXES

FAST = os.environ.get("VIC_FAST") == "1"  # small settings, for a quick check that everything runs
SEED = 0
FOLDER = Path(tempfile.mkdtemp())  # what this notebook writes
plt.rcParams.update(style.RC | {"figure.dpi": 110, "figure.constrained_layout.use": True})
BLUE, ORANGE, GREEN, PINK, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", style.QUIET

# %% [markdown]
# ## 1 · A raw log
#
# One such demonstration ships with the toolbox: `vic fit --example` fits it in one go. It comes from a *digital
# twin* (a simulated arm that is not quite the one of the model, and a simulated hand; no real robot), logged as a
# real one would be. `read` takes CSV, npz, HDF5 and ROS bags; the layout says how the sensor is mounted.

# %%
example = Path(recordings.__file__).parent / "example"
layout = recordings.Layout.load(example / "guided.toml")
raw = recordings.read(example / "guided.npz", layout)
print(f"{len(raw)} samples, {raw.duration:.1f} s, {raw.rate:.0f} Hz")
print(*raw.notes, sep="\n")
print(*raw.findings, sep="\n")

# %% [markdown]
# The sensor feels the hand, but also the weight of gripper and cup, their inertia, and it has a bias. All of that
# is found from a second log: the same sensor at rest in twelve poses, nobody touching. Bias, mass and centre of mass
# are ten numbers, and linear least squares. (The mass is negative because a recording holds the
# wrench of the spring, $K e + B\dot e$: the sensor's report with the other sign.)

# %%
payload = recordings.identify_payload(recordings.read(example / "calibration.npz", layout))
print(f"mass {payload.mass:.3f} kg, centre {np.round(payload.centre, 3)} m")
print(f"bias {np.round(payload.bias[:3], 2)} N, {np.round(payload.bias[3:], 3)} Nm")

clean = recordings.compensate_payload(raw, payload)  # weight, inertia and bias
log = recordings.differentiate(
    clean, window=0.08, smooth=True
)  # the rate of the pose; pose and wrench filtered alike

figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.0), sharex=True)
for axis, colour in zip(range(3), (BLUE, ORANGE, GREEN), strict=True):
    panels[0].plot(raw.time, raw.wrench[:, axis], color=colour, lw=0.6, alpha=0.35)
    panels[0].plot(log.time, log.wrench[:, axis], color=colour, label=f"$F_{AXES[axis]}$")
    panels[1].plot(log.time, 1e3 * log.error[:, axis], color=colour, label=f"$e_{AXES[axis]}$")
panels[0].set(title="force (pale: as it was logged)", xlabel="time  [s]", ylabel="[N]")
panels[1].set(title="way to the goal", xlabel="time  [s]", ylabel="[mm]")
for panel in panels:
    panel.legend(ncols=3)
plt.show()

# %% [markdown]
# **What to see.** The hand's force is a few newtons, and the weight of the gripper is more than that: a stiffness
# read from the raw log would be that of gravity. After 3.5 s the cup stands on the plate, and the sensor feels the
# plate too.
#
# Is the wrench in the axes it should be in? A mounting that nobody wrote down is the commonest trap. `check_frame`
# tries all right-angled mountings and says which one explains the force best:

# %%
print(recordings.check_frame(log).message)

# %% [markdown]
# ## 2 · The paper's window of ten samples
#
# Over ten consecutive samples the gains are taken as constant, and each axis is a straight line through
# ten points, $f_n = k\,e_n + b\,\dot e_n$. To see what that is worth we need a log whose gains we know:
# a spring whose stiffness breathes by 50 % in 5 s, a damper with 0.7 of critical damping, shaken at
# 0.3-2 Hz by 15 mm and 80 mrad, and a good sensor with 0.2 N and 0.01 Nm of noise at 1 kHz.

# %%
from vic_toolbox.estimation import fit_smooth, fit_windows
from vic_toolbox.recordings import Recording

NOISE = np.repeat([0.2, 0.01], 3)  # of the sensor [N, Nm]
MASS = np.repeat([3.0, 0.05], 3)  # [kg, kg m²]
STIFFNESS = np.array([150.0, 200.0, 100.0, 4.0, 5.0, 3.0])  # [N/m, Nm/rad]


def shaken(time, *, size=1.0, seed=SEED):
    """Error and its rate: six frequencies of 0.3-2 Hz for each axis, 15 mm or 80 mrad rms."""
    rng = np.random.default_rng(seed)
    amplitude = size * np.repeat([0.015, 0.08], 3) * np.sqrt(2 / 6)
    rate = 2 * np.pi * rng.uniform(0.3, 2.0, (6, 6))
    phase = rate * time[:, None, None] + rng.uniform(0, 2 * np.pi, (6, 6))
    return amplitude * np.sin(phase).sum(axis=1), amplitude * (rate * np.cos(phase)).sum(axis=1)


def breathing(time):
    """Diagonals of K(t) and B(t)."""
    stiffness = STIFFNESS * (1 + 0.5 * np.sin(2 * np.pi * 0.2 * time[:, None]))
    return stiffness, 1.4 * np.sqrt(stiffness * MASS)


def logged(time, error, rate, stiffness, damping, *, seed=SEED):
    """A recording of ``K e + B ė`` with the sensor's noise."""
    noise = NOISE * np.random.default_rng(seed + 1).standard_normal((len(time), 6))
    return Recording.from_errors(time, error, rate, stiffness * error + damping * rate + noise)


time = np.arange(0, 4 if FAST else 10, 1e-3)
error, rate = shaken(time)
stiffness, damping = breathing(time)
known = logged(time, error, rate, stiffness, damping)
ten = fit_windows(known, window=10)

figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.2))
for panel, gain, seen, true, name in (
    (panels[0], ten.stiffness, ten.stiffness_observable, stiffness, "$K_x$  [N/m]"),
    (panels[1], ten.damping, ten.damping_observable, damping, "$B_x$  [Ns/m]"),
):
    middle = np.median(true[:, 0])
    panel.plot(ten.time, gain[:, 0, 0], ".", ms=1, color=ORANGE, label="window of ten")
    panel.plot(time, true[:, 0], color=style.INK, lw=1.5, label="truth")
    panel.set(xlabel="time  [s]", ylabel=name, ylim=(-middle, 3 * middle), xlim=(0, time[-1]))
    panel.set_title(f"determined in {100 * seen[:, 0].mean():.0f} % of the windows")
panels[0].legend(markerscale=6)
plt.show()

# %% [markdown]
# **What to see.** The truth is somewhere in the cloud. Where a window cannot tell the gain from zero, the
# estimate is `NaN` and the point is missing: *an axis that the data do not determine is no number*. What
# is left still scatters.
#
# ### It is not the solver's fault
#
# With $a = \sum e^2$, $s = \sum e\dot e$, $c = \sum\dot e^2$ over the window, and white noise $\sigma$, no
# unbiased estimator has a smaller variance than (Cramér and Rao)
#
# $$ \operatorname{var} k \ge \sigma^2\frac{c}{ac - s^2}, \qquad \operatorname{var} b \ge \sigma^2\frac{a}{ac - s^2}, $$
#
# and least squares attains it. Over 10 ms the error hardly changes, $\dot e$ is nearly a multiple of $e$,
# and $ac - s^2$ is nearly zero: a spring and a damper do the same. Longer windows have more samples and
# tell the two apart; but the gains are not constant in them:

# %%
widths = np.array([10, 50, 200] if FAST else [10, 20, 50, 100, 200, 500, 1000])
rows = []
for width in widths:
    found = fit_windows(known, window=int(width), step=5)
    at = np.rint(1e3 * found.time).astype(int)
    for gain, sd, seen, true in (
        (found.stiffness, found.stiffness_sd, found.stiffness_observable, stiffness),
        (found.damping, found.damping_sd, found.damping_observable, damping),
    ):
        share = np.abs(gain[:, 0, 0] - true[at, 0]) / true[at, 0], sd[:, 0, 0] / true[at, 0]
        rows.append([*(100 * np.nanmedian(x) for x in share), 100 * seen[:, 0].mean()])
wrong, promised, determined = np.array(rows).reshape(len(widths), 2, 3).transpose(2, 1, 0)

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.2))
for i, (name, colour) in enumerate((("$K_x$", BLUE), ("$B_x$", ORANGE))):
    left.loglog(widths, wrong[i], "o-", ms=4, color=colour, label=f"{name}, error")
    left.loglog(widths, 0.6745 * promised[i], ":", color=colour, label=f"{name}, bound")
    right.semilogx(widths, determined[i], "o-", ms=4, color=colour, label=name)
left.set(xlabel="samples in a window (1 kHz)", ylabel="median error  [%]")
right.set(xlabel="samples in a window (1 kHz)", ylabel="windows that determine it  [%]", ylim=(0, 105))
left.legend()
right.legend()
plt.show()

# %% [markdown]
# **What to see.** At ten samples half of the windows do not know the stiffness. Up to 50 samples the error is
# on its bound and falls steeply: longer windows have more samples *and* tell spring from damper better. From
# 100 on it leaves the bound: the gains change within the window, and no error bar knows about it. Somebody
# has to choose the length, and the best one is another for every log.
#
# ## 3 · Pool the samples: splines whose smoothness the data choose
#
# `fit_smooth` writes $K(t)$ and $B(t)$ as cubic splines with a knot every 0.1 s and punishes their second
# differences. How much is decided by the data, by restricted maximum likelihood (REML). Every sample
# counts for every instant nearby, and the result comes with the standard deviation of its posterior:

# %%
smooth = fit_smooth(known, knots=0.1)
print(smooth.method)


def bands(panel, found, axis, *, what="stiffness", colour=BLUE, label=None):
    """A gain with its 95 % band; gaps where the data do not determine it."""
    gain, sd = (getattr(found, name)[:, axis, axis] for name in (what, f"{what}_sd"))
    panel.fill_between(found.time, gain - 1.96 * sd, gain + 1.96 * sd, color=colour, alpha=0.25, lw=0)
    panel.plot(found.time, gain, color=colour, label=label)


figure, panels = plt.subplots(2, 2, figsize=(9.0, 4.4), sharex=True)
for row, what, true in zip(panels, ("stiffness", "damping"), (stiffness, damping), strict=True):
    for panel, axis, unit in zip(row, (0, 4), ("N/m", "Nm/rad"), strict=True):
        bands(panel, smooth, axis, what=what, label="smooth fit, 95 %")
        panel.plot(time, true[:, axis], color=style.INK, lw=1, ls=":", label="truth")
        letter, per = ("K", unit) if what == "stiffness" else ("B", unit.replace("/", "s/"))
        panel.set_title(f"${letter}_{{{AXES[axis]}}}$  [{per}]")
for panel in panels[1]:
    panel.set_xlabel("time  [s]")
style.shared_legend(figure, panels[0, 0])
plt.show()

at = np.rint(1e3 * smooth.time).astype(int).clip(0, len(time) - 1)
for what, true in (("stiffness", stiffness), ("damping", damping)):
    off = np.diagonal(getattr(smooth, what), axis1=1, axis2=2) - true[at]
    sd = np.diagonal(getattr(smooth, f"{what}_sd"), axis1=1, axis2=2)
    shown = np.isfinite(off)
    error_percent = 100 * np.sqrt(np.nanmean(off**2) / np.mean(true[at] ** 2))
    inside = 100 * np.mean(np.abs(off[shown]) < 1.96 * sd[shown])
    print(f"{what:9}  error {error_percent:.2f} %,  inside the 95 % band: {inside:.0f} %")

# %% [markdown]
# **What to see.** No window had to be chosen, both gains follow to a fraction of a percent, and the band
# says so beforehand. Where the data fall silent for a moment, as at the very ends, it opens.
#
# ## 4 · What excitation buys
#
# ### Amplitude
#
# One second at 1 Hz, constant gains, and only the size of the motion changes:

# %%
second = np.arange(0, 1, 1e-3)
phase = 2 * np.pi * second[:, None]
print("amplitude   standard deviation of K_x")
for size in (1e-2, 1e-3, 1e-4, 0.0):
    e, v = size * np.sin(phase) * np.ones(6), size * 2 * np.pi * np.cos(phase) * np.ones(6)
    found = fit_smooth(logged(second, e, v, STIFFNESS, 0.2 * STIFFNESS), knots=None, noise=NOISE)
    print(
        f"{1e3 * size:6.1f} mm   {found.stiffness_sd[0, 0, 0]:6.2f} N/m    K_x = {found.stiffness[0, 0, 0]:.1f} N/m"
    )

# %% [markdown]
# The deviation is inversely proportional to the amplitude. At 0.1 mm it is most of the gain itself, and
# the answer is `nan`, as it is without motion.
#
# ### A reach is not enough
#
# The commonest demonstration is a reach: one smooth motion to the goal, while the hand becomes softer.
# Take it **without any noise**. With a stiffness that drifts, $K(t) = K_0 + \dot K t$, a window that takes it for
# constant reads
#
# $$ \delta b = \frac{\dot K e^2}{e\ddot e - \dot e^2} $$
#
# of damping that is not there. In the spline the same ambiguity shows as a lack of information, and is
# reported as such:

# %%
DURATION = 2.0
reach_time = np.arange(0, DURATION, 1e-3)
s = (reach_time / DURATION)[:, None]
far = np.array([0.3, 0.2, 0.25, 0.3, 0.2, 0.4])  # [m, rad]
reach = far * (1 - 10 * s**3 + 15 * s**4 - 6 * s**5)
reach_rate = -far * 30 * (s**2 - 2 * s**3 + s**4) / DURATION
softer = STIFFNESS * (1.4 - 0.8 * s)
FACTOR = np.repeat([2.4, 0.35], 3)  # damping factor d of B = d √K
softer_damping = FACTOR * np.sqrt(softer)

silent = Recording.from_errors(reach_time, reach, reach_rate, softer * reach + softer_damping * reach_rate)
noisy = logged(reach_time, reach, reach_rate, softer, softer_damping)
blind = fit_windows(silent, window=100)
free = fit_smooth(noisy)
tied = fit_smooth(noisy, structure="damping_factor")
found, sd = tied.parameters["damping_factor"], tied.parameters["damping_factor_sd"]
print(f"free: stiffness known for {100 * free.stiffness_observable[:, 0].mean():.0f} % of the time, "
      f"damping for {100 * free.damping_observable[:, 0].mean():.0f} %")  # fmt: skip
print(
    f"tied: d = {found[0]:.3f} ± {sd[0]:.3f} (truth {FACTOR[0]}), {found[1]:.3f} ± {sd[1]:.3f} (truth {FACTOR[3]})"
)

figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.2))
panels[0].plot(blind.time, blind.stiffness[:, 0, 0], color=ORANGE, label="window of 100, no noise")
panels[1].plot(blind.time, blind.damping[:, 0, 0], color=ORANGE)
for panel, what, true in zip(panels, ("stiffness", "damping"), (softer, softer_damping), strict=True):
    bands(panel, free, 0, what=what, colour=GREEN, label="smooth fit, free")
    bands(panel, tied, 0, what=what, label="smooth fit, $B = d\\sqrt{K}$")
    panel.plot(reach_time, true[:, 0], color=style.INK, lw=1.2, ls=":", label="truth")
    panel.set(xlabel="time  [s]", ylim=(-0.5 * true[0, 0], 2.2 * true[0, 0]))
    panel.set_title("$K_x$  [N/m]" if what == "stiffness" else "$B_x$  [Ns/m]")
style.shared_legend(figure, panels[0])
plt.show()
# %% [markdown]
# **What to see.** The window is wrong by a factor of two in $B$ without a single newton of noise. The free
# smooth fit is right where it speaks and silent about half of $B$: at a resolution of 0.1 s the reach
# hardly tells a damper from a spring that changes. Tie the damping to the stiffness, $B = d\sqrt{K}$ as the
# paper does, and both are known all the way: one assumption replaces what the data do not say.
#
# The other way is excitation: the same reach, with a slight shake on top.

# %%
wiggle, wiggle_rate = shaken(reach_time, size=0.2)  # 3 mm
shaky = fit_smooth(logged(reach_time, reach + wiggle, reach_rate + wiggle_rate, softer, softer_damping))
demonstrations = [
    logged(reach_time, reach + w, reach_rate + r, softer, softer_damping, seed=seed)
    for seed in range(10)
    for w, r in [shaken(reach_time, size=0.2, seed=10 + seed)]
]
pooled = fit_smooth(demonstrations)

print(f"{'':22}{'K_x known':>10}{'B_x known':>11}{'error of K_x':>14}{'error of B_x':>14}")
for name, found in (("a reach", free), ("with 3 mm of shake", shaky), ("ten of them, pooled", pooled)):
    rows = np.rint(1e3 * found.time).astype(int).clip(0, len(reach_time) - 1)
    row = f"{name:22}"
    for what in ("stiffness", "damping"):
        row += f"{100 * getattr(found, what + '_observable')[:, 0].mean():9.0f} %"
    for what, true in (("stiffness", softer), ("damping", softer_damping)):
        off = getattr(found, what)[:, 0, 0] / true[rows, 0] - 1
        row += f"{100 * np.sqrt(np.nanmean(off**2)):12.2f} %"
    print(row)

# %% [markdown]
# ## 5 · What else is in the wrench
#
# A fit always prints numbers. Four things that make them wrong, how wrong, and what helps; 600 N/m and
# 59.4 Ns/m, shaken as above:

# %%
long = np.arange(0, 4 if FAST else 10, 1e-3)
e, v = shaken(long, seed=3)
e[:, :3] += 0.02  # the hand pulls to one side, by 20 mm
spring, damper = 600.0, 59.4
wrench = spring * e + damper * v + NOISE * np.random.default_rng(4).standard_normal(e.shape)
outliers = np.random.default_rng(5)
hit = outliers.random(e.shape) < 0.02
shapes = {
    "nothing": wrench,
    "3 N of sensor bias": wrench + np.repeat([3.0, 0.1], 3),
    "wrench 5 ms late": np.roll(wrench, 5, axis=0),
    "2 % outliers": wrench + hit * outliers.normal(20.0, 30.0, e.shape),
}
cures = {"3 N of sensor bias": "bias", "wrench 5 ms late": "latency", "2 % outliers": "robust"}
print(f"{'':22}{'K_x':>8}{'B_x':>8}      cured by      {'K_x':>8}{'B_x':>8}")
for name, measured in shapes.items():
    trouble = Recording.from_errors(long[10:], e[10:], v[10:], measured[10:])
    row = fit_smooth(trouble, knots=None)
    text = f"{name:22}{row.stiffness[0, 0, 0]:8.1f}{row.damping[0, 0, 0]:8.2f}"
    if cure := cures.get(name):
        row = fit_smooth(trouble, knots=None, **{cure: True})
        text += f"      {cure + '=True':14}{row.stiffness[0, 0, 0]:8.1f}{row.damping[0, 0, 0]:8.2f}"
    print(text)

# %% [markdown]
# The fourth is inertia that is left in the wrench: a mass $M$ in harmonic motion is a negative stiffness,
# $K - M\omega^2$. No option can tell it from a softer spring at a single frequency; take it out of the
# recording (`recordings.compensate_inertia`):

# %%
for frequency in (0.5, 1.0, 2.0):
    omega = 2 * np.pi * frequency
    e1, v1 = (
        0.01 * np.sin(omega * long[:, None]) * np.ones(6),
        0.01 * omega * np.cos(omega * long[:, None]) * np.ones(6),
    )
    heavy = Recording.from_errors(long, e1, v1, spring * e1 + 30.0 * v1 - 3.0 * omega**2 * e1)
    print(
        f"3 kg at {frequency} Hz: K_x = {fit_smooth(heavy, knots=None).stiffness[0, 0, 0]:6.1f} N/m, not {spring:.0f}"
    )

# %% [markdown]
# ## 6 · Coupled gains
#
# A spring at the tip of a tool is a *coupled* spring at the hand (notebook 5 lives on that). With
# `structure="full"` all 21 entries of $K(t)$ and of $B(t)$ are estimated, and kept positive definite at
# every instant. It takes more data: about a second of rich motion for each second that the gains need to
# change in, so the knots are further apart.

# %%
from vic_toolbox.gains import ImpedanceGains

tip = ImpedanceGains.diagonal([800.0, 800.0, 400.0, 5.0, 5.0, 5.0], [60.0, 60.0, 40.0, 0.5, 0.5, 0.5])
hand = tip.transported((0.0, 0.0, 0.15))  # the same spring and damper, 0.15 m further up
coupled = Recording.from_errors(
    long,
    e,
    v,
    e @ hand.stiffness + v @ hand.damping + NOISE * np.random.default_rng(6).standard_normal(e.shape),
)
full = fit_smooth(coupled, knots=0.5, structure="full")
alone = fit_smooth(coupled, knots=0.5)
middle = len(full.time) // 2
at = [0, 4]  # x and the rotation about y
with np.printoptions(precision=1, suppress=True):
    print("truth      ", hand.stiffness[np.ix_(at, at)].tolist())
    print("full fit   ", full.stiffness[middle][np.ix_(at, at)].round(1).tolist())
    print("   ± sd    ", full.stiffness_sd[middle][np.ix_(at, at)].round(2).tolist())
    print(
        "axes alone ",
        alone.stiffness[middle][np.ix_(at, at)].round(1).tolist(),
        " explained",
        alone.explained[at].round(2),
    )
    print("explained by the full fit", full.explained[at].round(4))
    print(
        "smallest eigenvalue of K(t) at any time:",
        np.linalg.eigvalsh(full.stiffness[full.observable.all(axis=1)]).min().round(2),
    )

# %% [markdown]
# **What to see.** Fitted with its axes alone, a coupled spring gives a lateral stiffness that belongs to nobody,
# and a good part of force and moment remains unexplained. The full fit finds the coupling of −120 N/rad to four
# digits.
#
# ## 7 · Back to the log: thirty demonstrations
#
# `vic fit --example --out fit` fits the log of step 1 and writes tables, a report and what Python needs. One
# demonstration says little, though; the paper records thirty. So does the twin, in a few seconds (`vic twin record`
# does the same), and since it is a twin the hand's true gains are known. They are kept apart: the fit sees the logs
# only.

# %%
from vic_toolbox import twin

robot = twin.Twin(seed=0)  # inertias, friction, delay and noise that the model does not know
session = twin.guide(robot, count=6 if FAST else 30, seed=7)
twin.save_session(session, robot, FOLDER / "guided")
# calibrated, compensated, cut before the cup stands on the plate
logs = twin.load_session(FOLDER / "guided", stop=2.6)
print(f"{len(logs)} demonstrations of {logs[0].duration:.1f} s")

# %% [markdown]
# First the paper's estimator, ten samples at a time, on one of them; then all of them pooled, with
# knots 0.2 s apart:

# %%
paper = fit_windows(logs[0], window=10)
hand = fit_smooth(logs, knots=0.2)
true_stiffness, _ = session.truth.gains_at(hand.time)

figure, panels = plt.subplots(2, 3, figsize=(9.0, 4.6), sharex=True)
for axis, panel in enumerate(panels.flat):
    truth = true_stiffness[:, axis]
    panel.plot(
        paper.time,
        paper.stiffness[:, axis, axis],
        ".",
        ms=1.5,
        color=ORANGE,
        label="window of ten, one demonstration",
    )
    bands(panel, hand, axis, label="smooth fit of all, 95 %")
    panel.plot(hand.time, truth, color=style.INK, lw=1, ls=":", label="truth", zorder=5)
    panel.set(title=f"$K_{{{AXES[axis]}}}$  [{'N/m' if axis < 3 else 'Nm/rad'}]", ylim=(0, 2.2 * truth.max()))
for panel in panels[1]:
    panel.set_xlabel("time  [s]")
figure.align_ylabels()
style.shared_legend(figure, panels[0, 0])
plt.show()

scores = {"window of ten": twin.compare([fit_windows(log, 10) for log in logs], session.truth),
          "smooth fit": twin.compare(hand, session.truth)}  # fmt: skip
for name, score in scores.items():
    percent = [np.round(100 * gain.error).astype(int) for gain in (score.stiffness, score.damping)]
    print(f"{name:14} error of K {percent[0]} %,  of B {percent[1]} %")

# %% [markdown]
# **What to see.** The same hand, the same logs. The window scatters over the whole range and is off by half of the
# gain or more, where it says anything at all; the pooled fit follows the hand's three phases (soft when the arm is
# released, stiff while carrying, soft again for putting down) to a few per cent.
#
# ### Why the controller pushes
#
# These demonstrations are not quite the paper's. While the hand works, the controller adds a small known push,
# 5 N of a multi-sine. Without it:

# %%
calm = twin.guide(robot, count=6 if FAST else 30, seed=7, excitation=twin.Excitation(force=0.0))
twin.save_session(calm, robot, FOLDER / "undisturbed")
undisturbed = twin.load_session(FOLDER / "undisturbed", stop=2.6)
score = twin.compare(fit_smooth(undisturbed, knots=0.2), calm.truth)
print(f"undisturbed: error of K {np.round(100 * score.stiffness.error).astype(int)} %, "
      f"inside the 95 % band: {np.round(100 * score.stiffness.coverage).astype(int)} %")  # fmt: skip

# %% [markdown]
# A hand that leads a free arm hardly pulls: $B\dot e \approx -K e$, and any common factor of both explains what is
# left. What tells demonstrations apart is the hand's own unrest, which moves the arm, so that "noise" and motion are
# correlated, and the fit finds the arm's inertia instead of the hand's spring. **No error bar sees this.** What gives
# it away is the log itself: where only the hand moves the arm, its force is mass times acceleration and little else.

# %%
for name, many in (("pushed", logs), ("undisturbed", undisturbed)):
    print(
        f"{name:12} share of the force that inertia explains: {recordings.inertia_share(many)[:3].mean():.2f}"
    )

# %% [markdown]
# `vic fit` warns above 0.8. The remedy is to move the arm by something that the human did not do; the documentation's
# page *The digital twin and its human* measures how much it takes.
#
# ## 8 · Using the gains
#
# An estimate is a schedule of gains. It drives the law, is the subject of a stability analysis, and with the recorded
# motions it makes demonstrations to learn from:

# %%
from vic_toolbox import tasks

gains = hand.to_gains([0.5, 1.5, 2.3])  # matrices K, B (3, 6, 6), for control.CartesianLaw
print(np.round(np.diagonal(gains.stiffness, axis1=1, axis2=2)[:, :3]), "N/m at 0.5, 1.5 and 2.3 s")

task = tasks.make("cup-on-plate")
spare = task.gains.parameters_to_gains(task.constants["constant"])  # stands in where the data say nothing
with warnings.catch_warnings(record=True) as told:
    demonstrations = tasks.Demonstrations.from_recordings(logs, hand, task=task, fallback=spare)
print(*(warning.message for warning in told), sep="\n")
print(demonstrations.observations.shape, demonstrations.actions.shape)

hand.save(FOLDER / "hand.npz")  # vic_toolbox.estimation.GainEstimate.load reads it again

# %% [markdown]
# ## What to take along
#
# - Look at the log before its numbers: mounting, weight, bias, latency. `vic recording inspect` and `vic fit` do, and
#   name a remedy.
# - Ten samples are not enough, whatever the solver. Pool all of them, and let the data choose the smoothness.
# - What the motion does not determine is no number. Move more, pool demonstrations, or tie the damping.
# - Push. A demonstration that nobody disturbs identifies the arm, not the hand.
