"""What a closure of stochastic averaging gives."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Averages:
    """Stationary means in scaled units.

    Attributes
    ----------
    closure : str
    mean_square_voltage : float
        E[V²] (Eq. 28).
    mean_power : float
        βλE[V²] (Eq. 30), s⁻³.
    mechanical_loss : float
        E[(c + contact damping) X'²] (Eq. 36), s⁻³.
    power_conversion_efficiency : float
        `mean_power` / (`mechanical_loss` + `mean_power`) (Eq. 35).
    mean_square_velocity, mean_square_displacement : float
        E[X'²], E[X²].
    share_in_wells : float or None
        Probability of the orbits inside a well; 0 for a monostable device. None where nothing is
        averaged over orbits.
    numerical_error : dict of str to float
        Of each mean above, from a coarser grid.
    density : Density, SlowDensity or GridDensity
        Densities of displacement, velocity and both; of the first two of energy as well.
    validity : dict of str to float
        Of `slow_load`: numbers that are small where its assumptions hold.
    """

    closure: str
    mean_square_voltage: float
    mean_power: float
    mechanical_loss: float
    power_conversion_efficiency: float
    mean_square_velocity: float
    mean_square_displacement: float
    share_in_wells: float
    numerical_error: dict
    density: object = field(repr=False)
    validity: dict = field(default_factory=dict)
