"""The same joint EKF in the packages that people use today: FilterPy and Stone Soup.

Each takes the state over from ours after the map is whole, and does the same arithmetic from there: one prediction and
one update for each return. Both are in the extra `bench`.
"""

from datetime import datetime, timedelta
from typing import Any

import numpy as np

from estimators.interface import Estimator, Floats
from slam_gym.benchmark import textbook
from slam_gym.benchmark.stream import DT, Sweep


class FilterPyEKF:
    """`filterpy.kalman.ExtendedKalmanFilter`. Args: start, whose belief it takes over."""

    def __init__(self, start: Estimator) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        mean, cov = start.joint(0)
        self.ids = [int(i) for i in start.belief.landmark_id[0] if i >= 0]
        self.filter = ExtendedKalmanFilter(dim_x=len(mean), dim_z=2)
        self.filter.x, self.filter.P = mean.copy(), cov.copy()

    def step(self, sweep: Sweep) -> None:
        """One prediction, one update for each return."""
        own = self.filter
        own.F, own.Q = (f(own.x, sweep.control) for f in (textbook.motion_jacobian, textbook.motion_noise))
        own.P = own.F @ own.P @ own.F.T + own.Q
        own.x = textbook.moved(own.x, sweep.control)
        for z, label in zip(sweep.returns, sweep.labels, strict=True):
            j = textbook.row_of(int(label), self.ids)
            own.update(
                z, textbook.return_jacobian, textbook.expected, R=textbook.return_noise(own.x, j), args=(j,),
                hx_args=(j,), residual=_innovation,
            )  # fmt: skip
            own.x[2] = textbook.wrap(own.x[2])

    @property
    def mean(self) -> Floats:
        """[n]."""
        return self.filter.x


def _innovation(z: Floats, expected: Floats) -> Floats:
    y = z - expected
    y[1] = textbook.wrap(y[1])
    return y


class StoneSoupEKF:
    """`stonesoup`'s `ExtendedKalmanPredictor` and `ExtendedKalmanUpdater`. Args: start, whose belief it takes over."""

    def __init__(self, start: Estimator) -> None:
        from stonesoup.predictor.kalman import ExtendedKalmanPredictor
        from stonesoup.types.state import GaussianState
        from stonesoup.updater.kalman import ExtendedKalmanUpdater

        mean, cov = start.joint(0)
        self.ids = [int(i) for i in start.belief.landmark_id[0] if i >= 0]
        self.motion, make_return = _stone_soup_models(len(mean))
        self.returns = {j: make_return(j) for j in (textbook.row_of(i, self.ids) for i in (-2, *self.ids))}
        self.predictor, self.updater = ExtendedKalmanPredictor(self.motion), ExtendedKalmanUpdater(None)
        self.time = datetime(2000, 1, 1)
        self.state: Any = GaussianState(mean, cov, timestamp=self.time)

    def step(self, sweep: Sweep) -> None:
        """One prediction, one update for each return."""
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        self.time += timedelta(seconds=DT)
        self.motion.control = sweep.control
        prediction = self.predictor.predict(self.state, timestamp=self.time)
        for z, label in zip(sweep.returns, sweep.labels, strict=True):
            j = textbook.row_of(int(label), self.ids)
            model = self.returns[j]
            model.noise = textbook.return_noise(np.asarray(prediction.state_vector, dtype=float).ravel(), j)
            detection = Detection(np.array(z), timestamp=self.time, measurement_model=model)
            prediction = self.updater.update(SingleHypothesis(prediction, detection))
            prediction.state_vector[2, 0] = textbook.wrap(float(prediction.state_vector[2, 0]))
        self.state = prediction

    @property
    def mean(self) -> Floats:
        """[n]."""
        return np.asarray(self.state.state_vector, dtype=float).ravel()


def _stone_soup_models(size: int) -> tuple[Any, Any]:
    """The motion, and what makes the return of the point at a row, as Stone Soup's models."""
    from stonesoup.base import Property
    from stonesoup.models.base import GaussianModel, TimeVariantModel
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.base import TransitionModel
    from stonesoup.types.angle import Bearing
    from stonesoup.types.array import StateVector

    def numbers(state: Any) -> Floats:
        return np.asarray(state.state_vector, dtype=float).ravel()

    class Motion(TransitionModel, GaussianModel, TimeVariantModel):  # type: ignore[misc]
        control: Any = Property(default=(0.0, 0.0))
        _last: Any = None

        @property
        def ndim_state(self) -> int:
            return size

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            self._last = numbers(state)
            return StateVector(textbook.moved(self._last, self.control))

        def jacobian(self, state: Any, **kwargs: Any) -> Any:
            self._last = numbers(state)
            return textbook.motion_jacobian(self._last, self.control)

        def covar(self, **kwargs: Any) -> Any:
            return textbook.motion_noise(self._last, self.control)

    class Return(NonLinearGaussianMeasurement):  # type: ignore[misc]
        row: int = Property(default=0)
        noise: Any = Property(default=None)

        @property
        def ndim_meas(self) -> int:
            return 2

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            r, b = textbook.expected(numbers(state), self.row)
            return StateVector([[r], [Bearing(b)]])

        def jacobian(self, state: Any, **kwargs: Any) -> Any:
            return textbook.return_jacobian(numbers(state), self.row)

        def covar(self, **kwargs: Any) -> Any:
            return self.noise

    def make(row: int) -> Any:
        return Return(ndim_state=size, mapping=(0, 1), noise_covar=np.eye(2), row=row)

    return Motion(), make
