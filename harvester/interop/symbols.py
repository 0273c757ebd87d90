"""Writes the block's symbols for schematics: LTspice's `.asy` and KiCad's `.kicad_sym`."""

from __future__ import annotations

# Positions of the pins: (side, position in grid units from the top).
PLACES = {"base": ("left", 1), "x": ("left", -1), "p": ("right", 1), "n": ("right", -1)}


def ltspice_symbol(name: str, library: str, pins: tuple[str, ...]) -> str:
    """A symbol that calls a sub-circuit of a library in the same folder.

    Parameters
    ----------
    name : str
        Name of the sub-circuit.
    library : str
        Name of its file.
    pins : tuple of str
        Names of the pins in the sub-circuit's order.
    """
    lines = [
        "Version 4",
        "SymbolType CELL",
        "RECTANGLE Normal -64 -48 64 48",
        f"TEXT 0 0 Center 1 {name}",
        "WINDOW 0 0 -64 Center 2",
        "SYMATTR Prefix X",
        f"SYMATTR Value {name}",
        f"SYMATTR ModelFile {library}",
        f"SYMATTR Description Vibration energy harvester {name}",
    ]
    for order, pin in enumerate(pins, start=1):
        side, position = PLACES[pin]
        x, y = (-64 if side == "left" else 64), -32 * position
        lines += [f"PIN {x} {y} {side.upper()} 8", f"PINATTR PinName {pin}",
                  f"PINATTR SpiceOrder {order}"]  # fmt: skip
    return "\n".join(lines) + "\n"


def kicad_symbol(name: str, library: str, pins: tuple[str, ...]) -> str:
    """A KiCad library with one symbol for simulation with ngspice; see `ltspice_symbol`."""
    order = " ".join(f"{k}={pin}" for k, pin in enumerate(pins, start=1))
    fields = {
        "Reference": ("U", False),
        "Value": (name, False),
        "Footprint": ("", True),
        "Datasheet": ("", True),
        "Sim.Device": ("SUBCKT", True),
        "Sim.Library": (library, True),
        "Sim.Name": (name, True),
        "Sim.Pins": (order, True),
    }
    properties = "".join(
        f'    (property "{key}" "{value}" (at 0 {7.62 if key == "Reference" else -7.62} 0)\n'
        f"      (effects (font (size 1.27 1.27)){' hide' if hidden else ''}))\n"
        for key, (value, hidden) in fields.items()
    )
    drawn = "".join(_kicad_pin(k, pin) for k, pin in enumerate(pins, start=1))
    return (
        "(kicad_symbol_lib (version 20211014) (generator harvester)\n"
        f'  (symbol "{name}" (in_bom yes) (on_board yes)\n{properties}'
        f'    (symbol "{name}_0_1"\n'
        "      (rectangle (start -7.62 5.08) (end 7.62 -5.08)\n"
        "        (stroke (width 0.254) (type default)) (fill (type background))))\n"
        f'    (symbol "{name}_1_1"\n{drawn}    )\n  )\n)\n'
    )


def _kicad_pin(number, name):
    side, position = PLACES[name]
    x, angle = (-10.16, 0) if side == "left" else (10.16, 180)
    kind = {"base": "input", "x": "output"}.get(name, "passive")
    font = "(effects (font (size 1.27 1.27)))"
    return (
        f"      (pin {kind} line (at {x} {2.54 * position:g} {angle}) (length 2.54)\n"
        f'        (name "{name}" {font}) (number "{number}" {font}))\n'
    )
