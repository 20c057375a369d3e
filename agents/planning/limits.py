"""What planners ask of counts among their options, and what stands in the place of a limit that a robot has not."""

NO_LIMIT = 1e6  # [m/s] or [rad/s] in the place of infinity, which a plan cannot be made with
MOST = 64  # of anything that a plan has several of


def check_counts(policy: str, **counts: int) -> None:
    """Raises ValueError, with the policy's name, for an option that is no whole number from 1 to `MOST`."""
    for option, count in counts.items():
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
            raise ValueError(f"{policy}: {option} must be a whole number from 1 to {MOST}; got {count!r}")
