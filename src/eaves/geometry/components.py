"""The connected groups of a graph, and the members of groups."""

from __future__ import annotations

import numpy as np

from eaves.kernels import kernel
from eaves.model import Integers, Labels


@kernel
def connected_groups_kernel(first: Integers, second: Integers, count: int) -> Integers:
    """The group (N,) of each of `count` nodes, edges joining `first` (E,) to `second` (E,).

    Groups are numbered in the order of their first nodes.
    """
    head = np.arange(count)
    for edge in range(len(first)):
        unite_kernel(head, first[edge], second[edge])
    groups = 0
    for node in range(count):
        if head[node] == node:
            head[node] = groups
            groups += 1
        else:  # the head of a node comes before it, and bears its number already
            head[node] = head[head[node]]
    return head


@kernel
def unite_kernel(head: Integers, a: int, b: int) -> None:
    """Make the groups of two nodes one; following `head` (N,) leads to a group's first node, its own head."""
    while head[a] != a:
        head[a] = head[head[a]]
        a = head[a]
    while head[b] != b:
        head[b] = head[head[b]]
        b = head[b]
    if a < b:
        head[b] = a
    else:
        head[a] = b


def members(group: Labels | Integers, count: int) -> list[Integers]:
    """The numbers of the members of each of `count` groups, ascending; of group -1 there is no list."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.searchsorted(group[order], np.arange(count + 1)))[1:-1]


@kernel
def members_kernel(group: Integers, count: int) -> tuple[Integers, Integers]:
    """The numbers (N,) of the members of `count` groups, group by group, ascending, and where those of each
    begin (count + 1,)."""
    first = np.zeros(count + 1, np.int64)
    for one in group:
        first[one + 1] += 1
    for one in range(count):
        first[one + 1] += first[one]
    place, order = first[:-1].copy(), np.empty(len(group), np.int64)
    for number in range(len(group)):
        order[place[group[number]]] = number
        place[group[number]] += 1
    return order, first
