"""Policies that weigh what a plan would let them see."""
