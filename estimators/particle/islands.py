"""Weights and resampling within islands: equal groups of particles, each a particle filter of its own.

Resampling copies whole histories. What it loses of the particles' spread in a direction that later returns say nothing
of, such as where the whole map lies, is lost for good, while the cloud's mean keeps the error that its small number
made: after a hundred sweeps the covariance is far too small. Groups that never exchange particles make their errors
independently. The mean over them errs less than any of them, and how far they lie apart, which is part of the mixture's
covariance, is how large such an error is.

Island i holds the particles i N/I ... (i + 1) N/I - 1 and always 1/I of the weight. One island is the plain filter.
"""

from estimators.kernels.jit import subroutine
from estimators.kernels.random import uniform4
from estimators.kernels.resampling import moves, normalise, systematic
from estimators.particle.layout import DRAW_RESAMPLE

MOST_ISLANDS = 62  # bits of `due`


@subroutine
def weigh(lane, state, log_w, w, islands, threshold):
    """Normalise the weights in every island, see which are to be resampled. log_w, w: [N]."""
    size = w.size // islands
    state[lane].due = 0
    for i in range(islands):
        own = w[i * size : (i + 1) * size]
        effective, bad, collapsed = normalise(log_w[i * size : (i + 1) * size], own)
        for p in range(size if islands > 1 else 0):
            own[p] /= islands
        state[lane].collapsed_weights += collapsed
        state[lane].bad_weights += bad
        # A particle that is not a number is replaced at once; else a threshold of zero would keep it for ever.
        if effective < threshold * size or bad > 0:
            state[lane].due |= 1 << i


@subroutine
def draw_survivors(lane, state, log_w, w, islands, copies, source, destination):
    """Systematic resampling in the islands where it is due: their weights made equal, and how particles are to move.

    copies, source, destination: [N] integers, the last two written up to the returned number of moves.
    """
    size, count = w.size // islands, 0
    for i in range(islands):
        if (state[lane].due >> i) & 1 == 0:
            continue
        first = i * size
        own = w[first : first + size]
        for p in range(size):
            own[p] *= islands
        state[lane].resampled += 1
        u = uniform4(state[lane].key, 0, state[lane].step, DRAW_RESAMPLE, state[lane].resampled)[0]
        systematic(own, u, copies)
        found = moves(copies[:size], source[count:], destination[count:])
        for k in range(count, count + found):
            source[k] += first
            destination[k] += first
        count += found
        for p in range(first, first + size):
            log_w[p] = 0.0
            w[p] = 1.0 / w.size
    state[lane].due = 0
    return count
