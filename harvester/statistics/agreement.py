"""Rule of agreement of two estimates, for comparisons, cross-checks and verdicts."""

from __future__ import annotations

# A difference is significant from this number of standard errors on; by chance one in 370 is.
SIGNIFICANT_SIGMAS = 3.0
# A smaller share of a quantity is negligible: the default steps may cost as much,
# docs/explanation/steps.md.
NEGLIGIBLE_SHARE = 0.01
# A difference whose standard error is a larger share does not check either estimate.
SHARP_SHARE = 0.1
NOT_SHARP = f"known no better than ± {SHARP_SHARE:.0%}"


def differ(
    difference: float,
    standard_error: float | None,
    *,
    negligible: float = 0.0,
    allowance: float = 0.0,
    sigmas: float = SIGNIFICANT_SIGMAS,
) -> bool:
    """Whether two estimates differ; False where the standard error is not known.

    Parameters
    ----------
    difference : float
        Difference of the two, or its share of one of them.
    standard_error : float or None
        Standard error of the difference, in the same unit.
    negligible : float
        A smaller difference is none, however significant it is.
    allowance : float
        Part of a difference that is expected, in addition to chance.
    sigmas : float
        Number of standard errors that chance may cause.

    Examples
    --------
    >>> differ(0.05, 0.01), differ(0.005, 1e-4, negligible=0.01), differ(0.05, 0.01, allowance=0.03)
    (True, False, False)
    """
    if standard_error is None:
        return False
    return bool(abs(difference) > max(sigmas * standard_error + allowance, negligible))


def is_sharp(standard_error: float | None) -> bool:
    """Whether a difference, as a share, is known well enough to check two estimates."""
    return standard_error is not None and standard_error <= SHARP_SHARE
