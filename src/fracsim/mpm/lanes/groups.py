"""Which particles are computed side by side: groups of WIDTH cells, a cell a lane, a particle of each a record.

All particles of a cell see the same 27 nodes, which are gathered once a cell. Any WIDTH cells of one thread with about
as many particles make a group. Lanes that are left over hold no particle.
"""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fracsim.lanes import WIDTH
from fracsim.records import Array

AT, FIRST, SLOTS, HELD, MERGED = 0, WIDTH, WIDTH + 1, WIDTH + 2, WIDTH + 3
"""Columns of a group's row: the lowest nodes of its cells, its first record, its number of records, whether a grip
holds one of its particles, and whether some of its lanes are parts of one cell."""
COLUMNS = WIDTH + 4


@dataclass(frozen=True, eq=False)
class Groups:
    """The groups of all threads."""

    rows: Array
    """A row a group, (groups, COLUMNS) int32."""
    start: Array
    """Groups of thread t are start[t] .. start[t + 1], (threads + 1,) int32."""
    particles: Array
    """The particle of each lane of each record, or -1, (records, WIDTH) int32."""
    offset: Array
    """Offset of each particle from the lowest node of its cell [cells], (N, 3)."""
    owner: Array
    """The first lane of the same cell, for each lane of each group, (groups, WIDTH): parts of a cell whose particles
    belong to several fragments share one pressure, but not their nodes."""


def groups(y: Array, cell: Array, node: Array, pressure: Array, held: Array, start: Array) -> Groups:
    """Group N particles at y [cells], (N, 3), in `cell`, (N, 3) int, whose lowest nodes are `node`, (N,) int.

    Particles of the same number in `pressure`, (N,) int, share their pressure, so that they must be of one thread;
    `held`, (N,) bool, are those in grips; thread t has the particles from start[t] to start[t + 1].
    """
    rows: list[list[int]] = []
    particles: list[Array] = []
    owners: list[list[int]] = []
    first, records = [0], 0
    for begin, end in pairwise(start):
        for members, owner in _groups(pressure[begin:end], node[begin:end]):
            slots = max(len(of) for of in members)
            record = np.full((slots, WIDTH), -1, np.int32)
            for lane, of in enumerate(members):
                record[: len(of), lane] = of + begin
            inside = record[record >= 0]
            at = [node[record[0, lane if lane < len(members) else 0]] for lane in range(WIDTH)]
            merged = len(set(owner[: len(members)])) < len(members)
            rows.append([*at, records, slots, int(held[inside].any()), int(merged)])
            records += slots
            particles.append(record)
            owners.append(owner)
        first.append(len(rows))
    return Groups(np.asarray(rows, np.int32).reshape(-1, COLUMNS), np.asarray(first, np.int32),
                  np.concatenate(particles) if particles else np.zeros((0, WIDTH), np.int32), y - cell,
                  np.asarray(owners, float).reshape(-1, WIDTH))  # fmt: skip


def _groups(pressure: Array, node: Array) -> list[tuple[list[Array], list[int]]]:
    """The members of each lane, and the owners of the lanes, of each group of one thread, in the order of memory."""
    order = np.lexsort((node, pressure))
    changes = np.flatnonzero((np.diff(pressure[order]) != 0) | (np.diff(node[order]) != 0)) + 1
    parts = np.split(order, changes) if len(order) else []
    of = np.array([pressure[part[0]] for part in parts], np.int64)
    shared = np.bincount(of - of.min())[of - of.min()] > 1 if len(parts) else np.zeros(0, bool)
    lists = _with_all_parts([k for k in range(len(parts)) if shared[k]], of)
    alone = sorted((int(k) for k in np.flatnonzero(~shared)), key=lambda k: (-len(parts[k]), parts[k][0]))
    lists += [alone[k : k + WIDTH] for k in range(0, len(alone), WIDTH)]
    lists.sort(key=lambda group: min(parts[k][0] for k in group))
    out = []
    for group in lists:
        owner = [next(j for j, m in enumerate(group) if of[m] == of[k]) for k in group]
        out.append(([np.sort(parts[k]) for k in group], owner + list(range(len(group), WIDTH))))
    return out


def _with_all_parts(parts: list[int], of: Array) -> list[list[int]]:
    """Lists of at most WIDTH parts; those of one cell are neighbours in `parts` and stay together."""
    out: list[list[int]] = [[]]
    same = Counter(of[parts].tolist())
    for k in parts:
        new_cell = not out[-1] or of[out[-1][-1]] != of[k]
        if len(out[-1]) == WIDTH or (new_cell and len(out[-1]) + min(same[of[k]], WIDTH) > WIDTH):
            out.append([])
        out[-1].append(k)
    return [group for group in out if group]
