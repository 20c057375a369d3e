"""Where the particles' landmarks lie: columns that are put into the particles' order only when they are touched.

A landmark is a column, one small EKF per particle. Resampling would move every column of the map; instead it moves one
row of ancestors per epoch: who, in the order of the time a column was last touched, each particle of today descends
from. A column is gathered through its row when it is seen again. Once all particles descend from one, the column says
one thing only: it collapses to a single point and its memory is free. Values are copied, never computed, so the result
is that of dense storage bit for bit; time and memory depend on what is in view and on how fast the particles' past
becomes common, not on the size of the map (measured in `benchmark_storage` of the tests).

One lane of a store:

    columns   [C, 5, N]   buffers of columns in use; C grows with need
    points    [M, 5]      the collapsed landmarks
    ancestors [E, N]      per epoch
    index     [6, W]      see the names below

In dense storage landmark j is columns[j], and every resampling moves all of them.
"""

import numpy as np

from estimators.kernels.jit import jit
from estimators.kernels.resampling import move_columns
from estimators.particle.layout import MAP_ROWS

BUFFER = 0  # [M] of a landmark; COLLAPSED: its numbers are in `points`
EPOCH = 1  # [M] of a landmark: row of `ancestors`; CURRENT: in the particles' present order
FREE = 2  # [C] stack of unused buffers
USERS = 3  # [E] landmarks per row of ancestors
TOUCHED = 4  # [M] stack of the landmarks that are current
SIZES = 5  # [0]: height of FREE; [1]: height of TOUCHED; [2]: rows of ancestors in use so far
INDEX_ROWS = 6
COLLAPSED, CURRENT = -1, -1
MAX_EPOCHS = 256
FIRST_BUFFERS = 64


def allocate(num_lanes, max_landmarks, num_particles, lazy):
    """Empty stores of L lanes: columns [L, C, 5, N], points, ancestors, index."""
    L, M, N = num_lanes, max_landmarks, num_particles
    buffers = min(M + 1, FIRST_BUFFERS) if lazy else M
    epochs = min(M, MAX_EPOCHS) + 1 if lazy else 0
    columns = np.zeros((L, buffers, MAP_ROWS, N))
    points = np.zeros((L, M if lazy else 0, MAP_ROWS))
    ancestors = np.zeros((L, epochs, N), dtype=np.int32)
    index = np.zeros((L, INDEX_ROWS, max(M + 1, epochs, 3)), dtype=np.int32)
    return columns, points, ancestors, index


def clear(index, buffers, lazy):
    """Forget everything in these lanes. index: [n, 6, W]."""
    index[:] = 0
    if lazy:
        index[:, BUFFER], index[:, EPOCH] = COLLAPSED, CURRENT
        index[:, FREE, :buffers] = np.arange(buffers)[::-1]
        index[:, SIZES, 0] = buffers
    else:
        index[:, BUFFER, :buffers], index[:, EPOCH] = np.arange(buffers), CURRENT


def grown(columns, index, need, max_landmarks):
    """Columns with `need` unused ones in every lane, or as many as can be used; the index is told."""
    old = columns.shape[1]
    short = need - int(index[:, SIZES, 0].min())
    new = min(max_landmarks + 1, old + max(short, old // 2))
    more = np.zeros((columns.shape[0], new, *columns.shape[2:]))
    more[:, :old] = columns
    for lane in range(columns.shape[0]):
        free = index[lane, SIZES, 0]
        index[lane, FREE, free : free + new - old] = np.arange(old, new)
    index[:, SIZES, 0] += new - old
    return more


@jit
def gather(column, ancestors, out):
    """out[:, p] = column[:, ancestors[p]]."""
    for row in range(column.shape[0]):
        source, to = column[row], out[row]
        for p in range(ancestors.size):
            to[p] = source[ancestors[p]]


@jit
def open_column(j, columns, points, ancestors, index):
    """A landmark's column [5, N] in the particles' present order, to be read and written.

    It is gathered into an unused buffer, and its own becomes unused: one must be there.
    """
    epoch = index[EPOCH, j]
    if index[BUFFER, j] == COLLAPSED:
        index[SIZES, 0] -= 1
        index[BUFFER, j] = index[FREE, index[SIZES, 0]]
        column = columns[index[BUFFER, j]]
        for row in range(column.shape[0]):
            for p in range(column.shape[1]):
                column[row, p] = points[j, row]
    elif epoch == CURRENT:
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


@jit
def read_column(j, columns, points, ancestors, index, work):
    """The same column, only to be read: the store stays as it is. work: [5, N], may be what is returned."""
    if index[BUFFER, j] == COLLAPSED:
        for row in range(work.shape[0]):
            for p in range(work.shape[1]):
                work[row, p] = points[j, row]
        return work
    column = columns[index[BUFFER, j]]
    if index[EPOCH, j] == CURRENT:
        return column
    gather(column, ancestors[index[EPOCH, j]], work)
    return work


@jit
def move_particles(landmarks, columns, points, ancestors, index, source, destination, count):
    """Resampling by `count` moves of particles. landmarks: number in the map."""
    if ancestors.shape[0] == 0:
        for j in range(landmarks):
            move_columns(columns[j], source, destination, count)
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
            _collapse(landmarks, columns, points, index, epoch, row[0])


@jit
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
    for i in range(index[SIZES, 1]):
        index[EPOCH, index[TOUCHED, i]] = epoch
    index[USERS, epoch] = index[SIZES, 1]
    index[SIZES, 1] = 0


@jit
def _collapse(landmarks, columns, points, index, epoch, ancestor):
    """All particles descend from one: the epoch's columns become points."""
    for j in range(landmarks):
        if index[EPOCH, j] == epoch and index[BUFFER, j] != COLLAPSED:
            for row in range(points.shape[1]):
                points[j, row] = columns[index[BUFFER, j], row, ancestor]
            index[FREE, index[SIZES, 0]] = index[BUFFER, j]
            index[SIZES, 0] += 1
            index[BUFFER, j], index[EPOCH, j] = COLLAPSED, CURRENT
    index[USERS, epoch] = 0
