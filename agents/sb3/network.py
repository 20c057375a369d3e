"""A trained actor as a compiled function: normalise, a few dense layers, an action. Needs no torch.

Each lane is computed alone and in the same order, so that an action does not depend on how many lanes there are (a
matrix product of a whole batch would: its sums are ordered by the batch's size).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.jit import jit

Floats = NDArray[np.float64]

ACTIVATIONS = {"tanh": 0, "relu": 1}
OUTPUTS = {"clip": 0, "tanh": 1}  # how an output becomes an action in [-1, 1]


@jit
def _forward(
    lanes, observation, mean, inverse_std, clip, weights, biases, sizes, activation, output, scratch, action
):  # fmt: skip
    """Actions of the lanes [n].

    observation [L, s0] float32; mean, inverse_std [s0]; weights: every layer's [inputs, outputs] in a row; biases
    likewise; sizes: of the layers, the input first; scratch [2, widest]; action [L, 2]: output.
    """
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        for i in range(sizes[0]):
            scratch[0, i] = min(max((observation[lane, i] - mean[i]) * inverse_std[i], -clip), clip)
        w, b, here = 0, 0, 0
        for layer in range(sizes.shape[0] - 1):
            n_in, n_out, last = sizes[layer], sizes[layer + 1], layer == sizes.shape[0] - 2
            there = 1 - here
            for j in range(n_out):
                scratch[there, j] = biases[b + j]
            for i in range(n_in):
                x = scratch[here, i]
                for j in range(n_out):
                    scratch[there, j] += x * weights[w + j]
                w += n_out
            b += n_out
            if not last:
                for j in range(n_out):
                    x = scratch[there, j]
                    scratch[there, j] = math.tanh(x) if activation == 0 else max(x, 0.0)
            here = there
        for j in range(2):
            x = scratch[here, j]
            action[lane, j] = math.tanh(x) if output == 1 else min(max(x, -1.0), 1.0)


@dataclass(frozen=True)
class Normalisation:
    """Observations less their mean, over their standard deviation, cut; as Stable-Baselines3's VecNormalize does."""

    mean: Floats  # [n]
    variance: Floats  # [n]
    clip: float = 10.0
    epsilon: float = 1e-8


class Network:
    """Observations in, actions out.

    Args:
        layers: (weight [outputs, inputs], bias [outputs]) of each, as torch keeps them; the last has 2 outputs.
        activation: between layers, a name of `ACTIVATIONS`.
        output: a name of `OUTPUTS`.
        normalisation: of observations; None: as they are.

    Attributes:
        size: n, numbers of an observation.

    Raises:
        ValueError: layers that do not fit together, or an unknown name.
    """

    def __init__(
        self,
        layers: list[tuple[NDArray[Any], NDArray[Any]]],
        activation: str,
        output: str,
        normalisation: Normalisation | None = None,
    ) -> None:
        if activation not in ACTIVATIONS or output not in OUTPUTS:
            raise ValueError(
                f"activation must be one of {', '.join(ACTIVATIONS)} and output one of {', '.join(OUTPUTS)}; "
                f"got {activation!r} and {output!r}"
            )
        sizes = [layers[0][0].shape[1], *(weight.shape[0] for weight, _ in layers)]
        for (weight, bias), n_in, n_out in zip(layers, sizes, sizes[1:], strict=False):
            if weight.shape != (n_out, n_in) or bias.shape != (n_out,):
                raise ValueError(f"layers do not fit together: {[w.shape for w, _ in layers]}")
        if sizes[-1] != 2:
            raise ValueError(f"an action has 2 components; the last layer gives {sizes[-1]}")
        self.size = int(sizes[0])
        self._weights = np.concatenate([weight.T.astype(np.float64).ravel() for weight, _ in layers])
        self._biases = np.concatenate([bias.astype(np.float64) for _, bias in layers])
        self._sizes = np.array(sizes, dtype=np.int64)
        self._scratch = np.zeros((2, max(sizes)))
        self._codes = (ACTIVATIONS[activation], OUTPUTS[output])
        norm = normalisation or Normalisation(np.zeros(self.size), np.ones(self.size), np.inf, 0.0)
        if norm.mean.shape != (self.size,) or norm.variance.shape != (self.size,):
            raise ValueError(f"the normalisation is of {norm.mean.shape} numbers; an observation has {self.size}")
        self._mean = norm.mean.astype(np.float64)
        self._inverse_std = 1.0 / np.sqrt(norm.variance.astype(np.float64) + norm.epsilon)
        self._clip = float(norm.clip)

    def act(self, observation: NDArray[np.float32], lanes: NDArray[np.int64], action: Floats) -> None:
        """Write the actions of the lanes [n] into action [L, 2]; observation [L, size]."""
        _forward(
            lanes, observation, self._mean, self._inverse_std, self._clip, self._weights, self._biases, self._sizes,
            *self._codes, self._scratch, action,
        )  # fmt: skip
