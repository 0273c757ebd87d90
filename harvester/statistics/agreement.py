"""Criterion for the agreement of two estimates in comparisons, cross-checks and verdicts."""

from __future__ import annotations

# A difference of at least this many standard errors is significant; chance causes one in 370.
SIGNIFICANT_SIGMAS = 3.0
# A smaller relative difference is negligible, since the default steps may cause as much
# (docs/explanation/steps.md).
NEGLIGIBLE_SHARE = 0.01
# A difference with a larger relative standard error is too uncertain to check an estimate.
SHARP_SHARE = 0.1
NOT_SHARP = f"uncertain by more than ± {SHARP_SHARE:.0%}"


def differ(
    difference: float,
    standard_error: float | None,
    *,
    negligible: float = 0.0,
    allowance: float = 0.0,
    sigmas: float = SIGNIFICANT_SIGMAS,
) -> bool:
    """Whether two estimates differ; False if the standard error is unknown.

    Parameters
    ----------
    difference : float
        Difference of the two estimates, or its share of one of them.
    standard_error : float or None
        Standard error of the difference, in the same unit.
    negligible : float
        A smaller difference is ignored, even if it is significant.
    allowance : float
        Expected part of the difference, in addition to the statistical error.
    sigmas : float
        Number of standard errors above which a difference is significant.

    Examples
    --------
    >>> differ(0.05, 0.01), differ(0.005, 1e-4, negligible=0.01), differ(0.05, 0.01, allowance=0.03)
    (True, False, False)
    """
    if standard_error is None:
        return False
    return bool(abs(difference) > max(sigmas * standard_error + allowance, negligible))


def is_sharp(standard_error: float | None) -> bool:
    """Whether a relative difference is precise enough to check two estimates."""
    return standard_error is not None and standard_error <= SHARP_SHARE
