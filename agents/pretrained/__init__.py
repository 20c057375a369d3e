"""Trained policies that come with slam-gym, one folder for each scenario; README.md says how each came about."""
