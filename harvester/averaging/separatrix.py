"""Fluxes between the wells and the outer orbits around both, at one layer of the slow charge.

Averaging joins g of the wells and g of the outer orbits at the separatrix. The energy changes once
a lobe, however, by a kick of the noise (variance 2A) and by what the lobe takes (B): not little
against the layer at the separatrix in which the sides exchange mass. Far from it that walk goes
over into the diffusion of averaging, but for two things that depend on A and B alone:

- Flux F from side to side makes a step of g, E0 (1/A_L + 1/A_R) F. Mel'nikov and Meshkov (J. Chem.
  Phys. 85, 1018, 1986) give the rate of crossing from well to well as Υ(δ_L) Υ(δ_R)/Υ(δ_L + δ_R)
  with Υ = exp(1/(2π) ∫ ln(1 − exp(−δ(x² + ¼)))/(x² + ¼) dx); diffusion, with a step, gives
  δ_L δ_R/(δ_L + δ_R)/(1 + E0/θ). δ = A/θ², θ = Σ A/Σ B.
- Sides that take unequal shares, B_L/A_L ≠ B_R/A_R, have unequal g without any flux, since mass
  that drifts down faster on one side is made up for by kicks, which cross like a flux does: the
  step is E0 (B_L/A_L − B_R/A_R) of g.
"""

import numpy as np

STEEPEST = 2.0  # logarithm of the step without flux, of first order in the unequal shares
# In t of the integral below, which runs from 0 to infinity: t in proportion to u/(1 − u)².
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(120)
_PLACES = 0.5 * (_POINTS + 1.0)
_STRETCHED = _PLACES / (1.0 - _PLACES) ** 2
_STEPS = 0.5 * _WEIGHTS * (1.0 + _PLACES) / (1.0 - _PLACES) ** 3


def fluxes(inside, noises, losses, outside, noise):
    """Outward fluxes out of the wells as weights of (wells' last cells, outer first cell).

    Σ A g over the wells is A g of the outer orbit: what the noise gives to one it takes from the
    other.

    Parameters
    ----------
    inside : list of tuple of float
        Of each well, the weights of the flux (`transport.fitted`) for its last cell and for the
        separatrix.
    noises, losses : list of float
        A and B of each well's separatrix.
    outside : tuple of float
        The same weights from the separatrix to the first outer cell.
    noise : float
        A of the first outer orbit.

    Returns
    -------
    ndarray, shape (wells, wells + 1)
    """
    sides = len(inside)
    # Unknowns: fluxes of the sides, then g at the junction.
    matrix, given = np.zeros((sides + 1, sides + 1)), np.zeros((sides + 1, sides + 1))
    slip, uneven = np.zeros((sides, sides)), np.ones(sides)
    if sides == 2:
        slip, uneven = _steps(np.array(noises), np.array(losses))
    share = noise / sum(noises) * uneven
    for k, (below, above) in enumerate(inside):
        matrix[k, :sides] = -above * slip[k]
        matrix[k, k] += 1.0
        matrix[k, sides] = -above * share[k]
        given[k, k] = below
    matrix[sides, :sides] = 1.0
    matrix[sides, sides] = -outside[0]
    given[sides, sides] = outside[1]
    return np.linalg.solve(matrix, given)[:sides]


def _steps(noises, losses):
    """g of either side from the fluxes, (2, 2), and from g at the junction, (2,)."""
    total = noises.sum()
    length = slip_length(noises, losses)
    change = noises[::-1] * np.array([1.0, -1.0]) / total
    slip = np.array([change, -change]) * length / noises[:, None]
    step = length * (losses[0] / noises[0] - losses[1] / noises[1])
    uneven = np.exp(np.array([0.5, -0.5]) * np.clip(step, -STEEPEST, STEEPEST))
    return slip, uneven * total / np.sum(noises * uneven)


def slip_length(noises, losses):
    """E0 of two sides, an energy.

    Parameters
    ----------
    noises, losses : ndarray, shape (2,)
        A > 0 and B ≥ 0 of the sides.

    Returns
    -------
    float
    """
    inverse = losses.sum() / noises.sum()
    excess = sum(_missed(a, inverse) for a in noises) - _missed(noises.sum(), inverse)
    return np.expm1(inverse * excess) / inverse if inverse > 0.0 else excess


def _missed(noise, inverse):
    """θ ln(δ/Υ(δ)) with δ = A/θ²; −ζ(½)/√π √A where nothing is lost."""
    quarter = 0.25 * noise * inverse**2
    scale = np.sqrt(1.0 + quarter)
    y = (scale * _STRETCHED) ** 2 + quarter
    integrand = np.log(-np.expm1(-y) / y) / y
    return -np.sqrt(noise) / np.pi * scale * np.sum(_STEPS * integrand)
