# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 2 · Learning a skill: from demonstrations to a reward that travels
#
# Notebook 1 ended with a rule: *stiff and lightly damped while far, soft and well damped when near*. An
# expert wrote it down. Here nobody writes anything down: the rule is **learned from demonstrations**, as a
# policy that can be run and as a reward that can be optimised again somewhere else. Nine steps:
#
# 1. what the expert shows
# 2. the shortest way: behaviour cloning
# 3. a reward from demonstrations: why $r - \log\pi$, and why a bounded slope
# 4. training: adversarial inverse reinforcement learning (AIRL)
# 5. what the learned reward values
# 6. the skill over time
# 7. elsewhere, without further learning
# 8. transfer: optimise the frozen reward where no demonstration was
# 9. what this shows, and what it does not
#
# The equations are derived in the documentation, page *Learning a skill*; the method is that of Zhang et
# al. (2021). On four cores the notebook takes two to four minutes.

# %%
import os
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import torch
from IPython.display import display

from vic_toolbox import tasks
from vic_toolbox.experiments.figures import style

FAST = os.environ.get("VIC_FAST") == "1"  # small settings, for a quick check that everything runs
SEED = 0
torch.set_num_threads(1)  # the networks are too small to share between threads; the simulations have them all
plt.rcParams.update(style.RC | {"figure.dpi": 110, "figure.constrained_layout.use": True})
BLUE, ORANGE, GREEN, PINK, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", style.QUIET

# %% [markdown]
# ## 1 · What the expert shows
#
# **Cup-on-Plate**, in one paragraph: an arm puts a cup on a plate. A hundred times a second a policy sees
# the pose error and its rate, $o = (e, \dot e)$, and chooses an action $a \in [-1, 1]^7$: six stiffnesses
# and a damping factor $d$. The score punishes the error while far ($s > 0.2$ m) and the speed while near
# ($s \le 0.4$ m), with $s$ the distance to the goal.
#
# `record` lets the expert do it 60 times from the training start; ten of the recordings are held out, to
# judge the learning. While the expert works somebody **pushes** the cup, at random and gently (5 N), so
# that the recordings also say what to do *beside* the path.

# %%
from vic_toolbox.experiments.trace import record_trace

task = tasks.make("cup-on-plate", action="gain")
count, held_out = (6, 2) if FAST else (50, 10)
shown = tasks.record(task, count + held_out, seed=SEED, threads=0)
quiet = tasks.record(task, count + held_out, seed=SEED, push=0.0, threads=0)  # for comparison


def expert_trace(scenario):
    """One episode of the expert from a named start, or from a point (x, y, z) [m]."""
    there = tasks.make("cup-on-plate", scenario=scenario)
    return record_trace(there, there.expert_action)


expert_traces = {name: expert_trace(name) for name in task.scenarios}
goal = expert_traces["train"].goal
print(f"{len(shown)} demonstrations of {task.horizon} steps, score {shown.scores.mean():.0f} on average")

# %%
errors = shown.observations[:, :-1, :3]  # (n, T, 3) [m]
distance = np.linalg.norm(errors, axis=-1)
time = task.dt * np.arange(task.horizon)

figure, (plan, spread, share) = plt.subplots(1, 3, figsize=(9.0, 2.9), width_ratios=(1.5, 1, 1))
for path in errors + goal:
    plan.plot(path[:, 1], path[:, 0], color=BLUE, lw=0.6, alpha=0.3)
for name, trace in expert_traces.items():
    if name != "train":
        plan.plot(trace.path[:, 1], trace.path[:, 0], color=GREY, lw=1.2, ls=":")
    place = (6, -12) if name == "T3" else (-22, 6)
    plan.annotate(name, trace.path[0, [1, 0]], place, textcoords="offset points", weight="bold")
plan.add_patch(plt.Circle(goal[[1, 0]], 0.08, color=style.GRID))
plan.set(title="from above, the plate in grey", xlabel="y  [m]", ylabel="x  [m]", aspect="equal")
plan.set(xlim=(-0.5, 0.55), ylim=(0.1, 0.75))
for recording, colour, name in ((shown, BLUE, "pushed"), (quiet, ORANGE, "not pushed")):
    deviation = np.linalg.norm(recording.observations[:, :-1, :3].std(axis=0), axis=-1)
    spread.plot(time, 1e3 * deviation, color=colour, label=name)
spread.set(title="spread about the mean path", xlabel="time  [s]", ylabel="standard deviation  [mm]")
spread.set(xlim=(0, 5), ylim=(0, None))
spread.legend()
percent = np.full(distance.size, 100 / distance.size)
share.hist(distance.ravel(), np.arange(0, 0.65, 0.05), weights=percent, color=BLUE, alpha=0.35)
share.set(title="where the samples are", xlabel="distance to the goal  [m]", ylabel="share  [%]")
rule = share.twinx()
rule.plot([0, 0.2, 0.4, 0.6], [60, 60, 200, 200], color=style.INK, lw=1.4)
rule.set(ylabel="the expert's stiffness  [N/m]", ylim=(0, 220), yticks=[60, 130, 200])
rule.grid(False)
plt.show()

# %% [markdown]
# **What to see.** Left: the demonstrations (blue) are a tube of a few centimetres around *one* path; the
# starts T1-T4 and the expert's ways from there (dotted, never shown to a learner) lie outside. Middle: the
# pushes keep the tube open to the end, where an undisturbed expert shows hardly more than one point. Right:
# two samples in three are within 0.1 m of the goal, where the rule (black) is constant; the part of the way
# where it changes is short. Learning therefore draws its minibatches evenly over the distance.
#
# ## 2 · The shortest way: behaviour cloning
#
# Regress the expert's action on the observation, $\min_\theta \mathbb E\,\lVert\mu_\theta(o) - a\rVert^2$.
# The policy is a Gaussian whose mean $\mu_\theta$ is a tanh network of 2 × 32 units.

# %%
from vic_toolbox.learning import ExpertData, GaussianPolicy, clone, recipe

settings = recipe("cup-on-plate", action="gain", history=1)  # every hyper-parameter, with its documentation
if FAST:
    search = replace(settings.airl.search, environments=4)
    settings = replace(
        settings,
        airl=replace(settings.airl, search=search),
        transfer=replace(settings.transfer, search=search),
        cloning=replace(settings.cloning, steps=400),
    )


def prepare(observations, actions, held_out):
    """An untrained policy, and demonstrations (n, T + 1, 12), (n, T, 7) as rows for learning."""
    search = settings.airl.search
    policy = GaussianPolicy(
        task.observation_scale, task.action_size, hidden=search.hidden, log_std=search.log_std, seed=SEED
    )
    bounds = (task.action_low, task.action_high)
    return policy, ExpertData.from_trajectories(
        observations, actions, policy=policy, bounds=bounds, held_out=held_out
    )


cloned, expert = prepare(shown.observations, shown.actions, held_out)
error = clone(cloned, expert, configuration=settings.cloning, rng=np.random.default_rng(SEED))
print(f"error of the action on held-out demonstrations: {error:.3f} RMS, where the range is ±1")

# %% [markdown]
# A policy is judged by its *mean* action, beside the expert on the very same starts. The number in all that
# follows is the **gap** $(S_{expert} - S)/|S_{expert}|$: zero is as good as the expert, negative is better.

# %%
from vic_toolbox.experiments.evaluation import Policy, judge

policies = {"bc": Policy(cloned.mean, "bc"), "constant": Policy.constant(task)}


def compare(policies, scenarios):
    """Print the gap of each policy from each start, and mark those where a cup did not stand in the end."""
    print(f"{'gap to the expert':28}" + "".join(f"{scenario:>9}" for scenario in scenarios))
    there = [tasks.make("cup-on-plate", scenario=scenario) for scenario in scenarios]
    columns = [judge(task, policies, episodes=2 if FAST else 10) for task in there]
    for name in policies:
        cells = [
            f"{100 * column[name].signed_difference:+6.1f} %{' ' if column[name].success_rate == 1 else '!'}"
            for column in columns
        ]
        print(f"{style.look(name).label:28}" + "".join(cells))


compare(policies, ["train"])

# %% [markdown]
# **What to see.** Cloning is all but perfect here: the rule is a plain function of what the policy sees,
# and the demonstrations say its value at every step. Remember that when it comes to comparing methods. What
# cloning does *not* give is anything that could be optimised when the task changes.
#
# ## 3 · A reward from demonstrations
#
# Train a discriminator to tell the expert's samples $(o, a)$ from those of a policy $\pi$. At its best its
# logit is $\log p_E(a|o) - \log\pi(a|o)$: it depends on the policy, and when the policy has become as good
# as the expert, nothing is left of it. AIRL (Fu et al., 2018) writes the policy's part in by hand,
#
# $$ D = \frac{\exp r(o,a)}{\exp r(o,a) + \pi(a|o)}, \qquad \text{logit } D = r(o,a) - \log\pi(a|o), $$
#
# so that a network $r$ has to learn the expert's part alone: $r = \log p_E(a|o)$, up to a term of $o$ that
# says which of the two is there more often. See it in one dimension, without any robot: the expert's
# actions are drawn from $N(0.5,\,0.3^2)$, and three different policies stand against it.

# %%
from vic_toolbox.learning import DiscriminatorConfiguration, RewardNetwork
from vic_toolbox.learning.reward import train_discriminator

grid = np.linspace(-2.0, 2.5, 400)


def log_normal(a, mean, std):
    return -0.5 * ((a - mean) / std) ** 2 - np.log(std * np.sqrt(2 * np.pi))


def fit(expert_std, policy, *, bound=None, steps=2000):
    """r(a) on the grid: actions N(0.5, expert_std²) of an expert, against a policy N(mean, std²)."""
    rng = np.random.default_rng(SEED)

    def samples(mean, std, count=20_000):
        a = mean + std * rng.standard_normal(count)
        z = torch.tensor(np.stack([0 * a, a], axis=1), dtype=torch.float32)  # (o, a), with o = 0
        return z, torch.tensor(log_normal(a, *policy), dtype=torch.float32), np.zeros(count, dtype=int)

    reward = RewardNetwork(1, 1, seed=SEED)
    train_discriminator(
        reward,
        samples(0.5, expert_std),
        samples(*policy),
        slope_bound=bound or 0.0,
        learning_rate=2e-3,
        configuration=DiscriminatorConfiguration(
            steps=steps // 10 if FAST else steps, penalty=10.0 if bound else 0.0
        ),
        rng=rng,
    )
    z = torch.tensor(np.stack([0 * grid, grid], axis=1), dtype=torch.float32)
    return reward.value(z).numpy()


figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.1), sharey=True)
for policy, colour in (((-0.6, 0.7), ORANGE), ((0.2, 0.5), GREEN), ((0.5, 0.9), BLUE)):
    r = fit(0.3, policy)
    logit = r - log_normal(grid, *policy)
    name = f"against $N({policy[0]},\\, {policy[1]}^2)$"
    left.plot(grid, logit - logit.max(), color=colour, label=name)
    right.plot(grid, r - r.max(), color=colour, label=name)
truth = log_normal(grid, 0.5, 0.3)
right.plot(grid, truth - truth.max(), color=style.INK, ls="--", lw=1.2, label=r"$\log p_E$")
left.set(title=r"the whole logit, $\log p_E - \log\pi$", ylabel="less its largest value", ylim=(-10, 0.6))
right.set_title(r"its part $r$")
for panel in (left, right):
    panel.set(xlabel="action", xlim=(-1, 2))
right.legend(fontsize=7.5)
plt.show()

# %% [markdown]
# **What to see.** Left: three policies, three discriminators. Right: their rewards are one curve, the log
# density of the expert (dashed). It no longer knows which policy it was trained against, so it can be
# frozen and handed to another one. To maximise $\mathbb E\sum_t r - \log\pi$, the log-odds of looking like
# the expert, is reinforcement learning with an entropy bonus.
#
# **And a deterministic expert?** Ours is one: its action is a function of the observation. There is no
# density $p_E$, any action that is off by a hair can be told apart, and the best reward is a needle: the
# expert's action, and minus infinity beside it. The remedy is a bound on the slope, a penalty on
# $\lVert\partial r/\partial(o,a)\rVert > L$:

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.1))
policy = (-0.5, 0.6)
for steps, colour in ((300, GREEN), (1000, BLUE), (3000, ORANGE)):
    r = fit(1e-6, policy, steps=steps)
    left.plot(grid, r - r.max(), color=colour, label=f"after {steps} steps")
for bound, colour in ((2, GREEN), (4, BLUE), (8, ORANGE)):
    r = fit(1e-6, policy, bound=bound)
    right.plot(grid, r - r.max(), color=colour, label=f"L = {bound}")
left.set(title="deterministic expert, no bound", ylabel="reward, less its largest value")
right.set(title="deterministic expert, slope at most L", ylim=(-20, 1))
for panel in (left, right):
    panel.set(xlabel="action", xlim=(-1.5, 2.5))
    panel.legend(loc="lower right")
plt.show()

# %% [markdown]
# **What to see.** Left: the longer the training, the sharper the needle, without end. Right: a tent of
# slope $L$ with its top at the expert's action. The slope has a meaning, too. The policy that maximises
# reward plus entropy is $\pi \propto \exp r$, here $\exp(-L\lVert a - a_E\rVert)$, and its standard
# deviation along each of $n$ actions is $\sigma = \sqrt{n+1}/L$. **The bound says how much the policy
# goes on exploring**: with our seven actions 0.7 at $L = 4$, and 0.35 at $L = 8$.
#
# ## 4 · Training
#
# One iteration of AIRL: roll the policy out in 20 simulations (10 000 steps), train the discriminator for a
# few steps, relabel the rollouts with $r - \log\pi$, take one TRPO step. The bound is sharpened from 4 to 8
# as soon as the action error on held-out demonstrations is small, and of the sharpest iterations the one
# with the smallest such error is kept. The score takes part in no decision; it is only shown.
#
# `replay` lets the discriminator see samples of ten earlier policies besides those of the present one. In the
# end that one is much like the expert, and a reward that meets nobody else forgets what it knew about the
# others; a *fresh* policy, which must be led from afar, would suffer most (section 8). What expert samples are
# told from is then a mixture, and $\pi$ in $D = e^r/(e^r + \pi)$ is the density of that mixture.

# %%
from vic_toolbox.experiments.figures.learning import learning_curves
from vic_toolbox.experiments.training import mean_score
from vic_toolbox.learning import Airl

iterations = 4 if FAST else 100  # the recipe's 200 are a little better
airl = replace(settings.airl, iterations=iterations)
environment = tasks.VectorEnvironment(task, airl.search.environments, threads=0)
learner = Airl(environment, expert, configuration=airl, seed=SEED)

expert_score = mean_score(task, task.expert_action)
metrics, curves = [], display(display_id=True)
while not learner.finished:
    metrics.append(learner.iterate())
    if len(metrics) % (2 if FAST else 10) == 0:  # have a look
        metrics[-1]["mean_score"] = mean_score(task, learner.search.averaged_policy().mean)
        curves.update(learning_curves(metrics, expert_score=expert_score, name="airl"))

policy, reward = learner.result()
policies = {"airl": Policy(policy.mean, "airl"), **policies}

# %% [markdown]
# **What to see.** The score is near the expert's after 40 iterations, for it forgives a lot; the action
# error needs a little longer. The discriminator never reaches 100 %, and the exploration $\sigma$ is
# about what the tent promised: 0.8 to 0.9 at $L = 4$ (the expert's actions carry some noise besides), 0.4
# in the end, where $L$ is 8.
#
# Now the same **without the bound**, without replay and without the noise on the expert's actions: AIRL as
# in the textbook.

# %%
textbook = replace(
    airl,
    iterations=min(iterations, 50),
    replay=0,
    discriminator=replace(airl.discriminator, penalty=0.0),
    expert_noise=1e-3,
    expert_noise_final=1e-3,
)
plain = Airl(environment, expert, configuration=textbook, seed=SEED)
plain_metrics = []
while not plain.finished:
    plain_metrics.append(plain.iterate())

# %%
figure, panels = plt.subplots(1, 3, figsize=(9.0, 2.8))
for rows, colour, name in ((metrics, BLUE, "bounded slope"), (plain_metrics, ORANGE, "no bound")):
    iteration = [row["iteration"] for row in rows]
    panels[0].plot(iteration, [100 * row["discriminator_accuracy"] for row in rows], color=colour, label=name)
    panels[1].plot(iteration, np.exp([row["log_std"] for row in rows]), color=colour)
    panels[2].plot(iteration, [row["action_error"] for row in rows], color=colour)
panels[0].set(title="discriminator told right  [%]", ylim=(50, 101))
panels[1].set(title="exploration σ", ylim=(0, None))
panels[2].set(title="held-out action error", ylim=(0, None))
for panel in panels:
    panel.set_xlabel("iteration")
figure.legend(loc="outside upper center", ncols=2)
plt.show()

# %% [markdown]
# **What to see.** Without the bound the discriminator is right practically always. Its reward falls off so
# steeply that the policy's best answer is to stop exploring (the needle's $\sigma$ is zero) before its mean
# is where the expert's is. Then it is stuck: the action error is no better than before training.
#
# ## 5 · What the learned reward values
#
# A reward over 12 observations and 7 actions cannot be drawn, a slice of it can. The expert turns one
# knob: from soft and well damped, $a = (-1, \dots, -1, +1)$, to stiff and lightly damped, $a = (1, \dots,
# 1, -1)$. Turn it at the states of an episode of the expert, and see what $r$ thinks of each position: at
# the left on the training path, at the right on a path that comes from **the other side** of the plate,
# where no demonstration was.

# %%
from vic_toolbox.experiments.figures.reward import RewardSlice, reward_landscape

OTHER_SIDE = (-0.10, 0.65, 0.35)  # [m]
expert_traces["other side"] = expert_trace(OTHER_SIDE)
direction = np.array([1.0, 1, 1, 1, 1, 1, -1])
knob = np.linspace(-1, 1, 61)


def newtons_per_metre(a):
    return 130 + 70 * a  # of the translations


def turned(reward, name):
    """The reward at the states of the expert's episode, for every position of the knob."""
    trace = expert_traces[name]
    levels = np.linspace(trace.distance[0], 0.02, 80)
    states = trace.observations[np.unique([np.argmax(trace.distance <= level) for level in levels])]
    inputs = policy.scaled(states).repeat_interleave(len(knob), dim=0)
    actions = torch.tensor(knob[:, None] * direction, dtype=torch.float32).repeat(len(states), 1)
    chosen = {"expert": task.expert_action(states), "airl": policy.mean(states).clip(-1, 1)}
    return RewardSlice(
        name=f"{name}: stiffness of the knob  [N/m]",
        value=newtons_per_metre(knob),
        distance=np.linalg.norm(states[:, :3], axis=1),
        reward=reward.value(torch.cat([inputs, actions], dim=1)).numpy().reshape(len(states), -1),
        chosen={method: newtons_per_metre(a @ direction / 7) for method, a in chosen.items()},
    )


display(reward_landscape([turned(reward, "train"), turned(reward, "other side")]))

# %% [markdown]
# **What to see.** Pale is what the reward likes best at that distance. On the training path the pale
# ridge *is* the expert's rule (dashed): stiff beyond 0.4 m, soft below 0.2 m, a blend between; the policy
# runs along it. On the other side reward and policy agree as well, but with each other and not with the
# expert: they would be soft all the way. Both have only ever seen one side, where the distance and the
# place along one path are the same thing. **A learned reward extrapolates no better than its data.** Keep
# this picture for section 8.
#
# ## 6 · The skill over time
#
# One episode from the training start, the mean action of each policy:

# %%
from vic_toolbox.experiments.figures.motion import gains_over_time

traces = {"expert": expert_traces["train"]}
traces |= {name: record_trace(task, judged.act) for name, judged in policies.items()}
display(gains_over_time(traces))

# %% [markdown]
# **What to see.** AIRL has found the schedule: stiff first, soft from 1 s on, the damping the other way
# round. Between them it switches where the expert blends. Cloning lies on the expert's line. The constant
# gains are those of the middle of the range, and the distance shows what they cost: later at first, then
# too fast on the plate.
#
# ## 7 · Elsewhere, without further learning
#
# The same policies from starts that no demonstration began at, as they are:

# %%
compare(policies, list(task.scenarios))

# %% [markdown]
# All of them carry over: AIRL is within two per cent, and cloning even beats the expert at its own score.
# On four starts the two can hardly be told apart. So try starts on rings all around the plate, wherever
# the arm can begin:

# %%
from matplotlib.colors import TwoSlopeNorm

from vic_toolbox.experiments.start_sweep import StartGrid, sweep_starts


def sweep(policies):
    """The starts and scores around the plate, and the gap of each policy at each start [%]."""
    rings = StartGrid(rings=2, bearings=6) if FAST else StartGrid(rings=5, bearings=24)
    result = sweep_starts(task, policies, grid=rings)
    expert_score = result.score["expert"]
    gap = {name: 100 * (expert_score - result.score[name]) / np.abs(expert_score) for name in policies}
    return result, gap


result, gap = sweep(policies)
colours = {"cmap": "PuOr_r", "norm": TwoSlopeNorm(0, -15, 60), "edgecolor": GREY, "lw": 0.5}

figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.9), width_ratios=(1, 1, 1.15))
for panel, name in zip(panels[:2], ("airl", "bc"), strict=True):
    points = panel.scatter(*result.starts[:, [1, 0]].T, c=gap[name], s=42, **colours)
    panel.plot(*errors[0][:, [1, 0]].T + goal[[1, 0], None], color=BLUE, lw=2)
    panel.plot(0, 0, "s", color="#f5dd90", mec=GREY, ms=9)
    panel.plot(*goal[[1, 0]], "*", color=style.INK, ms=10)
    panel.set(title=style.look(name).label, xlabel="y  [m]", aspect="equal")
panels[0].set_ylabel("x  [m]")
bar = {"orientation": "horizontal", "shrink": 0.6, "aspect": 30, "ticks": [-15, 0, 20, 40, 60]}
figure.colorbar(points, ax=panels[:2], label="gap to the expert  [%]", **bar)
shown_from = expert_traces["train"].path[0] - goal
turn = (result.bearing - np.degrees(np.arctan2(shown_from[1], shown_from[0])) + 180) % 360 - 180
for name in ("airl", "bc", "constant"):
    look = style.look(name)
    panels[2].plot(np.abs(turn), gap[name], "o", ms=4, color=look.colour, alpha=0.7, label=look.label)
panels[2].set(title="the same, by direction", xlabel="angle off the demonstrated direction  [°]")
panels[2].set(ylabel="gap to the expert  [%]", xticks=range(0, 181, 45))
panels[2].legend()
plt.show()

# %% [markdown]
# **What to see.** Robot (square), plate (star), and the demonstrated path (blue) from above. What matters
# is not so much how *far* a start is but in which *direction*: on the demonstrated side both policies are
# the expert's equal from a metre away, nearly twice as far as anything they saw. On the other side they
# are still good close by, where the rule is to be soft anyway; from farther away they lose half the score
# and more, and the constant gain is the better choice.
#
# ## 8 · Transfer: optimise the frozen reward
#
# Now the reward earns its keep. Freeze $r$ and let TRPO maximise $\mathbb E\sum_t r - \log\pi$ in the new
# place, with no expert and no score. Two ways:
#
# - **continued** from the trained policy: how a skill would be used;
# - **fresh**, from random weights: the test of the reward alone, since a continued policy may be good
#   already before it has seen the reward.
#
# And beside each the **control**: the same optimisation under an *untrained* random reward. What the
# control achieves too is no merit of what was learned.

# %%
from vic_toolbox.learning import Transfer

random_reward = RewardNetwork.for_task(task, seed=SEED + 100)


def optimise(reward, scenario, *, fresh):
    """The policy found in the new place, and (iteration, gap [%]) on the way."""
    there = tasks.make("cup-on-plate", scenario=scenario)
    simulations = 4 if FAST else 10  # half the recipe's, to save time
    iterations = 3 if FAST else 120 if fresh else 40
    configuration = replace(
        settings.transfer,
        iterations=iterations,
        fresh=fresh,
        divergence=0.03 if fresh else 0.01,  # trust region: a fresh policy has farther to go
        search=replace(settings.transfer.search, environments=simulations),
    )
    environment = tasks.VectorEnvironment(there, simulations, threads=0)
    learner = Transfer(environment, reward, policy, configuration=configuration, seed=SEED)
    expert_score = mean_score(there, there.expert_action)
    curve = []
    for iteration in range(iterations + 1):
        if iteration % 10 == 0 or learner.finished:
            score = mean_score(there, learner.result().mean)
            curve.append((iteration, 100 * (expert_score - score) / abs(expert_score)))
        if not learner.finished:
            learner.iterate()
    return learner.result(), np.transpose(curve)


rewards = {"learned": reward, "random": random_reward}
unseen = {"T3": "T3", "other side": OTHER_SIDE}
found = {
    (place, kind, fresh): optimise(rewards[kind], scenario, fresh=fresh)
    for place, scenario in unseen.items()
    for kind in rewards
    for fresh in (False, True)
    if (place, kind) != ("other side", "random")
}

# %%
figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.2))
panel_of = dict(zip(unseen, panels, strict=True))
for (place, kind, fresh), (_, curve) in found.items():
    start = "fresh policy" if fresh else "trained policy"
    colour, dashes = BLUE if kind == "learned" else PINK, "--" if fresh else "-"
    panel_of[place].plot(*curve, color=colour, ls=dashes, label=f"{kind} reward, {start}")
for place, panel in panel_of.items():
    panel.axhline(0, color=style.look("expert").colour, lw=5, zorder=1, label="expert")
    panel.set(title=f"start: {place}", xlabel="iteration", ylabel="gap to the expert  [%]")
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
plt.show()

# %% [markdown]
# **What to see.** Left, at T3: a policy of random weights, which has never seen a demonstration or a
# score, ends level with the expert on the learned reward alone. Under the random one it comes closer too, for the
# middle of the range is not hard to beat, but it stops at 5 %. The trained policy is level from the beginning; the
# learned reward leaves it there, the random one takes it away. (It is *anchored*: a quarter of what it is optimised
# for is to stay what it is, which keeps it from following a reward too far.) Right, on the other side:
# the learned reward makes things *worse*. It is wrong there (section 5), and an optimiser finds what is
# wrong: the fresh policy begins with gains in the middle of the range, and ends as soft as the reward
# wants it.
#
# The gains at T3, before and after:

# %%
at_t3 = tasks.make("cup-on-plate", scenario="T3")
carried = {
    "expert": expert_traces["T3"],
    "before": record_trace(at_t3, policy.mean),
    "AIRL, fresh policy": record_trace(at_t3, found["T3", "learned", True][0].mean),
    "random": record_trace(at_t3, found["T3", "random", True][0].mean),
}
display(gains_over_time(carried))

# %% [markdown]
# **What to see.** The fresh policy has found the schedule: stiff and lightly damped, then soft and well
# damped. The random reward pulls one gain to the upper end of its range and another to the lower, whatever
# the distance. That its score changes at all is why a control belongs beside every transfer.
#
# ## 9 · What this shows, and what it does not
#
# **The reward is real.** It was learned from 50 demonstrations of one start, and alone it teaches the
# schedule, at another start, to a policy that never saw them. An untrained reward does not.
#
# **Cloning is strong here.** On T1-T4 it is the best of all, without any transfer: the schedule is a
# plain function of $(e, \dot e)$, each action comes labelled, and the starts are on the side that was
# shown. With such labels, and no more than this to do, clone: it needs no simulation, where AIRL took
# 2000 episodes. What sets AIRL apart on this task is not a better score but the reward.
#
# **What kind of reward?** At its best $r = \log p_E(a|o)$: it says *act as the expert would here*, not
# *what for*. Optimised somewhere else it brings the expert's way of acting along, provided that it is
# right there; it knows of no better way. Rewards on states alone aim at the purpose
# instead (Fu et al., 2018); this one is about actions, as in the paper, because how stiff to be is what
# is to be learned.
#
# **None of them sees what was not shown.** From the other side cloned policy and learned reward fail alike,
# and what helps is not the method but the data. As many recordings as before, shared between four starts:

# %%
spread_out = ["train", (0.0, 0.75, 0.30), (-0.10, 0.45, 0.35), (0.25, -0.10, 0.35)]
each = (count + held_out) // len(spread_out)
recordings = [
    tasks.record(tasks.make("cup-on-plate", scenario=scenario), each, seed=SEED + i, threads=0)
    for i, scenario in enumerate(spread_out)
]
mixed = np.random.default_rng(SEED).permutation(each * len(spread_out))  # the last of them are held out
observations = np.concatenate([recording.observations for recording in recordings])[mixed]
actions = np.concatenate([recording.actions for recording in recordings])[mixed]
wide, wide_expert = prepare(observations, actions, held_out)
clone(wide, wide_expert, configuration=settings.cloning, rng=np.random.default_rng(SEED))
_, wide_gap = sweep({"bc": Policy(wide.mean, "bc")})

figure, panel = plt.subplots(figsize=(5.4, 2.8))
for found_gap, colour, name in ((gap, ORANGE, "from one start"), (wide_gap, BLUE, "from four starts")):
    panel.plot(np.abs(turn), found_gap["bc"], "o", ms=4, color=colour, alpha=0.7, label=name)
panel.set(title=f"cloning, {len(mixed)} recordings", xticks=range(0, 181, 45))
panel.set(xlabel="angle off the demonstrated direction  [°]", ylabel="gap to the expert  [%]")
panel.legend()
plt.show()

# %% [markdown]
# **What to see.** The gap is gone, all the way around.
#
# **One seed is an anecdote.** These are single runs, meant to be understood. Numbers to rely on come from
# several seeds, all methods on the same starts; `vic study run paper` makes that table.
#
# ## Where to go from here
#
# - Change something: `push` and `count` in section 1 (what does cloning do with two demonstrations?), the
#   slope bound or the expert's noise alone in section 4, the scenarios in section 8.
# - Set `replay=0` in section 4: what becomes of the fresh policy in section 8?
# - Give AIRL `wide_expert`, the demonstrations of section 9: is the ridge of section 5 right on both sides
#   now?
# - The same as commands, with a report, and resumed when interrupted:
#
#   ```
#   vic train cup-on-plate --method airl --seed 0 --out runs/airl
#   vic transfer runs/airl --scenario T3 --fresh --out runs/airl-T3
#   vic evaluate runs/airl --sweep start
#   ```
#
# - From Python: `experiments.training.train(default_configuration("cup-on-plate", "airl"), "runs/airl")`.
# - The documentation: *Learning a skill* has the algorithms, *What the paper leaves open* every choice and
#   its reason.
