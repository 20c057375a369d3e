"""Smoothers: belief = the whole trajectory, of which the present is told (extra `smoothing`)."""
