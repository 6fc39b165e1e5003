"""The outcomes of a study for a person to read."""

from collections import Counter
from collections.abc import Iterable, Sequence

from rich.markup import escape
from rich.table import Table

from fracsim.fuzz.run import Outcome


def table(outcomes: Iterable[Outcome]) -> Table:
    """A row a family: how many scenes were drawn, and how they ended."""
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
    verdicts = Counter(o.verdict for o in group)
    reasons = Counter(o.reason for o in group if o.verdict == "refused")
    told = ", ".join(f"{n} {reason}" for reason, n in reasons.most_common())
    wrong = f"[red]{verdicts['wrong']}[/]" if verdicts["wrong"] else "0"
    parted = sum(o.parted for o in group if o.verdict == "finished")
    return [name, str(len(group)), str(verdicts["finished"]), str(parted), str(verdicts["refused"]), wrong,
            f"{sum(o.seconds for o in group):.1f}", told]  # fmt: skip


def lines(outcomes: Iterable[Outcome]) -> list[str]:
    """Each wrong scene, marked up, with what was violated."""
    out = []
    for o in outcomes:
        if o.verdict == "wrong":
            must = "sensible" if o.sensible else "not sensible"
            out.append(f"[red]wrong[/] {o.family}-{o.seed}-{o.number} ({o.particles:,} particles, {o.substeps:,} "
                       f"substeps, {must})")  # fmt: skip
            out += [f"      {escape(told)}" for told in o.wrong]
    return out
