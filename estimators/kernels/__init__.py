"""Shared small mathematics, compiled: angles, linear algebra, models, association, random draws."""
