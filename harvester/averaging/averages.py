"""Result of a stationary method: means, their errors and densities."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Averages:
    """Stationary means in scaled units.

    Equation numbers are those of Li, Liu and Li (2023). X is the displacement, V the voltage, c the
    damping, β the coupling and λ the decay rate of the voltage through the load. Time is in
    seconds, so that scaled powers are in s⁻³.

    Attributes
    ----------
    mean_square_voltage : E[V²] (Eq. 28).
    mean_power
        βλE[V²] (Eq. 30), s⁻³.
    mechanical_loss : E[(c + contact damping) X'²] (Eq. 36), s⁻³.
    power_conversion_efficiency
        `mean_power` / (`mechanical_loss` + `mean_power`) (Eq. 35).
    mean_square_velocity, mean_square_displacement : E[X'²], E[X²].
    mean_transducer_loss
        Power lost in leak or winding, s⁻³.
    share_in_wells : float or None
        Probability of the orbits inside a well; 0 for a monostable device. None for methods that
        do not average over orbits.
    numerical_error
        Numerical error of each mean above, and of the means in `between_wells`.
    density : OrbitDensity or GridDensity
        Densities of displacement, velocity and both; `GridDensity` also of the terminal voltage.
    weakest_premise : str
        Of methods that average over orbits: the premise that holds worst, with its ratio, which
        must be far below 1.
    between_wells : dict of str to float
        Quantities of `fokker_planck` for several wells with jumps between them:
        `well_crossing_rate`; on request `slowest_decay_rate` and the rates named by
        `harvester.device.cores.jump_rates` (1/s); without symmetry also `share_of_time_in_well_1`
        and so on from the left.
    """

    mean_square_voltage: float
    mean_power: float
    mechanical_loss: float
    power_conversion_efficiency: float
    mean_square_velocity: float
    mean_square_displacement: float
    numerical_error: dict
    density: Any = field(repr=False)
    mean_transducer_loss: float = 0.0
    share_in_wells: float | None = None
    between_wells: dict = field(default_factory=dict)
    weakest_premise: str = ""
