"""One lane's factor graph and its incremental solution by iSAM2; the one class that talks to the solver.

Everything enters as events of plain numbers, which are kept: from them a copy, or a pickle, is built again bit for
bit, and a graph that the solver found indeterminate is built without the sweep that made it so.
"""

from typing import Any, Self

import gtsam
import numpy as np

from estimators.interface import Floats
from estimators.kernels.association import TARGET_SLOT
from estimators.smoothing.events import GOES_ON, UNSEEN, Motion, Prior, Sighting, Sweep
from estimators.smoothing.factors import (
    any_heading,
    constant_velocity,
    displacement,
    drift_cov,
    landmark_key,
    pose2,
    pose_key,
    pose_prior,
    sighting,
    target_keys,
    velocity_prior,
)
from estimators.smoothing.odometry import carry

LANDMARKS_LAST, PRESENT_LAST = 1, 2  # order of elimination: all else is 0


class Graph:
    """Trajectory, landmarks and target of one lane.

    Attributes:
        history: the sweeps taken in.
        pose: [3] estimate at the last node. target: [n_t] at its last node, None without a target.
        node, target_node: numbers of these nodes.
    """

    def __init__(self, prior: Prior) -> None:
        self.prior = prior
        self.twist = prior.model is not None and prior.model.kind == "twist"
        self._start()

    @classmethod
    def again(cls, prior: Prior, history: tuple[Sweep, ...]) -> Self:
        """The graph that took in those sweeps."""
        graph = cls(prior)
        graph._replay(history)
        return graph

    def __reduce__(self) -> Any:
        return type(self).again, (self.prior, tuple(self.history))

    def _start(self) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(self.prior.threshold)
        parameters.relinearizeSkip = 1
        parameters.setFactorization("QR")  # Cholesky squares the condition number: a known start breaks it
        parameters.setOptimizationParams(gtsam.ISAM2GaussNewtonParams(0.0))
        self._solver = gtsam.ISAM2(parameters)
        self.history: list[Sweep] = []
        self.node, self.target_node = 0, -1
        self.target: Floats | None = None
        self._factors, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._sweep_sightings: tuple[Sighting, ...] = ()
        prior, key = self.prior, pose_key(0)
        self._values.insert(key, pose2(prior.pose))
        self._factors.add(pose_prior(key, prior.pose, prior.pose_cov))
        if prior.target is not None:
            self._place_target(prior.target, prior.target_cov)
        self._solve()

    def _replay(self, history: tuple[Sweep, ...] | list[Sweep]) -> None:
        for sweep in history:
            self._enter(sweep)
            self._solve()
            self.history.append(sweep)

    def take(self, sweep: Sweep) -> bool:
        """Take in a sweep; False where the solver finds no solution with it: the graph is then as it was."""
        try:
            self._enter(sweep)
            self._solve()
        except (RuntimeError, ValueError):  # what GTSAM raises for an indeterminate system, or a broken ordering
            kept = self.history
            self._start()
            self._replay(kept)
            return False
        self.history.append(sweep)
        return True

    def _enter(self, sweep: Sweep) -> None:
        """Put a sweep's factors and first guesses down for the next solution."""
        self._factors, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._sweep_sightings = sweep.sightings
        guess = pose2(self.pose).compose(pose2(sweep.motion.moved))
        before, self.node = pose_key(self.node), self.node + 1
        key = pose_key(self.node)
        self._values.insert(key, guess)
        self._factors.add(displacement(before, key, sweep.motion.moved, sweep.motion.spread))
        for seen in sweep.sightings:
            if seen.slot == TARGET_SLOT:
                continue
            if seen.is_new:
                self._values.insert(landmark_key(seen.slot), point_of(guess, seen))
            self._factors.add(sighting(key, landmark_key(seen.slot), seen, False))
        if sweep.target != UNSEEN:
            self._enter_target(sweep, guess)

    def _enter_target(self, sweep: Sweep, guess: Any) -> None:
        """The target's sightings, and its motion since the last ones; it is guessed to be where it is seen."""
        seen = [one for one in sweep.sightings if one.slot == TARGET_SLOT]
        place = point_of(guess, seen[0]) if seen else None
        if sweep.target == GOES_ON:
            self._carry_target_on(sweep, place)
        elif self.twist:
            self._start_from_chord(sweep, place)
        else:
            model = self.prior.model
            assert model is not None and place is not None  # for the type checker
            state = np.append(place, [0.0, 0.0])
            keys = target_keys(self.node, False)
            self._insert_target(keys, state)
            std = gtsam.noiseModel.Isotropic.Sigma(2, model.initial_speed_std)
            self._factors.add(gtsam.PriorFactorPoint2(keys[1], np.zeros(2), std))
        self.target_node = self.node
        for one in seen:
            self._factors.add(sighting(pose_key(self.node), target_keys(self.node, self.twist)[0], one, self.twist))

    def _carry_target_on(self, sweep: Sweep, place: Floats | None) -> None:
        model, last = self.prior.model, self.target
        assert model is not None and last is not None  # for the type checker
        place = self.drifted(sweep.motion)[0][:2] if place is None else place
        before, keys = target_keys(self.target_node, self.twist), target_keys(self.node, self.twist)
        if self.twist:
            self._insert_target(keys, np.append(place, last[2] + sweep.motion.drift[2]))
            self._factors.add(displacement(before[0], keys[0], sweep.motion.drift, sweep.motion.drift_spread))
            return
        self._insert_target(keys, np.append(place, last[2:]))
        self._factors.add(constant_velocity(before, keys, sweep.motion.elapsed, model.acceleration_density))

    def _start_from_chord(self, sweep: Sweep, place: Floats | None) -> None:
        """A twist target enters with two poses: where it was first seen, and now; the chord guesses its heading."""
        assert place is not None and sweep.first_sighting is not None  # for the type checker
        node, seen = sweep.first_sighting
        first, keys = target_keys(node, True), target_keys(self.node, True)
        start = point_of(self._solver.calculateEstimatePose2(pose_key(node)), seen)
        chord, expected = place - start, sweep.motion.drift
        heading = np.arctan2(chord[1], chord[0]) - np.arctan2(expected[1], expected[0])
        self._insert_target(first, np.append(start, heading))
        self._insert_target(keys, np.append(place, heading + expected[2]))
        self._factors.add(any_heading(first[0], heading))
        self._factors.add(sighting(pose_key(node), first[0], seen, True))
        self._factors.add(displacement(first[0], keys[0], expected, sweep.motion.drift_spread))

    def _place_target(self, state: Floats, cov: Floats | None) -> None:
        """The target's prior."""
        assert cov is not None  # for the type checker
        self.target_node = 0
        keys = target_keys(0, self.twist)
        self._insert_target(keys, state)
        self._factors.add(pose_prior(keys[0], state, cov) if self.twist else velocity_prior(keys, state, cov))

    def _insert_target(self, keys: list[int], state: Floats) -> None:
        if self.twist:
            self._values.insert(keys[0], pose2(state))
        else:
            self._values.insert(keys[0], state[:2])
            self._values.insert(keys[1], state[2:])

    def _solve(self) -> None:
        """Solve with what was put down.

        Raises:
            RuntimeError: indeterminate, or a solution that is not finite.
        """
        self._solver.update(self._factors, self._values, [], self._last_to_go())
        for _ in range(self.prior.iterations - 1):
            self._solver.update()
        self.pose = self._pose_at(pose_key(self.node))
        if self.target_node >= 0:
            keys = target_keys(self.target_node, self.twist)
            self.target = self._pose_at(keys[0]) if self.twist else np.concatenate([self._point_at(k) for k in keys])
        if not np.isfinite(self.pose).all() or (self.target is not None and not np.isfinite(self.target).all()):
            raise RuntimeError("the solution is not finite")

    def drifted(self, motion: Motion) -> tuple[Floats, Floats, Floats]:
        """The target moved on from its node: state [n_t], F and Q [n_t, n_t]."""
        assert self.target is not None and self.prior.model is not None  # for the type checker
        if self.twist:
            return carry(self.target, motion.drift, motion.drift_spread)
        F = np.eye(4)
        F[0, 2] = F[1, 3] = motion.elapsed
        return F @ self.target, F, drift_cov(motion.elapsed, self.prior.model.acceleration_density)

    def pose_at(self, node: int) -> Floats:
        """Estimate [3] of the robot's pose at a node."""
        return self._pose_at(pose_key(node))

    def _last_to_go(self) -> Any:
        """What is eliminated last, so that its marginals lie at the root: landmarks just seen, then the present."""
        if self.node == 0:
            return None  # nothing but the present: GTSAM fails at groups without others
        groups = gtsam.KeyGroupMap()
        for slot in {one.slot for one in self._sweep_sightings if one.slot != TARGET_SLOT}:
            groups.insert2(landmark_key(slot), LANDMARKS_LAST)
        groups.insert2(pose_key(self.node), PRESENT_LAST)
        if self.target_node == self.node:
            for key in target_keys(self.node, self.twist):
                groups.insert2(key, PRESENT_LAST)
        return groups

    def landmark(self, slot: int) -> Floats:
        """Estimate [2] of the landmark in a slot."""
        return self._point_at(landmark_key(slot))

    def joint(self, with_target: bool, num_landmarks: int) -> Floats:
        """Covariance over the last pose, the target's last state and the first landmarks, world axes.

        Raises:
            RuntimeError: the solver finds the system indeterminate.
        """
        keys, headings = [pose_key(self.node)], [(0, self.pose[2])]
        if with_target:
            keys += target_keys(self.target_node, self.twist)
            if self.twist and self.target is not None:
                headings.append((3, self.target[2]))
        keys += [landmark_key(slot) for slot in range(num_landmarks)]
        cov = np.array(self._solver.jointMarginalCovariance(keys).fullMatrix())
        for row, heading in headings:  # GTSAM's are in the poses' own axes
            c, s = np.cos(heading), np.sin(heading)
            R = np.array([[c, -s], [s, c]])
            cov[row : row + 2] = R @ cov[row : row + 2]
            cov[:, row : row + 2] = cov[:, row : row + 2] @ R.T
        if not np.isfinite(cov).all():
            raise RuntimeError("the covariance is not finite")
        return 0.5 * (cov + cov.T)

    def _pose_at(self, key: int) -> Floats:
        pose = self._solver.calculateEstimatePose2(key)
        return np.array([pose.x(), pose.y(), pose.theta()])

    def _point_at(self, key: int) -> Floats:
        return np.array(self._solver.calculateEstimatePoint2(key))


def point_of(pose: Any, seen: Sighting) -> Floats:
    """Where a return comes from, seen from a GTSAM pose."""
    way = seen.distance * np.array([np.cos(seen.bearing), np.sin(seen.bearing)])
    return np.array(pose.transformFrom(way))
