"""The outcomes of a study as a readable table."""

from collections import Counter
from collections.abc import Iterable, Sequence

from rich.markup import escape
from rich.table import Table

from fracsim.fuzz.run import Outcome


def table(outcomes: Iterable[Outcome]) -> Table:
    """One row for each family: the number of its scenes, and of each end."""
    out = Table(title="scenes by family")
    out.add_column("family")
    for name in ("drawn", "finished", "parted", "refused", "wrong", "seconds"):
        out.add_column(name, justify="right")
    out.add_column("refused because of")
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault(o.family, []).append(o)
    for family in sorted(groups):
        out.add_row(*_row(family, groups[family]))
    if len(groups) > 1:
        out.add_section()
        out.add_row(*_row("all", [o for group in groups.values() for o in group]))
    return out


def _row(name: str, group: Sequence[Outcome]) -> list[str]:
    """The cells of the row of a group of outcomes."""
    verdicts = Counter(o.verdict for o in group)
    reasons = Counter(o.reason for o in group if o.verdict == "refused")
    refusals = ", ".join(f"{n} {reason}" for reason, n in reasons.most_common())
    wrong = f"[red]{verdicts['wrong']}[/]" if verdicts["wrong"] else "0"
    parted = sum(o.parted for o in group if o.verdict == "finished")
    return [name, str(len(group)), str(verdicts["finished"]), str(parted), str(verdicts["refused"]), wrong,
            f"{sum(o.seconds for o in group):.1f}", refusals]  # fmt: skip


def lines(outcomes: Iterable[Outcome]) -> list[str]:
    """Lines on each wrong scene, with markup, and on its violations."""
    out = []
    for o in outcomes:
        if o.verdict == "wrong":
            must = "sensible" if o.sensible else "not sensible"
            out.append(f"[red]wrong[/] {o.family}-{o.seed}-{o.number} ({o.particles:,} particles, {o.substeps:,} "
                       f"substeps, {must})")  # fmt: skip
            out += [f"      {escape(sentence)}" for sentence in o.wrong]
    return out
