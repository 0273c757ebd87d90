"""A closure of a test: the stationary solver under another name."""

from harvester.averaging.closures import Closure
from harvester.averaging.fokker_planck import fokker_planck

TOY = Closure(fokker_planck, 1e-2)
