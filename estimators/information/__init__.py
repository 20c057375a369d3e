"""Filters whose belief is kept as an information matrix."""
