"""Excitations: each kind is a class in its own module and an entry in `KINDS`."""

from __future__ import annotations

from harvester.base.registry import Registry
from harvester.excitation.base import Excitation
from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck
from harvester.excitation.prescribed import PrescribedDisplacement
from harvester.excitation.recorded import RecordedMotion
from harvester.excitation.sine import Sine
from harvester.excitation.spectrum import Spectrum
from harvester.excitation.sum import Sum
from harvester.excitation.swept_sine import SweptSine
from harvester.excitation.white import White

# Excitations by the value of `[excitation] kind`. The first is the default.
KINDS: Registry[type[Excitation]] = Registry(
    "harvester.excitations",
    {
        "ornstein-uhlenbeck": OrnsteinUhlenbeck,
        "record": RecordedMotion,
        "sine": Sine,
        "white": White,
        "spectrum": Spectrum,
        "sum": Sum,
        "swept-sine": SweptSine,
        "prescribed_displacement": PrescribedDisplacement,
    },
)
