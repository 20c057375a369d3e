"""Where the particles' landmarks lie: columns that are put into the particles' order only when they are touched.

A landmark is a column, one small EKF per particle. Resampling would move every column of the map; instead it moves one
row of ancestors per epoch: who, in the order of the time a column was last touched, each particle of today descends
from. A column is gathered through its row when it is seen again. Once all particles descend from one, the column says
one thing only: it collapses to a single point and its memory is free. Values are copied, never computed, so the result
is that of dense storage bit for bit; time and memory depend on what is in view and on how fast the particles' past
becomes common, not on the size of the map (measured in tests/benchmarks/test_map_storage.py).

One lane of a store:

    columns   [C, 5, N]   buffers of columns in use; C grows with need
    points    [M, 5]      the collapsed landmarks
    ancestors [E, N]      per epoch
    index     [7, W]      see the names below

In dense storage landmark j is columns[j], and every resampling moves all of them. In a tree (`tree_storage`: `points`
are its leaves, `ancestors` [P, 3] its nodes) a column is gathered from the leaves into a buffer when it is touched, and
put back before anything else happens to the particles: buffers hold one sweep's landmarks.
"""

import numpy as np

from estimators.kernels.jit import disjoint, subroutine
from estimators.kernels.resampling import move_columns
from estimators.kernels.simd import aligned_zeros
from estimators.particle.layout import MAP_ROWS
from estimators.particle.tree_storage import (
    LEAVES,
    LEAVES_FREE,
    NODES,
    NODES_FREE,
    SIZES,
    clear_tree,
    depth_of,
    gather_leaves,
    move_roots,
    write_leaves,
)

DENSE, LAZY, TREE = 0, 1, 2
STORES = {"lazy": LAZY, "tree": TREE, "dense": DENSE}

BUFFER = 0  # [M] of a landmark; COLLAPSED: its numbers are in `points`
EPOCH = 1  # [M] of a landmark: row of `ancestors`; CURRENT: in the particles' present order (a tree's roots stand here)
FREE = 2  # [C] stack of unused buffers
USERS = 3  # [E] landmarks per row of ancestors
TOUCHED = 4  # [M] stack of the landmarks that are current
LOWEST = 6  # [E] the first landmark of a row of ancestors
KIND = 3
"""In row SIZES: [0] height of FREE; [1] height of TOUCHED; [2] rows of ancestors in use so far; [3] the kind of store;
then a tree's own."""
INDEX_ROWS, SIZES_WIDTH = 7, 11
COLLAPSED, CURRENT = -1, -1
MAX_EPOCHS = 256
FIRST_BUFFERS = 64
ENDLESS = 1 << 62


def allocate(num_lanes, max_landmarks, num_particles, kind):
    """Empty stores of L lanes: columns [L, C, 5, N], points, ancestors, index. kind: DENSE, LAZY or TREE."""
    L, M, N = num_lanes, max_landmarks, num_particles
    buffers = {DENSE: M, LAZY: min(M + 1, FIRST_BUFFERS), TREE: 0}[kind]
    epochs = min(M, MAX_EPOCHS) + 1 if kind == LAZY else 0
    columns = aligned_zeros(L, buffers, MAP_ROWS, N)
    points = np.zeros((L, M if kind == LAZY else 0, MAP_ROWS))
    ancestors = np.zeros((L, epochs, 3 if kind == TREE else N), dtype=np.int32)
    width = max(M + 1, epochs, N if kind == TREE else 0, SIZES_WIDTH)
    return columns, points, ancestors, np.zeros((L, INDEX_ROWS, width), dtype=np.int32)


def clear(index, buffers, kind, max_landmarks):
    """Forget everything in these lanes. index: [n, 7, W]."""
    index[:] = 0
    index[:, SIZES, KIND] = kind
    if kind == DENSE:
        index[:, BUFFER, :buffers], index[:, EPOCH] = np.arange(buffers), CURRENT
        return
    index[:, BUFFER], index[:, EPOCH] = COLLAPSED, CURRENT
    index[:, FREE, :buffers] = np.arange(buffers)[::-1]
    index[:, SIZES, 0] = buffers
    if kind == TREE:
        clear_tree(index, max_landmarks)


def touches_left(columns, index, max_landmarks):
    """How many landmarks may be touched, in any lane, before `make_room` is to be asked again."""
    kind = index[0, SIZES, KIND]
    if kind == TREE:
        return 0
    if kind == DENSE or columns.shape[1] > max_landmarks:
        return ENDLESS
    return int(index[:, SIZES, 0].min()) - 1  # one is always kept, for columns to be gathered into


def make_room(columns, points, ancestors, index, need, max_landmarks):
    """The store with room for `need` landmarks to be touched in every lane; arrays that must grow are new ones."""
    kind = index[0, SIZES, KIND]
    if kind != DENSE and columns.shape[1] <= max_landmarks and index[:, SIZES, 0].min() <= need:
        columns = grown(columns, index, need + 1, max_landmarks)
    if kind == TREE:
        sizes, leaves = index[:, SIZES], need * columns.shape[3]
        short = leaves - int((points.shape[1] - sizes[:, LEAVES] + sizes[:, LEAVES_FREE]).min())
        points = _extended(points, short)
        inner = leaves * (1 + depth_of(max_landmarks))
        spare = ancestors.shape[1] - sizes[:, NODES] + np.minimum(sizes[:, NODES_FREE], inner - leaves)
        ancestors = _extended(ancestors, inner - int((spare + np.minimum(sizes[:, LEAVES_FREE], leaves)).min()))
    return columns, points, ancestors


def _extended(rows, short):
    """[L, R, C] with at least `short` more rows, by half its size at least; itself where nothing is short."""
    if short <= 0:
        return rows
    more = np.zeros((rows.shape[0], max(short, rows.shape[1] // 2), rows.shape[2]), dtype=rows.dtype)
    return np.concatenate([rows, more], axis=1)


def grown(columns, index, need, max_landmarks):
    """Columns with `need` unused ones in every lane, or as many as can be used; the index is told."""
    old = columns.shape[1]
    short = need - int(index[:, SIZES, 0].min())
    new = min(max_landmarks + 1, old + max(short, old // 2))
    more = aligned_zeros(columns.shape[0], new, *columns.shape[2:])
    more[:, :old] = columns
    for lane in range(columns.shape[0]):
        free = index[lane, SIZES, 0]
        index[lane, FREE, free : free + new - old] = np.arange(old, new)
    index[:, SIZES, 0] += new - old
    return more


def bytes_in_use(columns, points, ancestors, index, landmarks):
    """[L] bytes that hold the particles' maps, see `SLAMTO.map_bytes`. landmarks: [L] in the map."""
    column, sizes = columns[0, :1].nbytes, index[:, SIZES].astype(np.int64)
    kind = sizes[0, KIND]
    if kind == DENSE:
        return landmarks * column
    touched = (columns.shape[1] - sizes[:, 0]) * column
    point, row = points[0, :1].nbytes, ancestors[0, :1].nbytes
    if kind == TREE:
        leaves, nodes = sizes[:, LEAVES] - sizes[:, LEAVES_FREE], sizes[:, NODES]
        live = nodes - sizes[:, NODES_FREE] - sizes[:, LEAVES_FREE]
        return touched + leaves * point + live * row + index.itemsize * columns.shape[3]
    used = np.arange(index.shape[2]) < landmarks[:, None]
    collapsed = (used & (index[:, BUFFER] == COLLAPSED)).sum(axis=1)
    epochs = (index[:, USERS, : ancestors.shape[1]] > 0).sum(axis=1)
    return touched + collapsed * point + epochs * row + 2 * index.itemsize * landmarks


@disjoint
def gather(column, ancestors, out):
    """out[:, p] = column[:, ancestors[p]]."""
    for row in range(column.shape[0]):
        source, to = column[row], out[row]
        for p in range(ancestors.size):
            to[p] = source[np.uint32(ancestors[p])]  # unsigned: not counted from the end


@subroutine
def open_column(j, columns, points, ancestors, index):
    """A landmark's column [5, N] in the particles' present order, to be read and written.

    It is gathered into an unused buffer, and its own becomes unused: one must be there.
    """
    epoch = index[EPOCH, j]
    if index[BUFFER, j] == COLLAPSED:
        index[SIZES, 0] -= 1
        index[BUFFER, j] = index[FREE, index[SIZES, 0]]
        column = columns[index[BUFFER, j]]
        _spread(j, points, ancestors, index, column)
    elif index[SIZES, KIND] != LAZY or epoch == CURRENT:
        return columns[index[BUFFER, j]]
    else:
        top = index[SIZES, 0] - 1
        column = columns[index[FREE, top]]
        gather(columns[index[BUFFER, j]], ancestors[epoch], column)
        index[FREE, top], index[BUFFER, j] = index[BUFFER, j], index[FREE, top]
        index[USERS, epoch] -= 1
        index[EPOCH, j] = CURRENT
    index[TOUCHED, index[SIZES, 1]] = j
    index[SIZES, 1] += 1
    return column


@subroutine
def read_column(j, columns, points, ancestors, index, work):
    """The same column, only to be read: the store stays as it is. work: [5, N], may be what is returned."""
    if index[BUFFER, j] == COLLAPSED:
        _spread(j, points, ancestors, index, work)
        return work
    column = columns[index[BUFFER, j]]
    if index[SIZES, KIND] != LAZY or index[EPOCH, j] == CURRENT:
        return column
    gather(column, ancestors[index[EPOCH, j]], work)
    return work


@subroutine
def _spread(j, points, ancestors, index, out):
    """A landmark without a buffer, in all particles: from its point, or from the leaves. out: [5, N]."""
    if index[SIZES, KIND] == TREE:
        gather_leaves(j, points, ancestors, index, out)
        return
    for row in range(out.shape[0]):
        for p in range(out.shape[1]):
            out[row, p] = points[j, row]


@subroutine
def put_away(columns, points, ancestors, index):
    """A tree takes back what was touched since the last call; other stores keep it where it is."""
    if index[SIZES, KIND] != TREE:
        return
    for i in range(index[SIZES, 1]):
        j = index[TOUCHED, i]
        write_leaves(j, columns[index[BUFFER, j]], points, ancestors, index)
        index[FREE, index[SIZES, 0]] = index[BUFFER, j]
        index[SIZES, 0] += 1
        index[BUFFER, j] = COLLAPSED
    index[SIZES, 1] = 0


@subroutine
def move_particles(landmarks, columns, points, ancestors, index, source, destination, count):
    """Resampling by `count` moves of particles. landmarks: number in the map."""
    if index[SIZES, KIND] == DENSE:
        for j in range(landmarks):
            move_columns(columns[j], source, destination, count)
        return
    if index[SIZES, KIND] == TREE:
        move_roots(ancestors, index, source, destination, count)
        return
    if count == 0:
        return
    if index[SIZES, 1] > 0:
        _close_epoch(landmarks, columns, points, ancestors, index)
    for epoch in range(index[SIZES, 2]):
        if index[USERS, epoch] == 0:
            continue
        row = ancestors[epoch]
        for i in range(count):
            row[destination[i]] = row[source[i]]
        p = 1
        while p < row.size and row[p] == row[0]:
            p += 1
        if p == row.size:
            _collapse(columns, points, index, epoch, row[0])


@subroutine
def _close_epoch(landmarks, columns, points, ancestors, index):
    """The current columns get a row of ancestors of their own, each particle its own ancestor so far."""
    epoch = 0
    while epoch < index[SIZES, 2] and index[USERS, epoch] > 0:
        epoch += 1
    if epoch == ancestors.shape[0]:  # all rows are in use: the first one's landmarks become current
        epoch = 0
        for j in range(landmarks):
            if index[EPOCH, j] == epoch and index[BUFFER, j] != COLLAPSED:
                open_column(j, columns, points, ancestors, index)
    index[SIZES, 2] = max(index[SIZES, 2], epoch + 1)
    for p in range(ancestors.shape[1]):
        ancestors[epoch, p] = p
    index[LOWEST, epoch] = landmarks
    for i in range(index[SIZES, 1]):
        index[EPOCH, index[TOUCHED, i]] = epoch
        index[LOWEST, epoch] = min(index[LOWEST, epoch], index[TOUCHED, i])
    index[USERS, epoch] = index[SIZES, 1]
    index[SIZES, 1] = 0


@subroutine
def _collapse(columns, points, index, epoch, ancestor):
    """All particles descend from one: the epoch's columns become points."""
    j = index[LOWEST, epoch]
    while index[USERS, epoch] > 0:
        if index[EPOCH, j] == epoch:
            for row in range(points.shape[1]):
                points[j, row] = columns[index[BUFFER, j], row, ancestor]
            index[FREE, index[SIZES, 0]] = index[BUFFER, j]
            index[SIZES, 0] += 1
            index[BUFFER, j], index[EPOCH, j] = COLLAPSED, CURRENT
            index[USERS, epoch] -= 1
        j += 1
