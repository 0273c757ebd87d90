"""The transducers that a scene may have, by the name of their table.

A transducer acts on the mass with a force and hands power to what hangs on its terminals. Its own
loss (leak, winding) is a quantity of its own and never counts as power.
`harvester.device.terminals` says what a module of one holds.
"""

from harvester.device.coil import CoilTable
from harvester.device.piezo import PiezoTable
from harvester.device.terminals import TransducerTable
from harvester.registry import Registry

TRANSDUCERS: Registry[type[TransducerTable]] = Registry(
    "harvester.transducers", {"piezo": PiezoTable, "coil": CoilTable}
)
