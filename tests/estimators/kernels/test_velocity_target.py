import numpy as np
import pytest
from scipy.linalg import expm

from estimators.kernels.jit import jit
from estimators.kernels.velocity_target import move_velocity_target
from estimators.models import MotionModel, SensorModel, TargetModel, pack_models


@jit
def step(mu, P, models, dt):
    move_velocity_target(mu, P, 0, 16, models[0], dt)


@pytest.mark.parametrize(("turn", "memory"), [(0.0, np.inf), (1.2, np.inf), (-0.7, 2.0), (0.0, 0.5)])
def test_against_the_exact_process(turn, memory):
    """dv = (w J - 1/tau) v dt + q dW, its transition and covariance by matrix exponentials (Van Loan 1978)."""
    dt, q = 0.02, 0.4
    model = np.array([pack_models(MotionModel(), SensorModel(),
                                  TargetModel(turn_rate=turn, velocity_time_constant=memory,
                                              acceleration_density=q))])  # fmt: skip
    rng = np.random.default_rng(0)
    root = rng.standard_normal((16, 16))
    P, mu = (root @ root.T)[None].copy(), rng.standard_normal((1, 16))
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    A[2:, 2:] = [[-1.0 / memory, -turn], [turn, -1.0 / memory]]
    F = np.eye(16)
    F[3:7, 3:7] = expm(A * dt)
    big = expm(np.block([[-A, q * q * np.diag([0, 0, 1, 1])], [np.zeros((4, 4)), A.T]]) * dt)
    Q = np.zeros((16, 16))
    Q[3:7, 3:7] = big[4:, 4:].T @ big[:4, 4:]
    mean, cov = F @ mu[0], F @ P[0] @ F.T + Q
    step(mu, P, model, dt)
    np.testing.assert_allclose(mu[0], mean, atol=3e-5)
    np.testing.assert_allclose(P[0], cov, atol=3e-4)
    np.testing.assert_array_equal(P[0], P[0].T)
