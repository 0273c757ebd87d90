"""A closure of a test: the stationary solver under another name."""

from harvester.averaging.closures import StationaryMethod
from harvester.averaging.fokker_planck import fokker_planck

TOY = StationaryMethod(fokker_planck, 1e-2)
