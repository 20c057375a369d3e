"""Filters whose belief is one joint Gaussian over robot, target and landmarks."""
