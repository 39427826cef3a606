# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 6 · Reproducing the paper: what a table may claim
#
# The paper says that gains learned by AIRL carry over to situations that no demonstration showed. This notebook is
# for whoever teaches, reviews or wants to compare a method of their own:
#
# 1. the committed results beside the paper's
# 2. what they say
# 3. honest numbers: all seeds, intervals, controls
# 4. one cell, done again
# 5. a study of your own
#
# The results were made by one command, `vic study run studies/paper.toml`. All of it is on the page *results* of the
# documentation, what the paper leaves open on the page *reproduction*. The notebook takes about five minutes, with
# `VIC_FAST=1` half a minute.

# %%
import os
import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown, display

import vic_toolbox
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.figures.study_table import Dot, DotRow, dots
from vic_toolbox.experiments.study import definition, results_json
from vic_toolbox.experiments.study.engines import JoblibEngine
from vic_toolbox.experiments.study.execution import execute
from vic_toolbox.experiments.study.findings import of_table
from vic_toolbox.experiments.study.folder import StudyFolder
from vic_toolbox.experiments.study.metric import METRICS
from vic_toolbox.experiments.study.report import report
from vic_toolbox.experiments.study.statistics import mean_estimate, rate_estimate
from vic_toolbox.experiments.study.status import read_status
from vic_toolbox.experiments.study.table import make_tables

FAST = os.environ.get("VIC_FAST") == "1"  # small settings, for a quick check that everything runs
# %matplotlib inline
plt.rcParams.update(style.RC | {"figure.dpi": 110})
SCRATCH = tempfile.TemporaryDirectory(prefix="vic-notebook-")  # goes with the notebook
WORK = Path(SCRATCH.name)

# %% [markdown]
# ## 1 · The committed results
#
# `docs/results/paper.json` is a list of cells, one for each number: table, method, history of observations, scenario,
# mean over the seeds with its 95 % interval, number of seeds, the paper's number, our best three seeds.


# %%
def committed():
    """docs/results/paper.json of this folder, of one above it, or of the source tree that the package is used from."""
    here = Path.cwd()
    for folder in (here, *here.parents, *Path(vic_toolbox.__file__).parents):
        if (path := folder / "docs" / "results" / "paper.json").is_file():
            return path
    raise FileNotFoundError(
        "no docs/results/paper.json here or above; run the notebook in a clone of the repository"
    )


cells = results_json.read_cells(committed())
study = definition.load("paper")  # what was run: tasks, methods, seeds, budgets
done = max(cell["seeds"] for cell in cells)
print(f"{len(cells)} cells; {done} of the {len(study.seeds)} seeds {study.seeds}")
cells[0]

# %%
PUBLISHED = [table for table in study.table if any(cell["table"] == table.name for cell in cells)]


def of(table, *, controls=False):
    """Cells of a table by row: what the paper has, or the controls."""
    rows = {}
    for cell in cells:
        method, comma, control = cell["method"].partition(",")
        name = method + ("-His" if cell["history"] > 1 else "") + comma + control  # as the paper calls it
        if cell["table"] == table.name and "half the time step" not in name:
            rows.setdefault(name, {})[cell["scenario"]] = cell
    return {name: row for name, row in rows.items() if (name in METHODS) != controls}


METHODS = [
    f"{action}-{method}{past}"
    for past in ("", "-His")
    for action in ("Gain", "Force")
    for method in ("AIRL", "BC")
]
METHODS += ["Constant gain"]


def text(cell):
    metric = METRICS[cell["metric"]]
    if cell["mean"] is None:
        return f"– ({cell['seeds']} seeds)"
    interval = "" if cell["low"] is None else " " + metric.interval_text(cell["low"], cell["high"])
    paper = "" if cell["paper"] is None else f"<br>paper {metric.paper_text(cell['paper'])}"
    return metric.text(cell["mean"]) + interval + paper


def show(table, rows):
    lines = ["| | " + " | ".join(table.scenarios) + " |", "|---" * (len(table.scenarios) + 1) + "|"]
    for name, row in rows.items():
        lines.append(
            f"| {name} | " + " | ".join(text(row[s]) if s in row else "" for s in table.scenarios) + " |"
        )
    display(Markdown(f"**Table {table.name}. {table.title}**\n\n" + "\n".join(lines)))


for table in PUBLISHED:
    show(table, of(table))

# %% [markdown]
# As pictures: a dot for each mean, its interval, and a diamond for the paper's number.


# %%
def picture(table):
    metric = METRICS[table.metric]

    def scaled(x):
        return None if x is None else metric.factor * x

    rows = [
        DotRow(name, "airl" if "AIRL" in name else "bc" if "BC" in name else "constant", False, {
            s: Dot(*(scaled(cell[key]) for key in ("mean", "low", "high", "paper")))
            for s, cell in row.items() if cell["mean"] is not None
        })
        for name, row in of(table).items()
    ]  # fmt: skip
    display(dots(rows, table.scenarios, label=metric.label, rate=metric.more_is_better))


for table in PUBLISHED:
    picture(table)

# %% [markdown]
# ## 2 · What they say
#
# Two questions to every cell of a method: is its mean at least the paper's, at the paper's decimals? And is no other
# method better there, of those that see as many observations? The answers are counted, not chosen:

# %%
for name in ("Gain-AIRL", "Gain-AIRL-His", "Force-AIRL", "Gain-BC", "Force-BC"):
    reached, compared, best, total = 0, 0, 0, 0
    for table in PUBLISHED:
        metric, rows = METRICS[table.metric], of(table)
        for scenario, cell in rows.get(name, {}).items():
            if cell["mean"] is None:
                continue
            if cell["paper"] is not None:
                compared += 1
                reached += metric.reaches(cell["mean"], cell["paper"])
            alike = [row[scenario]["mean"] for other, row in rows.items()
                     if other == "Constant gain" or other.endswith("-His") == name.endswith("-His")]  # fmt: skip
            ahead = [m for m in alike if m is not None and metric.better(m, cell["mean"])]
            total += 1
            best += all(metric.text(mean) == metric.text(cell["mean"]) for mean in ahead)
    print(
        f"{name:14} reaches the paper in {reached:2} of {compared:2} cells, nobody is better in {best:2} of {total:2}"
    )

# %% [markdown]
# Where Gain-AIRL falls short of the paper, the interval says how much that means: the paper's number may lie inside.

# %%
short = []
for table in PUBLISHED:
    metric = METRICS[table.metric]
    for name in ("Gain-AIRL", "Gain-AIRL-His"):
        for scenario, cell in of(table).get(name, {}).items():
            if cell["mean"] is None or cell["paper"] is None or metric.reaches(cell["mean"], cell["paper"]):
                continue
            inside = cell["low"] is not None and cell["low"] <= cell["paper"] <= cell["high"]
            short.append(
                f"Table {table.name}, {name}, {scenario}: {text(cell).replace('<br>', ', ')}"
                + " (inside)" * inside
            )
print(*short or ["in no cell"], sep="\n")

# %% [markdown]
# ## 3 · Honest numbers
#
# ### Every seed counts
#
# A seed draws demonstrations, weights, exploration and minibatches. Some are lucky. To report the best three of five,
# as the paper does, is to report luck as well; how much, the cells tell. For a method that never fails it is nothing,
# for one that sometimes fails a lot:

# %%
for name in ("Gain-AIRL", "Gain-BC", "Force-AIRL", "Force-BC"):
    gains = [
        (100 * (cell["best3"] - cell["mean"]), scenario)
        for table in PUBLISHED if table.metric == "success"
        for scenario, cell in of(table).get(name, {}).items() if cell["best3"] is not None
    ]  # fmt: skip
    if gains:
        most, where = max(gains)
        print(f"{name:10} best three beat all seeds by {np.mean([g for g, _ in gains]):4.1f} points; "
              f"most at {where}, by {most:.1f}")  # fmt: skip

# %% [markdown]
# ### An interval, or it did not happen
#
# Five runs are few. The interval of a mean is Student's over the seeds, $\bar x \pm t_4\, s/\sqrt 5$, with $t_4 =
# 2.78$. For success rates that breaks down at both ends: five seeds at 100 % would give ± 0, and one failed seed of
# five a range beyond 100 %. So a rate gets Wilson's interval, the rates that the data do not contradict, from the
# spread of the seeds or from the number of starts, whichever is wider:

# %%
for rates in ([1, 1, 1, 1, 1], [1, 1, 1, 1, 0.9], [1, 1, 1, 1, 0], [0.7, 0.6, 0.8, 0.7, 0.7]):
    student, found = mean_estimate(rates), rate_estimate(rates, episodes=100)
    print(f"{rates!s:28} mean {found.mean:.2f}   Student [{student.low:5.2f}, {student.high:.2f}]"
          f"   here [{found.low:.2f}, {found.high:.2f}]   best three {found.best3:.2f}")  # fmt: skip

# %% [markdown]
# **What to see.** With one seed of five lost, the mean may be anything from 22 to 98 %; the best three say 100 %.
# And five seeds that agree still do not exclude that one in five fails: the chance of not meeting it is
# $0.8^5$, a third.
#
# ### Controls
#
# A number without a control is an anecdote. Beside each table of transfer stand: the policy **without transfer**; the
# same optimisation under an untrained **random reward** (does the *learned* reward help, or any shaking of the
# policy?); a **fresh policy** under either reward (does the reward alone teach the skill?); an **untrained policy with
# its exploration noise** (dither alone can put a peg into a hole); the expert and other constant gains.

# %%
for table in PUBLISHED:
    asked = {
        name: row
        for name, row in (of(table) | of(table, controls=True)).items()
        if name.startswith(("Gain-AIRL", "Gain, untrained"))
    }
    show(table, asked)

# %% [markdown]
# **What to see.** Compare two rows at a time. *Gain-AIRL* against *random reward* judges the reward as a guide of small
# steps: at +2°, and at every start of the cup, the learned reward helps and the random one does not. *Fresh policy*
# against *fresh policy, random reward* judges it as a teacher: a good one, but not at +2°. Where the *untrained* policy
# succeeds, the scenario tells nothing about any method. And where everything stands at 100 %, nothing is shown either.
#
# ## 4 · One cell, done again
#
# A cell is data: its settings say everything that its result depends on, so that it can be done again, anywhere. Here
# are those of cloning at one tilt, cut out of the study with its own budgets and seeds. On the same platform the
# numbers are the same; on another one rounding differs, and with it, a little, everything that learning amplifies.

# %%
FIRST = study.table[0]
few = study.seeds[:1] if FAST else study.seeds
cut = replace(
    FIRST, methods=("bc",), actions=("gain",), histories=(1,), controls=(), halved_step=(), sweeps=(),
    scenarios=FIRST.scenarios[:1] + ("train",) * (FIRST.scenarios[0] != "train"), paper={},
)  # fmt: skip
again = replace(study, name="again", seeds=few, table=(cut,))

with StudyFolder.create(WORK / "again", again) as folder:
    print(*(cell.name for cell in folder.cells), sep="\n")
    summary = execute(folder, JoblibEngine(2))
(table,) = make_tables(again, folder.plan, folder.results())

for scenario, cell in table.row("Gain-BC").cells.items():
    there = of(FIRST)["Gain-BC"][scenario]
    interval = METRICS[there["metric"]].interval_text(there["low"], there["high"])
    print(f"{scenario}: now {100 * np.array(cell.values)}, mean {100 * np.mean(cell.values):.1f} %; "
          f"committed {100 * there['mean']:.1f} {interval}, {there['seeds']} seeds")  # fmt: skip

# %% [markdown]
# The same with AIRL takes minutes: a reward and a policy are learned from the demonstrations, the reward is frozen, and
# the policy optimised under it where no demonstration was. One seed of it (not with `VIC_FAST=1`):

# %%
if not FAST:
    one = replace(again, name="airl", seeds=study.seeds[:1], table=(replace(cut, methods=("airl",)),))
    with StudyFolder.create(WORK / "airl", one) as folder:
        execute(folder, JoblibEngine(2))
    (table,) = make_tables(one, folder.plan, folder.results())
    for scenario, cell in table.row("Gain-AIRL").cells.items():
        there = of(FIRST)["Gain-AIRL"][scenario]
        interval = METRICS[there["metric"]].interval_text(there["low"], there["high"])
        print(f"{scenario}: seed {one.seeds[0]} now {100 * cell.values[0]:.1f} %; "
              f"committed mean {100 * there['mean']:.1f} {interval}")  # fmt: skip

# %% [markdown]
# ## 5 · A study of your own
#
# Write down what you want to know **before** you look: a TOML file. Keys that do not exist are refused, with the
# nearest one that does; what is left out has the defaults that the page *studies* of the documentation lists.

# %%
MINE = """
name = "mine"
title = "Does cloning need a history?"
seeds = [0, 1, 2]

[budget.peg-in-hole]
episodes = 20
demonstrations = 10
held_out = 2
cloning_steps = 300

[[table]]
name = "A"
title = "Cloned gains over tilts"
task = "peg-in-hole"
metric = "success"
scenarios = ["tilt=-4", "train", "tilt=0"]
methods = ["bc", "constant"]
actions = ["gain"]
histories = [1, 5]
controls = ["expert"]
"""

mine = definition.parse(tomllib.loads(MINE), where="MINE")
with StudyFolder.create(WORK / "mine", mine) as folder:
    summary = execute(folder, JoblibEngine(2))  # or RayEngine("auto"): a cluster
status = read_status(folder)
print({kind: f"{row.done} of {row.total}, {row.mean:.1f} s each" for kind, row in status.kinds.items()})

# %% [markdown]
# A cell that is done is never done again, whatever happens in between: kill the process, take it up, and the tables are
# the same. `vic study run FILE --out DIR --resume` does that on the command line, `vic study status DIR` looks at it
# while it runs. The report has the same parts as the paper's: tables, findings in words, figures.

# %%
(table,) = report(folder, WORK / "mine-report")
for row in table.of_role("method", "control"):
    found = {where: table.metric.text(cell.estimate.mean) for where, cell in row.cells.items()}
    print(f"{row.name:16}", found)
for finding in of_table(table):
    print("-", finding.text, finding.more)
print(sorted(path.name for path in (WORK / "mine-report").iterdir()))

# %% [markdown]
# ## Try it yourself
#
# - Add `paper = {...}` numbers of your own to the table, and see what the findings say about them.
# - Give the study eight seeds instead of three. Which intervals shrink, and which cannot?
# - Change the budget and take the study up again with `StudyFolder.create(..., resume=True)`: what does it say, and why
#   is that right?
# - The same on the command line, on all cores, with a page that needs no other file:
#
#   ```
#   vic study run mine.toml --out runs/mine
#   vic study status runs/mine
#   vic study report runs/mine --out results
#   ```
#
# X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement Learning for
# Force-Related Tasks", *IEEE Robotics and Automation Letters* 6(2), 2021.
