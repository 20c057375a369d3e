"""Whether an unlabelled landmark is there at all: log odds of its existence, from being seen and from not being seen.

The recursion of a Bernoulli filter with one return per landmark (Mahler 2007; for FastSLAM Montemerlo and Thrun 2003):

    seen                  l += log p_D + log p(z | landmark) - log kappa(z)
    should have been      l += log(1 - p_D)

with p_D the detection probability and kappa the density of false alarms, uniform over the area swept. Without false
alarms every landmark is there from its first sighting. The log odds are bounded, so that a landmark that has gone, or
never was (two of one), is let go after a few sweeps.
"""

import math

from estimators.kernels.jit import inline

FIRST_SIGHTING = math.log(0.4 / 0.6)  # log odds of a landmark seen once, where there are false alarms
SHOWN = math.log(0.999 / 0.001)  # log odds above which a landmark is part of the belief
CERTAIN = 16.0  # bound of the log odds
SURE_DETECTION = 0.99  # p_D is taken as this at most: models are not perfect
MARGIN = 3.0  # deviations inside the sensor's limits from which on a landmark should be seen
_ALL_ROUND = 2.0 * math.pi - 1e-6  # [rad], a field of view that has no edge
_LOG_TWO_PI = math.log(2.0 * math.pi)
REMOVE_BELOW = 0.05  # probability of existence: the filters' default


def log_odds(probability):
    """Of a probability in [0, 1)."""
    return math.log(probability / (1.0 - probability)) if probability > 0.0 else -math.inf


def check_remove_below(probability):
    """Raise a ValueError unless landmarks that were just seen would stay."""
    if not 0.0 <= probability < 0.4:
        raise ValueError(
            f"remove_below is a probability below 0.4, that of a landmark just seen (0: never remove); got "
            f"{probability!r}"
        )


@inline
def log_odds_at_first(model):
    """Of a landmark just started."""
    return CERTAIN if not model.clutter_rate > 0.0 else FIRST_SIGHTING


@inline
def log_odds_seen(model, log_odds, distance, log_likelihood):
    """After a return from that distance was taken for the landmark's; log_likelihood: its density by range, bearing."""
    if not model.clutter_rate > 0.0:
        return CERTAIN
    kappa = model.clutter_rate * 2.0 * distance / (model.max_range * model.max_range * model.field_of_view)
    gain = math.log(model.detection_probability) + log_likelihood - math.log(kappa)
    return min(CERTAIN, log_odds + gain)


@inline
def expected_log_likelihood(log_det):
    """Of a return with innovation covariance S, for its expected NIS of 2."""
    return -1.0 - 0.5 * log_det - _LOG_TWO_PI


@inline
def log_odds_missed(model, log_odds):
    """After a sweep in which the landmark should have been seen and was not."""
    return log_odds + math.log(1.0 - min(model.detection_probability, SURE_DETECTION))


@inline
def should_be_seen(model, distance, bearing, range_std, bearing_std):
    """Whether a predicted return lies inside range and view, with a margin for what is not known."""
    if distance + MARGIN * range_std > model.max_range:
        return False
    view = model.field_of_view
    return view >= _ALL_ROUND or abs(bearing) + MARGIN * bearing_std < 0.5 * view


@inline
def may_cover(dx, dy, ex, ey, radius):
    """Whether a pillar of that radius at (ex, ey) from the sensor may hide a point at (dx, dy)."""
    along, square = ex * dx + ey * dy, dx * dx + dy * dy
    if along <= 0.0:
        return False
    if along >= square:
        return (ex - dx) ** 2 + (ey - dy) ** 2 < radius * radius
    return (ex * dy - ey * dx) ** 2 < radius * radius * square
