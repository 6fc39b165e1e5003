"""The results as a table, for a terminal and a page (Markdown), and for a paper (LaTeX)."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

ARROWS = {True: "↑", False: "↓", None: ""}
TEX_ARROWS = {"↑": r"$\uparrow$", "↓": r"$\downarrow$", "±": r"$\pm$"}
NONE = "–"
METRICS = "metrics.json"
"""The file of all results."""


class Line(NamedTuple):
    """A row of the table."""

    name: str
    higher: bool | None
    all: str
    n: str
    undefined: str
    groups: tuple[str, ...]
    controls: tuple[str, ...]


def label(metric: str, column: str) -> str:
    """What a result is called beside those of other metrics."""
    return column if column.startswith(metric) else f"{metric}.{column}"


def number(value: float | None) -> str:
    """A result with four digits; a dash when it is undefined."""
    return NONE if value is None else f"{value:.4g}"


def result(entry: Mapping[str, Any] | None) -> str:
    """A result and its interval."""
    if entry is None or entry.get("value") is None:
        return NONE
    if entry.get("low") is None:
        return number(entry["value"])
    return f"{number(entry['value'])} [{number(entry['low'])}, {number(entry['high'])}]"


def lines(document: Mapping[str, Any], group: str, short: bool = False) -> Iterator[Line]:
    """A row a result of metrics.json, or a result that is better or worse (`short`).

    `group` gives columns of its own, as "object".
    """
    names = columns(document, group)
    for metric, entry in document["metrics"].items():
        groups = entry["by"].get(group, {})
        for column, found in entry["results"].items():
            if short and column not in entry["higher"]:
                continue
            controls = [document["controls"][name]["metrics"].get(metric) for name in observed_controls(document)]
            yield Line(
                label(metric, column),
                entry["higher"].get(column),
                result(found),
                str(entry["n"]),
                str(entry["undefined"].get(column, 0) or ""),
                tuple(_value(groups.get(name), column) for name in names),
                tuple(_value(one, column) for one in controls),
            )


def _value(entry: Mapping[str, Any] | None, column: str) -> str:
    """A result of a group or a control; a dash when there is none."""
    return number((entry or {}).get("results", {}).get(column, {}).get("value"))


def columns(document: Mapping[str, Any], group: str) -> list[str]:
    """The values of a group that any metric has."""
    return list(dict.fromkeys(name for entry in document["metrics"].values() for name in entry["by"].get(group, {})))


def observed_controls(document: Mapping[str, Any]) -> list[str]:
    """The controls that have results of metrics."""
    return [name for name, entry in document["controls"].items() if "metrics" in entry]


def _head(document: Mapping[str, Any], group: str) -> list[str]:
    return ["result", "all clips [95 %]", "n", "undefined", *columns(document, group), *observed_controls(document)]


def markdown(document: Mapping[str, Any], group: str = "object", short: bool = False) -> str:
    """The table in Markdown, of rows as `lines`, and below it what is missing and what the controls are."""
    rows = [[f"{line.name} {ARROWS[line.higher]}".strip(), line.all, line.n, line.undefined, *line.groups,
             *line.controls] for line in lines(document, group, short)]  # fmt: skip
    out = [_row(_head(document, group)), _row(["---"] * len(_head(document, group))), *map(_row, rows)]
    return "\n".join([*out, "", *notes(document)]).rstrip() + "\n"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def notes(document: Mapping[str, Any]) -> list[str]:
    """What a reader of the table must know, a line each."""
    told = [f"{metric}: missing, {reason}" for metric, reason in document["missing"].items()]
    axis = document["controls"].get("axis")
    if axis:
        constant = f"{number(axis['best_constant'])} (at {number(axis['best_axis'])} deg)"
        told.append(f"sac of answers that know no axis: at most {number(axis['uniform'])} for random axes, {constant} "
                    "for the best constant axis")  # fmt: skip
    for name in observed_controls(document):
        told.append(f"column {name}: {document['controls'][name]['about']}, {document['controls'][name]['n']} clip(s)")
    bad = {fault["clip"] for fault in document["faults"]}
    if bad:
        told.append(f"{len(bad)} clip(s) could not be scored in full: see faults in metrics.json")
    if document["alone"]:
        told.append(f"{document['alone']} true clip(s) have no predicted one")
    return [f"- {line}" for line in told]


def tex(document: Mapping[str, Any], group: str = "class") -> str:
    """The table in LaTeX, for the package booktabs."""
    head = ["Result", "All clips", "n", *columns(document, group)]
    body = [[f"{line.name} {ARROWS[line.higher]}".strip(), line.all, line.n, *line.groups]
            for line in lines(document, group, short=True)]  # fmt: skip
    rows = [" & ".join(map(escaped, row)) + r" \\" for row in body]
    title = " & ".join(map(escaped, head)) + r" \\"
    return "\n".join([rf"\begin{{tabular}}{{l{'c' * (len(head) - 1)}}}", r"\toprule", title, r"\midrule", *rows,
                      r"\bottomrule", r"\end{tabular}", ""])  # fmt: skip


def escaped(text: str) -> str:
    """A text for LaTeX."""
    for sign in "_%&#":
        text = text.replace(sign, f"\\{sign}")
    for sign, command in TEX_ARROWS.items():
        text = text.replace(sign, command)
    return text.replace(NONE, "--")
