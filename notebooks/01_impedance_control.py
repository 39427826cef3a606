# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 1 · Impedance control: what stiffness and damping feel like
#
# A position-controlled robot goes to a point, whatever stands in its way. An **impedance-controlled** robot
# behaves as if a spring and a damper pulled its hand to that point: push it and it gives way, let go and it
# comes back, run it into a table and it presses with a force that you chose.
#
# This notebook takes you there in eight steps, each with its equation, a few lines of code, and a figure:
#
# 1. the arm as numbers: $M$, $C$, $g$, $J$
# 2. the impedance law, and what $K$ and $B$ feel like
# 3. how to choose the damping: $d\sqrt K$ or double diagonalisation
# 4. where the energy goes
# 5. why a push along one axis moves the hand along others, and how a chosen inertia stops that
# 6. why the operational-space terms must be exact
# 7. contact, and Cup-on-Plate: why one would *vary* the impedance
# 8. the same law on other arms
#
# Everything is in SI units; a twist is $[v; \omega]$ and a wrench $[f; m]$, in world axes. The derivations
# are in the documentation, page *The impedance law*.

# %%
import os

import matplotlib.pyplot as plt
import numpy as np

from vic_toolbox.experiments.figures import style

FAST = os.environ.get("VIC_FAST") == "1"  # small settings, for a quick check that everything runs
plt.rcParams.update(style.RC | {"figure.dpi": 110, "figure.constrained_layout.use": True})
BLUE, ORANGE, GREEN, PINK, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", style.QUIET

# %% [markdown]
# ## 1 · The arm as numbers
#
# An arm that exerts the wrench $F_{ext}$ on its environment moves by
#
# $$ M(q)\,\ddot q + C(q,\dot q)\,\dot q + g(q) = \tau - J^{\mathsf T} F_{ext}, \qquad \dot x = J\,\dot q . $$
#
# `load_robot` reads a URDF and gives each of these terms, for one state or for a batch. Here: a FANUC LR
# Mate 200iD/7L that carries a force sensor, a gripper and a cup. Its end-effector is the centre of the
# cup's bottom.

# %%
from vic_toolbox.models import load_robot
from vic_toolbox.spatial import pose_from

arm = load_robot("fanuc_lrmate200id7l", tool="cup_gripper")
tool_down = np.diag([1.0, -1.0, -1.0])


def posture(x, y, z):
    """Joint angles that hold the cup upright at a point [m]."""
    return arm.inverse_kinematics(pose_from([x, y, z], tool_down))


start, rest = posture(0.60, -0.05, 0.30), np.zeros(arm.nv)
arm

# %%
from vic_toolbox.errors import DependencyError
from vic_toolbox.tasks import CupOnPlate
from vic_toolbox.tasks.rendering import Renderer

try:
    with Renderer(CupOnPlate().picture_spec(), width=900, height=510) as renderer:
        pictures = [renderer.picture(q) for q in (start, posture(0.40, 0.40, 0.021))]
except DependencyError as error:  # a machine without OpenGL: everything below works all the same
    print(f"No picture here: {error}")
else:
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 2.65))
    for panel, picture, title in zip(panels, pictures, ("start", "cup on plate"), strict=True):
        panel.imshow(picture)
        panel.set(title=title, xticks=[], yticks=[])
        panel.grid(False)
        panel.spines[:].set_visible(False)

# %% [markdown]
# The terms, for the posture on the left:

# %%
M = arm.mass_matrix(start)  # 6 × 6 [kg m²]
g = arm.gravity(start)  # torques that hold the arm [Nm]
C = arm.coriolis_matrix(start, np.ones(arm.nv))  # all joints at 1 rad/s
J = arm.jacobian(start)  # [v; ω] = J q̇
space = arm.operational_space(start, rest)  # the same dynamics, as the cup feels them

with np.printoptions(precision=2, suppress=True):
    print("g      =", g, "Nm")
    print("C q̇    =", C @ np.ones(arm.nv), "Nm at 1 rad/s")
    print("M(x)   =", np.diag(space.mass), "on its diagonal, kg and kg m²")
    print("how far from a singularity: smallest singular value of J =", round(space.singular_value, 3))

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.7), width_ratios=(1, 1.45))
left.imshow(np.abs(M), cmap="Blues", norm="log", vmin=0.003, vmax=10)
for (i, j), value in np.ndenumerate(M):
    if abs(value) > 0.005:
        ink = "white" if abs(value) > 0.3 else style.INK
        left.text(j, i, f"{value:.2f}", ha="center", va="center", color=ink)
left.set(title="joint-space inertia M(q)  [kg m²]", xlabel="joint", ylabel="joint")
left.set(xticks=range(6), yticks=range(6), xticklabels=range(1, 7), yticklabels=range(1, 7))
left.grid(False)

links = ("base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "flange", "cup_bottom")
circle = np.stack([np.cos(np.linspace(0, 2 * np.pi, 120)), np.sin(np.linspace(0, 2 * np.pi, 120))])
push = np.array([1.0, 1.0]) / np.sqrt(2)
points = {BLUE: (0.30, 0.0, 0.55), GREEN: (0.60, 0.0, 0.30), ORANGE: (0.75, 0.0, 0.05)}
for colour, point in points.items():
    q = posture(*point)
    mobility = np.linalg.inv(arm.operational_space(q, rest).mass)[np.ix_([0, 2], [0, 2])]
    bones = np.array([arm.pose(q, frame=link)[[0, 2], 3] for link in links])
    tip, reply = bones[-1], 10 * mobility @ push * 0.05  # 10 N; 5 cm in the drawing stand for 1 m/s²
    right.plot(*bones.T, "-o", color=colour, lw=2.5, ms=4, alpha=0.45)
    right.fill(*(tip[:, None] + 10 * mobility @ circle * 0.05), color=colour, alpha=0.25, lw=0)
    right.annotate("", tip + 0.2 * push, tip, arrowprops={"arrowstyle": "->", "color": GREY, "lw": 1.2})
    right.annotate("", tip + reply, tip, arrowprops={"arrowstyle": "->", "color": colour, "lw": 2})
right.set(title="a push of 10 N (grey), and where it sends the cup")
right.set(xlabel="x  [m]", ylabel="z  [m]", aspect="equal")
plt.show()

# %% [markdown]
# **What to see.** Left: the joints near the base carry most of the inertia, and joints 2 and 3 are coupled.
# Right: the arm from the side in three postures. Each ellipse holds the accelerations that a push of 10 N
# can cause (5 cm in the drawing stand for 1 m/s²): the mobility $J M^{-1} J^{\mathsf T}$, the inverse of
# the apparent mass $M(x)$. The cup is easier to move along $x$ than along $z$, so it *does not start off in
# the direction of the push*. Section 5 comes back to this.
#
# ## 2 · The impedance law, and what $K$ and $B$ feel like
#
# With the pose error $e = [p - p_d; \log(R R_d^{\mathsf T})]$ the law is
#
# $$ \tau = J^{\mathsf T}\bigl(\underbrace{M(x)\,\ddot x_d + C(x,\dot x)\,\dot x + G(x)}_{F_{ff}}
#    \;\underbrace{-\,K e - B\,\dot e}_{F_{fb}}\bigr)
#    \quad\Longrightarrow\quad M(x)\,\ddot e + B\,\dot e + K e = -F_{ext} . $$
#
# The cup becomes a mass on a spring and a damper. No force sensor is needed.

# %%
from vic_toolbox.control import CartesianLaw, Reference
from vic_toolbox.gains import ImpedanceGains, double_diagonalisation

law = CartesianLaw(model=arm)
here = Reference(arm.pose(start))
stiffness = np.diag([500.0, 500, 500, 50, 50, 50])  # N/m, Nm/rad
gains = ImpedanceGains(stiffness, double_diagonalisation(stiffness, space.mass, damping_ratio=0.7))

command = law.impedance(start, rest, reference=here, gains=gains)
print("torque at rest, on the reference:", command.torque.round(2), "Nm: gravity, and nothing else")

# %% [markdown]
# To feel it, close the loop and push. `simulate` integrates the equation of motion above under any
# controller. A hand that pushes with the wrench $w$ is $F_{ext} = -w$: the robot pushes back.

# %%
from vic_toolbox.control import simulate

STEP = 4e-3  # [s]


def pushed(gains, wrench, *, law=law, q=start, until=1.2, seconds=2.2):
    """Pose error over time (T, n, 6) of a batch of gains, with a hand that pushes from 0.1 s on."""
    reference = Reference(law.model.pose(q))

    def external(t, q, v):
        return -np.asarray(wrench) * (0.1 <= t < until)

    def torque(t, q, v):
        sensor = {} if law.inertia is None else {"external_wrench": external(t, q, v)}
        return law.impedance(q, v, reference=reference, gains=gains, **sensor).torque

    motion = simulate(law.model, torque, q=q, duration=seconds, timestep=STEP, external_wrench=external)
    return motion.time, motion.error(reference)[0]


# %%
downward = [0.0, 0.0, -10.0, 0.0, 0.0, 0.0]  # 10 N onto the cup
levels, ratios = (200.0, 500.0, 2000.0), (0.15, 0.4, 1.0, 3.0)
stiffnesses = np.array([np.diag([k, k, k, 50.0, 50, 50]) for k in levels])
dampings = np.array([double_diagonalisation(stiffness, space.mass, damping_ratio=ratio) for ratio in ratios])
critical = double_diagonalisation(stiffnesses, space.mass)
t, by_stiffness = pushed(ImpedanceGains(stiffnesses, critical), downward)
t, by_damping = pushed(ImpedanceGains(stiffness, dampings), downward)

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.1))
for k, e, colour in zip(levels, by_stiffness[:, :, 2].T, (ORANGE, BLUE, GREEN), strict=True):
    left.plot(t, -1e3 * e, color=colour, label=f"K = {k:.0f} N/m")
    left.plot([0.1, 1.2], [1e4 / k] * 2, color=colour, lw=0.9, ls=":")
for ratio, e, colour in zip(ratios, by_damping[:, :, 2].T, (PINK, ORANGE, BLUE, GREEN), strict=True):
    right.plot(t, -1e3 * e, color=colour, label=f"ζ = {ratio}")
left.set_title("stiffness: how far it gives way (ζ = 1)")
right.set_title("damping: how it gets there (500 N/m)")
for panel in (left, right):
    panel.axvspan(0.1, 1.2, color=style.GRID, alpha=0.6, lw=0)
    panel.set(xlabel="time  [s]", ylabel="way down  [mm]", xlim=(0, t[-1]))
    panel.legend(loc="upper right")
plt.show()

# %% [markdown]
# **What to see.** While the hand pushes (grey), the cup settles at $F/K$ (dotted): 10 N over 500 N/m are 20
# mm. The stiffness says *how far* and, with the mass, *how fast* ($\sqrt{K/M}$); the damping ratio $\zeta$
# says *how*: it rings at 0.15 and creeps at 3.
#
# ## 3 · How to choose the damping
#
# Two recipes turn a stiffness into a damping:
#
# $$ B = d\,\sqrt K \qquad\text{or}\qquad B = 2\,Q\,\mathrm{diag}(\zeta\sqrt{\lambda})\,Q^{\mathsf T}
#    \ \text{ with }\ M(x) = Q Q^{\mathsf T},\ K = Q\,\mathrm{diag}(\lambda)\,Q^{\mathsf T} . $$
#
# The first has one factor $d$ for all axes; the method that this toolbox reproduces (Zhang et al., 2021)
# uses it. It knows nothing of the inertia. The second, *double diagonalisation* (Albu-Schäffer et al.,
# 2003), gives every mode of the arm the damping ratio $\zeta$.

# %%
from scipy.linalg import eigh

from vic_toolbox.gains import factor_damping

d = 2 * 0.7 * np.sqrt(space.mass[2, 2])  # what ζ = 0.7 along z asks for: 3.4 √kg
designs = {
    f"B = d √K,  d = {d:.1f}": factor_damping(stiffness, d),
    "double diagonalisation,  ζ = 0.7": double_diagonalisation(stiffness, space.mass, damping_ratio=0.7),
}
both = ImpedanceGains(stiffness, np.array(list(designs.values())))
t, push_z = pushed(both, downward, until=np.inf)
t, twist_z = pushed(both, [0, 0, 0, 0, 0, 1.0], until=np.inf)

figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.2))
squares, modes = eigh(stiffness, space.mass)
for i, ((name, damping), colour) in enumerate(zip(designs.items(), (ORANGE, BLUE), strict=True)):
    panels[0].plot(t, -1e3 * push_z[:, i, 2], color=colour, label=name)
    panels[1].plot(t, np.degrees(twist_z[:, i, 5]), color=colour)
    ratio = np.diag(modes.T @ damping @ modes) / (2 * np.sqrt(squares))
    panels[2].plot(range(1, 7), ratio, "o", color=colour)
panels[0].set(title="10 N downward", xlabel="time  [s]", ylabel="way down  [mm]")
panels[1].set(title="1 Nm about z", xlabel="time  [s]", ylabel="rotation  [°]")
panels[2].set(title="damping ratio of each mode", xlabel="mode, slowest first", yscale="log", ylim=(0.3, 30))
panels[2].axhline(1.0, color=GREY, lw=0.8, ls=":")
panels[2].text(6.3, 1.08, "critical", color=GREY, fontsize=8, ha="right")
figure.legend(loc="outside upper center", ncols=2)
plt.show()

# %% [markdown]
# **What to see.** $d = 3.4$ was chosen for $z$, and there it is as good as the other design. About $z$,
# where the inertia is only 0.1 kg m², the same factor creeps: its damping ratio is $d/(2\sqrt m)$, and what
# is right for 6 kg is not right for 0.1 kg m². Double diagonalisation treats all six modes alike, in
# whatever units and axes $K$ and $M(x)$ are written.
#
# A damping also has an upper end. A wrench that is held for $\Delta t$ damps only as long as
#
# $$ \Delta t\;\lambda_{max}\bigl(M(x)^{-1} B\bigr) < 2 . $$

# %%
for name, damping in designs.items():
    fastest = np.linalg.eigvals(np.linalg.solve(space.mass, damping)).real.max()
    print(f"{name:34} the law must run faster than {fastest / 2:.0f} Hz")

# %% [markdown]
# ## 4 · Where the energy goes
#
# Spring and motion store energy, the damper takes it away. With the feed-forward $C(x,\dot x) \dot x_d$ in
# the place of $C(x,\dot x) \dot x$ the account is exact, because $\dot M - 2C$ is skew-symmetric:
#
# $$ V = \tfrac12\,\dot e^{\mathsf T} M(x)\,\dot e + \tfrac12\,e^{\mathsf T} K e, \qquad
#    \dot V = -\,\dot e^{\mathsf T} B\,\dot e - \dot e^{\mathsf T} F_{ext} . $$
#
# Such a loop is *passive*: it gives to nobody, person or table, more energy than it holds or was given. The
# default law cancels all of $C\dot x$; its account is off by
# $\tfrac12 \dot e^{\mathsf T} \dot M(x) \dot e$.

# %%
from scipy.integrate import cumulative_simpson

from vic_toolbox.spatial import rotation_exp

away = Reference(pose_from([0.50, 0.15, 0.35], rotation_exp([0.0, 0.0, 0.4]) @ tool_down))
lively = ImpedanceGains(stiffness, double_diagonalisation(stiffness, space.mass, damping_ratio=0.2))


def account(coriolis):
    """Kinetic, spring and dissipated energy over time [J], on the way from `start` to `away`."""
    law = CartesianLaw(model=arm, coriolis=coriolis)

    def torque(t, q, v):
        return law.impedance(q, v, reference=away, gains=lively).torque

    motion = simulate(arm, torque, q=start, duration=1.5, timestep=STEP)
    e, rate = motion.error(away)
    mass = arm.operational_space(motion.q, motion.v).mass
    kinetic = 0.5 * np.einsum("ti,tij,tj->t", rate, mass, rate)
    spring = 0.5 * np.einsum("ti,ij,tj->t", e, stiffness, e)
    power = np.einsum("ti,ij,tj->t", rate, lively.damping, rate)
    return motion.time, kinetic, spring, cumulative_simpson(power, x=motion.time, initial=0.0)


figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.1), width_ratios=(1.3, 1))
for coriolis, colour in (("exact", ORANGE), ("reference", BLUE)):
    t, *energies = account(coriolis)
    total = np.sum(energies, axis=0)
    right.plot(t, total - total[0], color=colour, label=f'coriolis="{coriolis}"')
    print(f'coriolis="{coriolis}": {total[0]:.1f} J stored, {total[-1] - total[0]:.3f} J added by the motors')
names = ("motion", "spring", "dissipated")
left.stackplot(t, *energies, colors=("#e69f00", BLUE, "#cbd2d9"), labels=names)  # of the passive law
left.set(title="the passive law: every joule is accounted for", ylabel="energy  [J]", xlim=(0, t[-1]))
left.legend(loc="center right", frameon=True, facecolor="white", edgecolor="none")
right.set(title="energy that the motors add", ylabel="energy  [J]")
right.legend()
for panel in (left, right):
    panel.set_xlabel("time  [s]")
plt.show()

# %% [markdown]
# **What to see.** Left: the spring's energy turns into motion and back, and ends in the damper. Right: the
# passive law's account closes to the accuracy of the integration. The exact law (the default) makes the
# motion the simpler mass, spring and damper, and pays for it: here the motors add a few joules that neither
# spring nor hand has given. It is a trade, and `coriolis=` chooses.
#
# ## 5 · Coupling, and a chosen inertia
#
# $M(x)$ is not diagonal. A push along $y$ therefore accelerates the cup along other axes too, until spring
# and damper sort it out. With a measured $F_{ext}$ the law can replace the inertia by a chosen $M_d$:
#
# $$ F = F_{ff} + M(x)\,M_d^{-1}\,(F_{fb} - F_{ext}) + F_{ext} \quad\Longrightarrow\quad
#    M_d\,\ddot e + B\,\dot e + K e = -F_{ext} . $$

# %%
reach = posture(0.35, -0.35, 0.45)
inertia = np.diag([6.0, 6, 6, 0.3, 0.3, 0.3])  # kg, kg m²
diagonal = ImpedanceGains(stiffness, double_diagonalisation(stiffness, inertia, damping_ratio=0.3))
sideways = [0.0, 10.0, 0.0, 0.0, 0.0, 0.0]  # 10 N along y
laws = {
    "the arm's own $M(x)$": CartesianLaw(model=arm),
    "a chosen, diagonal $M_d$": CartesianLaw(model=arm, inertia=inertia),
}

figure, grid = plt.subplots(2, 2, figsize=(9.0, 4.4), sharex=True, sharey="row")
for column, (name, chosen) in zip(grid.T, laws.items(), strict=True):
    t, e = pushed(diagonal, sideways, law=chosen, q=reach)
    for axis, colour in zip(range(3), (GREEN, BLUE, ORANGE), strict=True):
        column[0].plot(t, 1e3 * e[:, axis], color=colour, label=f"along {'xyz'[axis]}")
        column[1].plot(t, np.degrees(e[:, 3 + axis]), color=colour, label=f"about {'xyz'[axis]}")
    column[0].set_title(f"10 N along y, {name}")
    column[1].set(xlabel="time  [s]", xlim=(0, t[-1]))
for panel in grid.flat:
    panel.axvspan(0.1, 1.2, color=style.GRID, alpha=0.6, lw=0)
for row, label in zip(grid, ("displacement  [mm]", "rotation  [°]"), strict=True):
    row[0].set_ylabel(label)
    row[1].legend(loc="upper right")
plt.show()

# %% [markdown]
# **What to see.** Left: a push along $y$ also moves the cup along $x$ and $z$, and tilts it. Right: with
# $M_d$ it moves along $y$ only, as a mass of 6 kg. The price is a force sensor, and a limit: with delay in
# the measurement, $M_d$ cannot be made much lighter than $M(x)$ before contact becomes unstable.
#
# ## 6 · Why the terms must be exact
#
# A common shortcut compensates the joint-space bias and adds the spring:
# $\tau = C\dot q + g + J^{\mathsf T}F_{fb}$. At rest that is the same law. In motion it leaves out a term,
#
# $$ C(x,\dot x)\,\dot x = J^{-\mathsf T} C\,\dot q - M(x)\,\dot J\,\dot q , $$
#
# the force that comes from the Jacobian's own change. Measure what is left of the promised behaviour,
# $r = M(x) \ddot e + B \dot e + K e$, on a fast reach to the plate; $\ddot e$ by finite differences, as in
# a laboratory.

# %%
from vic_toolbox.control import feedback_wrench
from vic_toolbox.tasks import cup_scene
from vic_toolbox.tasks.cup_on_plate import GAINS

goal = Reference(pose_from(cup_scene.GOAL, tool_down))
fast = GAINS.to_gains([1, 1, 1, 1, 1, 1, -1])  # the task's largest stiffness, 200 N/m, and smallest damping


def exact(t, q, v):
    return law.impedance(q, v, reference=goal, gains=fast).torque


def shortcut(t, q, v):
    wrench = feedback_wrench(*law.error(q, v, reference=goal), gains=fast)
    return arm.bias(q, v) + np.vecmat(wrench, arm.jacobian(q))


figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.1))
for name, torque, colour in (("exact", exact, BLUE), ("shortcut, without J̇", shortcut, ORANGE)):
    motion = simulate(arm, torque, q=reach, duration=1.5, timestep=STEP / 2)
    t, (e, rate) = motion.time, motion.error(goal)
    mass = arm.operational_space(motion.q, motion.v).mass
    inertial = np.matvec(mass, np.gradient(rate, t, axis=0))
    residual = np.linalg.norm((inertial - feedback_wrench(e, rate, gains=fast))[:, :3], axis=1)
    residual[[0, 1, -1]] = np.nan  # one-sided differences
    panels[0].plot(t, np.linalg.norm(rate[:, :3], axis=1), color=colour)
    panels[1].plot(t, residual, color=colour, label=f"{name}: {np.nanmax(residual):.1f} N at most")
    panels[2].plot(e[:, 1] + cup_scene.GOAL[1], e[:, 0] + cup_scene.GOAL[0], color=colour)
panels[0].set(title="speed of the cup", xlabel="time  [s]", ylabel="speed  [m/s]")
panels[1].set(title="force that nobody exerts, ‖r‖", xlabel="time  [s]", ylabel="force  [N]")
panels[2].set(title="path from above, stretched", xlabel="y  [m]", ylabel="x  [m]", ylim=(0.3, 0.45))
figure.legend(loc="outside upper center", ncols=2)
plt.show()

# %% [markdown]
# **What to see.** At 1 m/s the shortcut acts on the cup with tens of newtons that are in nobody's equation,
# and bends the path by centimetres. Anything that is later *estimated* or *learned* from such a loop, gains
# in particular, inherits that error. The exact law's small residual is that of the finite differences.
#
# ## 7 · Contact, and why one would vary the impedance
#
# Now MuJoCo, with a table and a plate. `CupOnPlate` simulates a batch of arms in closed loop, the law
# compiled and at 1 kHz. Several arms hold the cup 30 mm above the plate and pull it to a point 20 mm
# *below* its surface, each with its own stiffness:

# %%
(x, y), top = cup_scene.PLATE, cup_scene.PLATE_TOP
above, depth = posture(x, y, top + 0.03), 0.02
levels = np.geomspace(50.0, 3200.0, 4 if FAST else 7)  # N/m
contact = CupOnPlate().simulation(len(levels))
mass = arm.operational_space(above, rest).mass


def press(ratio):
    """Contact force over time (T, n) [N] with every stiffness, for a damping ratio."""
    contact.reset(above, position=(x, y, top - depth), quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
    contact.stiffness[:] = np.array([[k, k, k, 50, 50, 50] for k in levels])
    for k, damping in zip(contact.stiffness, contact.damping, strict=True):
        damping[:] = np.diag(double_diagonalisation(np.diag(k), mass, damping_ratio=ratio))
    forces = []
    for _ in range(1500):
        contact.step(1)
        forces.append(contact.contact_force)
    return np.array(forces)


well, poorly = press(1.0), press(0.3)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.3))
shades = plt.colormaps["viridis"](np.linspace(0.85, 0.1, len(levels)))
for k, force, colour in zip(levels, well.T, shades, strict=True):
    left.plot(np.arange(1500) * 1e-3, force, color=colour, lw=1.3, label=f"{k:.0f} N/m")
left.set(title="force on the plate (ζ = 1)", xlabel="time  [s]", xlim=(0, 1.5), ylim=(0, 150))
left.legend(fontsize=7.5)
right.loglog(levels, levels * depth, color=GREY, lw=1, label="K × 20 mm")
right.loglog(levels, well[-1], "o", color=BLUE, label="at rest")
right.loglog(levels, well.max(axis=0), "^-", color=GREEN, lw=1, label="impact, ζ = 1")
right.loglog(levels, poorly.max(axis=0), "v-", color=ORANGE, lw=1, label="impact, ζ = 0.3")
right.set(title="the force that stays, and the one that hits", xlabel="stiffness  [N/m]")
right.legend()
for panel in (left, right):
    panel.set_ylabel("contact force  [N]")
plt.show()

# %% [markdown]
# **What to see.** At rest the plate carries $K$ times the 20 mm, without any force control. The first touch
# is another matter: it grows with the speed of arrival, hence with the stiffness and with too little
# damping. (Its height also depends on how hard the simulated plate is.) Soft and well damped is gentle, but
# it is also slow, and *constant* gains must choose. An expert does not: **stiff and lightly damped while
# far, soft and well damped when near**.
#
# `ThreePhaseExpert` is that rule, with $s$ the distance to the goal and a blend between 0.4 and 0.2 m. The
# score of Cup-on-Plate asks for both virtues: the position error counts while far ($s > 0.2$ m), the speed
# while near ($s \le 0.4$ m).

# %%
from vic_toolbox.control import ConstantGains, ThreePhaseExpert
from vic_toolbox.tasks import VectorEnvironment

task = CupOnPlate()
starts = list(task.scenarios)


def play(act, scenarios):
    """One episode from each start: what was seen (T, n, 12), contact forces (T, n) [N], how it ended."""
    environment = VectorEnvironment(task, len(scenarios), start_noise=0.0)
    observation, _ = environment.reset(options={"scenarios": scenarios})
    seen, touch = [], []
    for _ in range(task.horizon):
        seen.append(observation)
        observation, *_, info = environment.step(act(observation))
        touch.append(environment.simulation.contact_force)
    return np.array(seen), np.array(touch), info


policies = {
    "expert": ThreePhaseExpert(parametrisation=GAINS, far=0.4, near=0.2),
    "constant": ConstantGains(parametrisation=GAINS, level=0.5),
}
episodes = {name: play(policy.action, starts) for name, policy in policies.items()}

# %%
i = starts.index("T1")
figure, panels = plt.subplots(1, 4, figsize=(9.0, 2.7))
for (name, (seen, touch, _)), colour in zip(episodes.items(), (BLUE, GREEN), strict=True):
    parameters = policies[name].parameters(seen[:, i])
    speed = np.linalg.norm(seen[:, i, 6:9], axis=1)
    force = np.convolve(touch[:, i], np.full(10, 0.1))[: task.horizon]
    for panel, curve in zip(panels, (parameters[:, 2], parameters[:, 6], speed, force), strict=True):
        panel.plot(task.dt * np.arange(task.horizon), curve, color=colour, label=name, lw=1.6)
titles = ("stiffness along z  [N/m]", "damping factor d  [√kg]", "speed  [m/s]", "contact, 0.1 s mean  [N]")
for panel, title in zip(panels, titles, strict=True):
    panel.set(title=title, xlabel="time  [s]")
panels[3].set_xlim(left=3.0)
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
plt.show()

# %%
figure, (plan, side) = plt.subplots(1, 2, figsize=(9.0, 3.2), width_ratios=(1.25, 1))
for (name, (seen, *_)), look in zip(episodes.items(), ({"lw": 5, "alpha": 0.3}, {"lw": 1.2}), strict=True):
    x, y, z = np.moveaxis(seen[..., :3] + cup_scene.GOAL, -1, 0)  # (T, 5) each
    distance = np.hypot(seen[..., 0], seen[..., 1])
    colour = {"expert": BLUE, "constant": GREEN}[name]
    plan.plot(y, x, color=colour, label=[name, *[None] * 4], **look)
    side.plot(distance, z, color=colour, **look)
for i, start_name in enumerate(starts):
    place = {"textcoords": "offset points", "fontsize": 8, "weight": "bold"}
    plan.annotate(start_name, (y[0, i], x[0, i]), (-8, 6), **place)
    side.annotate(start_name, (distance[0, i], z[0, i]), (5, 2), **place)
plan.add_patch(plt.Circle(cup_scene.PLATE[::-1], cup_scene.PLATE_RADIUS, color=style.GRID))
side.fill_between([0, cup_scene.PLATE_RADIUS], 0, cup_scene.PLATE_TOP, color=style.GRID)
plan.set(
    title="paths from above, the plate in grey",
    xlabel="y  [m]",
    ylabel="x  [m]",
    aspect="equal",
    ylim=(0.12, 0.7),
)
side.set(title="paths from the side", xlabel="horizontal distance to the goal  [m]", ylabel="height  [m]")
side.set(xlim=(0, 0.85), ylim=(0, 0.55))
figure.legend(loc="outside upper center", ncols=2)
plt.show()

# %% [markdown]
# Is there a constant gain that does as well? Try a grid over the whole range of stiffness and damping, from
# every start at once, and split the score into its two parts:

# %%
from vic_toolbox.tasks.cup_on_plate import FAR, NEAR, SCORE_WEIGHT

side_of_grid = np.linspace(-1, 1, 3 if FAST else 7)
grid = np.array([[*[k] * 6, d] for k in side_of_grid for d in side_of_grid])  # six stiffnesses, and d
tried, _, ends = play(lambda _: np.tile(grid, (len(starts), 1)), np.repeat(starts, len(grid)).tolist())


def parts(seen):
    """What the score takes off for being far, and for being fast when near."""
    distance = np.linalg.norm(seen[..., :3], axis=-1)
    far = SCORE_WEIGHT * np.sum((seen[..., :6] ** 2).sum(axis=-1) * (distance > NEAR), axis=0)
    return far, SCORE_WEIGHT * np.sum((seen[..., 6:] ** 2).sum(axis=-1) * (distance <= FAR), axis=0)


figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.4))
for panel, start_name in zip(panels, ("train", "T1"), strict=True):
    i = starts.index(start_name)
    of_start = slice(i * len(grid), (i + 1) * len(grid))
    far, fast_near = parts(episodes["expert"][0][:, i])
    panel.axline((far, fast_near), slope=-1, color=GREY, lw=0.9, ls=":", label="as good as the expert")
    panel.plot(*parts(tried[:, of_start]), "o", color=GREEN, ms=5, alpha=0.7, label="constant gains")
    panel.plot(far, fast_near, "*", color=BLUE, ms=15, label="expert")
    panel.set(title=f"start: {start_name}", xlim=(0, None), ylim=(0, None))
    panel.set(xlabel="penalty for being far", ylabel="penalty for being fast when near")
panels[1].legend()
plt.show()

best = ends["score"].reshape(len(starts), -1).max(axis=1)
expert, constant = (episodes[name][2] for name in ("expert", "constant"))
table = (expert["score"], best, constant["score"], expert["peak_force"], constant["peak_force"])
print("                      score                    hardest touch [N]")
print("start     expert   best constant   middle       expert   middle")
for name, row in zip(starts, np.transpose(table), strict=True):
    print("{:6} {:9.0f} {:15.0f} {:8.0f} {:12.1f} {:8.1f}".format(name, *row))

# %% [markdown]
# **What to see.** The paths are nearly the same; what differs is the timing. The expert is first the
# faster, then the slower one, and lands later and more softly (from the training start it is still 2 mm
# above the plate after the 5 s). Every constant gain pays with one penalty for the other, and all of them
# lie beyond the dotted line: from all five starts the schedule beats the best constant gain of the whole
# range, by 5 to 9 %. It needs no plan of the path, for the gains follow from what the arm sees.
#
# To write this rule down took an expert. Notebook 2 *learns* it, from demonstrations alone.
#
# ## 8 · The same law on other arms
#
# Nothing above knew which arm it was. A Panda has a seventh joint, so the hand leaves one motion free. The
# law keeps a posture there, through the dynamically consistent nullspace
#
# $$ \tau = J^{\mathsf T} F + N\,(C\dot q + g + \tau_0), \qquad N = I - J^{\mathsf T}\bar J^{\mathsf T}, \quad
#    \bar J = M^{-1} J^{\mathsf T} M(x), \quad \tau_0 = k_0\,(q_0 - q) - b_0\,\dot q . $$

# %%
from vic_toolbox.control import Posture

panda = load_robot("panda", armature=np.full(7, 0.1))  # this URDF names no rotor inertia: assumed
hold = Reference(panda.pose(panda.home))
elbow_out = Posture(panda.home + np.array([0.9, 0, -0.9, 0, 0, 0, 0]), stiffness=20.0, damping=5.0)
panda_mass = panda.operational_space(panda.home, np.zeros(7)).mass
gentle = ImpedanceGains(stiffness, double_diagonalisation(stiffness, panda_mass))
with_nullspace = CartesianLaw(model=panda, posture=elbow_out)
without = CartesianLaw(model=panda)


def projected(t, q, v):
    return with_nullspace.impedance(q, v, reference=hold, gains=gentle).torque


def added(t, q, v):  # the same posture torque, without the projection
    return without.impedance(q, v, reference=hold, gains=gentle).torque + elbow_out.torque(q, v)


figure = plt.figure(figsize=(9.0, 3.6))
arms, drift = figure.add_subplot(121, projection="3d"), figure.add_subplot(122)
for name, torque, colour in (("through N", projected, BLUE), ("without N", added, ORANGE)):
    motion = simulate(panda, torque, q=panda.home, duration=3.0, timestep=STEP)
    t, (e, _) = motion.time, motion.error(hold)
    drift.plot(t, 1e3 * np.linalg.norm(e[:, :3], axis=1), color=colour, label=name)
    if torque is projected:
        for shade, sample in zip((0.25, 0.45, 1.0), (0, len(t) // 20, -1), strict=True):
            posture_then = motion.q[sample]
            bones = np.array([panda.pose(posture_then, frame=link)[:3, 3] for link in panda.frame_names])
            arms.plot(*bones.T, "-o", color=BLUE, alpha=shade, lw=2.5, ms=4)
arms.set(title="the elbow swings out, the hand stays", xlabel="x  [m]", ylabel="y  [m]", zlabel="z  [m]")
arms.set(xlim=(-0.1, 0.4), ylim=(-0.3, 0.1), zlim=(0, 0.8), xticks=[0, 0.2, 0.4], yticks=[-0.2, 0])
arms.view_init(elev=20, azim=-35)
arms.set_box_aspect((0.5, 0.4, 0.8), zoom=1.1)
drift.set(title="how far the posture moves the hand", xlabel="time  [s]", ylabel="displacement  [mm]")
drift.legend()
plt.show()

# %% [markdown]
# **What to see.** Left: the first posture (pale), one on the way, and the last: the elbow moves by 15 cm,
# the hand stays. Right: the same posture torque without the projection drags the hand along by centimetres.
#
# Last, one impedance on three arms: a FANUC, a UR5 and a Panda, each in its own posture, pushed alike.

# %%
ur5 = load_robot("ur5", armature=np.full(6, 0.1))  # assumed, as above
fleet = {
    "FANUC LR Mate": (arm, start, BLUE, "-"),
    "UR5": (ur5, np.array([0.3, -1.1, 1.6, -2.1, -1.57, 0.0]), ORANGE, "--"),
    "Panda": (panda, panda.home, GREEN, ":"),
}
figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.1), sharey=True)
for name, (model, q, colour, dashes) in fleet.items():
    for panel, inertia_of_law in zip(panels, (None, inertia), strict=True):
        t, e = pushed(diagonal, sideways, law=CartesianLaw(model=model, inertia=inertia_of_law), q=q)
        panel.plot(t, 1e3 * e[:, 1], dashes, color=colour, lw=2, label=name)
for panel, title in zip(panels, ("each arm's own $M(x)$", "the same $M_d$ on all"), strict=True):
    panel.axvspan(0.1, 1.2, color=style.GRID, alpha=0.6, lw=0)
    panel.set(title=f"10 N along y, {title}", xlabel="time  [s]", xlim=(0, t[-1]))
panels[0].set_ylabel("displacement along y  [mm]")
panels[0].legend()
plt.show()

# %% [markdown]
# **What to see.** With the same $K$ and $B$ all three give way by the same 20 mm, but they move there as
# their own masses demand. With the same $M_d$ the three curves are one: by feel, nobody could tell the
# robots apart.
#
# ## Where to go from here
#
# - Change something: `stiffness` and `ratio` in section 2, the start of the reach in section 6, `levels` in
#   section 7.
# - Your own arm: `load_robot("my_arm.urdf", frame="my_tool")`.
# - [Notebook 2](02_learning_a_skill.ipynb) learns the expert's schedule from demonstrations and carries it
#   over.
# - The documentation: *The impedance law* derives what was used here, *Conventions* says units and signs
#   once.
