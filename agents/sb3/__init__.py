"""Learned policies: training with Stable-Baselines3, policy files, and the policy that reads one.

Nothing here imports torch or Stable-Baselines3 before it needs them: a learned policy drives without either.
"""
