"""Filters whose belief is a set of weighted trajectories, each with small Kalman filters inside."""
