"""The particles' maps as binary trees that share what they have in common.

Fig. 2, Wang, Wang and Wang 2019 (after Montemerlo et al., AAAI 2002): a particle's map is a tree over the
landmarks' numbers, one landmark per leaf. A copied particle is a copied link to the root. Whoever writes to a leaf
copies the nodes on the way to it, O(log M) of them, unless nobody else refers to them: nodes count their references,
and one of count 1 is written in place. What nobody refers to any more goes to a list of unused nodes.

One lane, beside the arrays of `map_storage`:

    points  [Q, 5]   the leaves' landmarks
    nodes   [P, 3]   inner node: left, right, references; leaf: row of `points`, LEAF, references
    index            row ROOTS: each particle's root; row SIZES: the heads and sizes named below

Unused nodes are chained through their second entry; an unused leaf keeps its row of `points`.
"""

import math

from estimators.kernels.jit import inline, subroutine

ROOTS = 1  # row of the index, where lazy columns have their epochs
SIZES = 5
DEPTH, NODES, LEAVES, FREE_NODE, FREE_LEAF, NODES_FREE, LEAVES_FREE = 4, 5, 6, 7, 8, 9, 10
"""In row SIZES: levels below the root; nodes and leaves ever used; the unused ones' heads and numbers."""
LEFT, RIGHT, COUNT = 0, 1, 2
NONE, LEAF = -1, -2


def depth_of(max_landmarks):
    """Levels below the root."""
    return max(1, math.ceil(math.log2(max_landmarks)))


def clear_tree(index, max_landmarks):
    """No nodes, no roots, in these lanes. index: [n, 6, W]."""
    index[:, ROOTS] = NONE
    index[:, SIZES, DEPTH] = depth_of(max_landmarks)
    index[:, SIZES, NODES : LEAVES + 1] = 0
    index[:, SIZES, FREE_NODE : FREE_LEAF + 1] = NONE
    index[:, SIZES, NODES_FREE : LEAVES_FREE + 1] = 0


@subroutine
def gather_leaves(j, points, nodes, index, out):
    """A landmark in every particle: out [5, N]; particles that do not have it are left alone."""
    depth = index[SIZES, DEPTH]
    last_root, row = NONE, NONE
    for p in range(out.shape[1]):
        n = index[ROOTS, p]
        if n != last_root:  # copies of one particle often stand side by side
            last_root, row = n, NONE
            for level in range(depth - 1, -1, -1):
                if n == NONE:
                    break
                n = nodes[n, (j >> level) & 1]
            if n != NONE:
                row = nodes[n, LEFT]
        if row != NONE:
            for i in range(out.shape[0]):
                out[i, p] = points[row, i]


@subroutine
def write_leaves(j, column, points, nodes, index):
    """A landmark of every particle into its tree. column: [5, N]."""
    depth = index[SIZES, DEPTH]
    for p in range(column.shape[1]):
        n = _own(index[ROOTS, p], False, nodes, index)
        index[ROOTS, p] = n
        for level in range(depth - 1, -1, -1):
            side = (j >> level) & 1
            child = _own(nodes[n, side], level == 0, nodes, index)
            nodes[n, side] = child
            n = child
        row = nodes[n, LEFT]
        for i in range(column.shape[0]):
            points[row, i] = column[i, p]


@subroutine
def move_roots(nodes, index, source, destination, count):
    """Resampling by `count` moves of particles: links are copied, references counted."""
    for i in range(count):
        _release(index[ROOTS, destination[i]], nodes, index)
        root = index[ROOTS, source[i]]
        index[ROOTS, destination[i]] = root
        if root != NONE:
            nodes[root, COUNT] += 1


@inline
def _own(n, is_leaf, nodes, index):
    """The node itself where nobody else refers to it, else a copy for the one who asks, who gives up the old one."""
    if n != NONE and nodes[n, COUNT] == 1:
        return n
    new = _unused_leaf(nodes, index) if is_leaf else _unused_node(nodes, index)
    nodes[new, COUNT] = 1
    if n != NONE:
        nodes[n, COUNT] -= 1
        if not is_leaf:
            for side in range(2):
                child = nodes[n, side]
                nodes[new, side] = child
                if child != NONE:
                    nodes[child, COUNT] += 1
    return new


@inline
def _unused_node(nodes, index):
    """An inner node without children."""
    n = index[SIZES, FREE_NODE]
    if n != NONE:
        index[SIZES, FREE_NODE] = nodes[n, RIGHT]
        index[SIZES, NODES_FREE] -= 1
    else:
        n = index[SIZES, NODES]
        index[SIZES, NODES] += 1
    nodes[n, LEFT] = nodes[n, RIGHT] = NONE
    return n


@inline
def _unused_leaf(nodes, index):
    """A leaf and its row of `points`."""
    n = index[SIZES, FREE_LEAF]
    if n != NONE:
        index[SIZES, FREE_LEAF] = nodes[n, RIGHT]
        index[SIZES, LEAVES_FREE] -= 1
    else:
        n = index[SIZES, NODES]
        nodes[n, LEFT] = index[SIZES, LEAVES]
        index[SIZES, NODES] += 1
        index[SIZES, LEAVES] += 1
    nodes[n, RIGHT] = LEAF
    return n


@inline
def _release(n, nodes, index):
    """One reference less; what has none is unused, and so on downwards. The waiting are chained by their count."""
    waiting = NONE
    if n != NONE:
        nodes[n, COUNT] -= 1
        if nodes[n, COUNT] == 0:
            nodes[n, COUNT] = NONE
            waiting = n
    while waiting != NONE:
        n, waiting = waiting, nodes[waiting, COUNT]
        if nodes[n, RIGHT] == LEAF:
            nodes[n, RIGHT] = index[SIZES, FREE_LEAF]
            index[SIZES, FREE_LEAF] = n
            index[SIZES, LEAVES_FREE] += 1
            continue
        for side in range(2):
            child = nodes[n, side]
            if child == NONE:
                continue
            nodes[child, COUNT] -= 1
            if nodes[child, COUNT] == 0:
                nodes[child, COUNT] = waiting
                waiting = child
        nodes[n, RIGHT] = index[SIZES, FREE_NODE]
        index[SIZES, FREE_NODE] = n
        index[SIZES, NODES_FREE] += 1
