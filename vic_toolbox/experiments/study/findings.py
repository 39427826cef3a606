"""What the tables of a study say, in plain words, made from their numbers alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from vic_toolbox.experiments.study.comparison import (
    apart,
    beats,
    better_rivals,
    rivals,
    standings,
    subjects,
)
from vic_toolbox.experiments.study.statistics import Estimate
from vic_toolbox.experiments.study.table import ResultTable, TableRow
from vic_toolbox.experiments.study.wording import called

SOLVED = 0.5
"""Success rate of an untrained policy from which on a scenario is said to need no skill."""


Kind = Literal["alarm", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing to know."""

    kind: Kind
    """Something is missing; something falls short; something holds."""
    text: str
    more: str = ""
    """The numbers behind it, or what to do."""


def headline(tables: Sequence[ResultTable]) -> str:
    """The result in two or three sentences."""
    parts = []
    for name in dict.fromkeys(row.name for table in tables for row in subjects(table)):
        rows = [(table, row) for table in tables for row in subjects(table) if row.name == name]
        against = [said for table, row in rows for said in standings(table, row).values()]
        beaten = [bool(better_rivals(table, row, where)) for table, row in rows for where in row.estimates]
        said = []
        if against:
            said.append(f"reaches the paper's number in {against.count('reached')} of {len(against)} cells")
        if beaten:
            unit = "" if against else " cells"
            said.append(f"another method is better in {sum(beaten)} of {len(beaten)}{unit}")
        if said:
            parts.append(f"{name}: {', '.join(said)}.")
    cells = [cell for table in tables for row in table.rows for cell in row.cells.values()]
    done, wanted = sum(cell.done for cell in cells), sum(cell.wanted for cell in cells)
    if done < wanted:
        parts.append(f"The study is not finished: {done} of {wanted} results are there.")
    return " ".join(parts)


def of_table(table: ResultTable) -> Iterator[Finding]:
    """What one table says: what is missing; how its subjects stand against the paper, other methods and controls."""
    yield from _missing(table)
    for row in subjects(table):
        yield from _against_paper(table, row)
        yield from _against_rivals(table, row)
        yield from _against_controls(table, row)
    yield from _needs_no_skill(table)
    yield from _checks(table)


def _missing(table: ResultTable) -> Iterator[Finding]:
    cells = [cell for row in table.rows for cell in row.cells.values()]
    missing = sum(cell.wanted - cell.done for cell in cells)
    failed = sum(cell.failed for cell in cells)
    if missing:
        tail = f", {failed} of them failed" if failed else ""
        yield Finding(
            "alarm",
            f"{missing} of {sum(cell.wanted for cell in cells)} results are missing{tail}.",
            "Their cells show no mean. Take the study up again with vic study run FILE --out DIR --resume.",
        )


def _against_paper(table: ResultTable, row: TableRow) -> Iterator[Finding]:
    judged = standings(table, row)
    short = [where for where, said in judged.items() if said != "reached"]
    reached = f"{len(judged) - len(short)} of {len(judged)} scenarios"
    lead = f"{row.name}: the paper's number is reached in {reached}"
    parts = []
    for where in short:
        paper = row.cells[where].paper
        told = f"{called(where)}: {_told(table, row.estimates[where])}"
        inside = ", inside the interval" if judged[where] == "open" else ""
        parts.append(f"{told} (paper {table.metric.paper_text(paper or 0.0)}{inside})")
    if judged:
        yield (
            Finding("warning", f"{lead}.", f"Below: {_sentence(parts)}")
            if short
            else Finding("note", f"{lead}.")
        )


def _against_rivals(table: ResultTable, row: TableRow) -> Iterator[Finding]:
    lead = f"{row.name}:"
    parts = []
    for where, own in row.estimates.items():
        if better := better_rivals(table, row, where):
            means = _compared(table, better[0].estimates[where], own)
            parts.append(f"{called(where)}: {better[0].name} {means}")
    if parts:
        found = f"{len(parts)} of {len(row.cells)} scenarios"
        yield Finding("warning", f"{lead} another method is better in {found}.", _sentence(parts))
    elif rivals(table, row) and len(row.estimates) == len(row.cells):
        yield Finding("note", f"{lead} no other method is better in any scenario.")


def _against_controls(table: ResultTable, row: TableRow) -> Iterator[Finding]:
    """Where a control does as well, what is said to help does not."""
    for control in _CONTROLS:
        one, other = (table.row(f"{row.name}{suffix}") for suffix in (control.of, control.beside))
        if one is None or other is None:
            continue
        both = [where for where in other.estimates if where in one.estimates]
        won = [where for where in both if beats(table, one, other, where)]
        lost = [where for where in both if beats(table, other, one, where)]
        level = [where for where in both if where not in won + lost]
        outcomes: tuple[tuple[Kind, str, list[str]], ...] = (
            ("note", control.won, won),
            (control.serious, control.level, level),
            ("warning", control.lost, lost),
        )
        for kind, said, scenarios in outcomes:
            if scenarios:
                yield Finding(
                    kind,
                    f"{row.name}: {said} in {_listed(map(called, scenarios))}.",
                    _sentence(_against(table, one, other, scenarios)),
                )


@dataclass(frozen=True)
class _Control:
    """A pair of rows, by what follows the method's name, and what each outcome of the comparison means."""

    of: str
    beside: str
    won: str
    level: str
    lost: str
    serious: Literal["warning", "note"]


_CONTROLS = (
    _Control(
        of="",
        beside=", no transfer",
        won="the transfer improves the policy",
        level="the transfer changes nothing",
        lost="the policy is better without the transfer",
        serious="note",
    ),
    _Control(
        of="",
        beside=", random reward",
        won="the learned reward does better than a random one",
        level="a random reward does as well as the learned one",
        lost="a random reward does better than the learned one",
        serious="warning",
    ),
    _Control(
        of=", fresh policy",
        beside=", fresh policy, random reward",
        won="from random weights, the learned reward does better than a random one",
        level="from random weights, a random reward does as well as the learned one",
        lost="from random weights, a random reward does better than the learned one",
        serious="warning",
    ),
)


def _needs_no_skill(table: ResultTable) -> Iterator[Finding]:
    for row in table.of_role("control"):
        if row.method == "untrained":
            rates = {where: _success(table, row, where) for where in row.estimates}
            solved = [
                f"{called(where)} ({100 * rate:.0f} %)" for where, rate in rates.items() if rate >= SOLVED
            ]
            if solved:
                yield Finding(
                    "warning",
                    f"{row.name} succeeds in {_listed(solved)}.",
                    "No skill is needed there; success there says nothing about a method.",
                )


def _checks(table: ResultTable) -> Iterator[Finding]:
    pairs = [
        (row, where, row.estimates[where], halved)
        for check in table.of_role("check")
        if (row := table.row(check.name.rsplit(",", 1)[0])) is not None
        for where, halved in check.estimates.items()
        if where in row.estimates
    ]
    if not pairs:
        return
    row, where, own, halved = max(pairs, key=lambda pair: abs(pair[3].mean - pair[2].mean))
    change = table.metric.text(abs(halved.mean - own.mean))
    means = f"{table.metric.text(own.mean)}, with half the step {table.metric.text(halved.mean)}"
    yield Finding(
        "warning" if apart(own, halved) else "note",
        f"Half the physics time step changes none of {len(pairs)} means by more than {change}.",
        f"The most: {row.name} in {called(where)}, {means}.",
    )


def _success(table: ResultTable, row: TableRow, where: str) -> float:
    """Success rate, whatever the table shows; 0 where it is not known."""
    return row.estimates[where].mean if table.metric.more_is_better else row.cells[where].success or 0.0


def _told(table: ResultTable, found: Estimate) -> str:
    if found.low is None or found.high is None:
        return table.metric.text(found.mean)
    return f"{table.metric.text(found.mean)} {table.metric.interval_text(found.low, found.high)}"


def _against(table: ResultTable, one: TableRow, other: TableRow, scenarios: Iterable[str]) -> list[str]:
    return [
        f"{called(where)}: {_compared(table, one.estimates[where], other.estimates[where])}"
        for where in scenarios
    ]


def _compared(table: ResultTable, one: Estimate, other: Estimate) -> str:
    clear = " (intervals apart)" if apart(one, other) else ""
    return f"{table.metric.text(one.mean)} against {table.metric.text(other.mean)}{clear}"


def _listed(parts: Iterable[str]) -> str:
    return ", ".join(parts)


def _sentence(parts: Sequence[str]) -> str:
    return "; ".join(parts) + "."
