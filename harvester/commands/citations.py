"""Where the methods come from: one list, and which of it a result used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from harvester.errors import HarvesterError


class Source(NamedTuple):
    """A publication or a program.

    Attributes
    ----------
    method : str
        Method of the source that is used here.
    reference : str
    used : callable
        Given `Used`, whether a result rests on it.
    """

    method: str
    reference: str
    used: Callable


class Used(NamedTuple):
    """The parts of a result that decide its citations: its scene's tables and engines' names."""

    scene: dict
    engines: tuple

    def engine(self, name: str) -> bool:
        """Whether an engine or closure of this name took part."""
        return any(name in engine for engine in self.engines)

    @property
    def simulated(self) -> bool:
        """Whether a number has a statistical error."""
        return self.engine("circuit") or self.engine("monte-carlo")

    def value(self, table: str, key: str) -> str | None:
        """A value of the scene, or None."""
        return self.scene.get(table, {}).get(key)

    def load(self, *names: Any) -> bool:
        """Whether the load is one of these netlists."""
        return self.value("load", "netlist") in names


SOURCES = (
    Source(
        "the model, its scaling and the closures' equations",
        "M. Li, D. Liu and J. Li, Stochastic analysis of vibro-impact bistable energy harvester "
        "system under colored noise, Nonlinear Dyn. 111, 17007-17020 (2023), "
        "doi:10.1007/s11071-023-08773-4",
        lambda used: True,
    ),
    Source(
        "the contact law of the stoppers (Hertz-damp)",
        "H. M. Lankarani and P. E. Nikravesh, A contact force model with hysteresis damping for "
        "impact analysis of multibody systems, J. Mech. Des. 112, 369-376 (1990)",
        lambda used: "stoppers" in used.scene,
    ),
    Source(
        "the noise",
        "G. E. Uhlenbeck and L. S. Ornstein, On the theory of the Brownian motion, Phys. Rev. 36, "
        "823-841 (1930)",
        lambda used: used.value("excitation", "kind") == "ornstein-uhlenbeck",
    ),
    Source(
        "stochastic averaging",
        "R. L. Stratonovich, Topics in the Theory of Random Noise, Gordon and Breach (1963)",
        lambda used: used.engine("averaging"),
    ),
    Source(
        "the stationary Fokker-Planck equation",
        "H. Risken, The Fokker-Planck Equation, 2nd ed., Springer (1989); Y. Saad and M. H. "
        "Schultz, GMRES: a generalized minimal residual algorithm for solving nonsymmetric linear "
        "systems, SIAM J. Sci. Stat. Comput. 7, 856-869 (1986)",
        lambda used: used.engine("fokker_planck"),
    ),
    Source(
        "the noise fitted to a record's spectrum",
        "P. Whittle, The analysis of multiple stationary time series, Ark. Mat. 2, 423 (1953)",
        lambda used: used.engine("fitted noise"),
    ),
    Source(
        "error bars from batch means",
        "H. Flyvbjerg and H. G. Petersen, Error estimates on averages of correlated data, J. Chem. "
        "Phys. 91, 461-466 (1989)",
        lambda used: used.simulated,
    ),
    Source(
        "the circuit simulator",
        "ngspice, https://ngspice.sourceforge.io",
        lambda used: used.engine("circuit"),
    ),
    Source(
        "its ancestor and its integration",
        "L. W. Nagel, SPICE2: A Computer Program to Simulate Semiconductor Circuits, Memorandum "
        "ERL-M520, University of California, Berkeley (1975)",
        lambda used: used.engine("circuit"),
    ),
    Source(
        "the circuit's construction",
        "F. Salvaire, PySpice, https://github.com/PySpice-org/PySpice",
        lambda used: used.engine("circuit"),
    ),
    Source(
        "compiled callbacks and Monte Carlo",
        "S. K. Lam, A. Pitrou and S. Seibert, Numba: a LLVM-based Python JIT compiler, Proc. LLVM-"
        "HPC (2015)",
        lambda used: used.simulated,
    ),
    Source(
        "the device's mechanics and capacitance",
        "J. P. Norenberg, A. Cunha Jr, P. Wolszczak and G. Litak, Piezomagnetic vibration energy "
        "harvester with an amplifier, Theor. Appl. Mech. Lett. 13, 100478 (2023)",
        lambda used: used.scene.get("name") == "device",
    ),
    Source(
        "the device's damping, coupling and load",
        "A. Erturk, J. Hoffmann and D. J. Inman, A piezomagnetoelastic structure for broadband "
        "vibration energy harvesting, Appl. Phys. Lett. 94, 254102 (2009)",
        lambda used: used.scene.get("name") == "device",
    ),
    Source(
        "the asymmetric spring and its values",
        "J. P. Norenberg, P. S. Varoto, S. da Silva and A. Cunha Jr, Asymmetry-enhanced "
        "performance in bistable energy harvesters: An experimental study (2025), public code "
        "BistableX; mechanics and capacitance as in the scene device, STONEHENGE 1.0",
        lambda used: used.scene.get("name") == "asymmetric",
    ),
    Source(
        "the beam, its piezo and load (the stopper is chosen here)",
        "Theoretical and Experimental Study of Nonlinear and Electro-Magneto-Mechanical-Based "
        "Piezoelectric Vibration Energy Harvester, Shock and Vibration 2019, 9093605, Table 2",
        lambda used: used.scene.get("name") == "one_sided",
    ),
    Source(
        "the tristable spring, its damping and coupling",
        "L. G. Costa, CHAOS - A Nonlinear Dynamics Package for Harmonically Forced Oscillators "
        "(2023), public code; mechanics and capacitance as in the scene device, STONEHENGE 1.0",
        lambda used: used.scene.get("name") == "tristable",
    ),
    Source(
        "a beam's lumped values from its drawing",
        "A. Erturk and D. J. Inman, An experimentally validated bimorph cantilever model for "
        "piezoelectric energy harvesting from base excitations, Smart Mater. Struct. 18, 025009 "
        "(2009)",
        lambda used: "beam" in used.scene,
    ),
    Source(
        "the magnets' force as that of dipoles",
        "S. C. Stanton, C. C. McGehee and B. P. Mann, Nonlinear dynamics for broadband energy "
        "harvesting: Investigation of a bistable piezoelectric inertial generator, Physica D 239, "
        "640-653 (2010)",
        lambda used: "magnets" in used.scene,
    ),
    Source(
        "the bimorph's dimensions and materials",
        "A. Erturk and D. J. Inman, Proc. IMechE Part I 225, 485 (2011)",
        lambda used: used.scene.get("name") == "bimorph_bare",
    ),
    Source(
        "the cycles of strain: rainflow",
        "ASTM E1049-85, Standard Practices for Cycle Counting in Fatigue Analysis, 5.4.4",
        lambda used: "fatigue_strain" in used.scene.get("beam", {}),
    ),
    Source(
        "the geophone's values",
        "EGL, Equivalent to SM-24 geophone 10 Hz sensor vertical, product page",
        lambda used: used.scene.get("name") == "geophone",
    ),
    Source(
        "the magnet, its coil and measured spring (coupling and fit are made here)",
        "T. Kapanen, EM_harvester_simulation (2016), public code",
        lambda used: used.scene.get("name") == "electromagnetic",
    ),
    Source(
        "a device of this kind: a magnet between magnets in a coil; the values are others",
        "B. P. Mann and N. D. Sims, Energy harvesting from the nonlinear oscillations of magnetic "
        "levitation, J. Sound Vib. 319, 515-530 (2009)",
        lambda used: "coil" in used.scene and used.scene.get("name") != "geophone",
    ),
    Source(
        "the load: rectifier with storage",
        "G. K. Ottman, H. F. Hofmann, A. C. Bhatt and G. A. Lesieutre, Adaptive piezoelectric "
        "energy harvesting circuit for wireless remote power supply, IEEE Trans. Power Electron. "
        "17, 669-676 (2002)",
        lambda used: used.load("bridge", "bridge_ideal", "bridge_buck"),
    ),
    Source(
        "the load: values of its converter",
        "LTC3588-1, Nanopower Energy Harvesting Power Supply, data sheet, Analog Devices",
        lambda used: used.load("bridge_buck"),
    ),
    Source(
        "the load: synchronized switch harvesting on inductor",
        "D. Guyomar, A. Badel, E. Lefeuvre and C. Richard, Toward energy harvesting using active "
        "materials and conversion improvement by nonlinear processing, IEEE Trans. Ultrason. "
        "Ferroelectr. Freq. Control 52, 584-595 (2005)",
        lambda used: used.load("sshi_parallel", "sshi_series"),
    ),
    Source(
        "the load: synchronous electric charge extraction",
        "E. Lefeuvre, A. Badel, C. Richard and D. Guyomar, Piezoelectric energy harvesting device "
        "optimization by synchronous electric charge extraction, J. Intell. Mater. Syst. Struct. "
        "16, 865-876 (2005)",
        lambda used: used.load("sece"),
    ),
)


def sources_of(content: Any) -> list[Source]:
    """Sources of the methods that a result used.

    Parameters
    ----------
    content : dict
        A result's or a comparison's JSON.

    Returns
    -------
    list of Source

    Raises
    ------
    HarvesterError
        It is no such JSON.
    """
    scene = content.get("scene") if isinstance(content, dict) else None
    engines = isinstance(scene, dict) and (content.get("results") or [content.get("engine")])
    if not engines or None in engines:
        raise HarvesterError(
            "holds no scene and engine; give the JSON of simulate, average or validate"
        )
    used = Used(content["scene"], tuple(engines))
    return [source for source in SOURCES if source.used(used)]
