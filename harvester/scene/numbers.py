"""The numbers of a scene that a study may vary, by their dotted keys."""

from harvester.excitation import KINDS
from harvester.scene.schema import KEYS


def numbers(scene):
    """Those of its device, load and excitation, not those of its run.

    One of several tables is named by its place, as in `stoppers[1].gap`.

    Parameters
    ----------
    scene : harvester.scene.model.Scene

    Returns
    -------
    dict of str to (float, harvester.scene.schema.Key)
    """
    tables, found = scene.to_tables(), {}
    for name, keys in {**KEYS, "excitation": scene.excitation.KEYS}.items():
        if name != "run":
            _collect(found, name, tables.get(name, {}), lambda _, keys=keys: keys)
    return found


def _collect(found, name, values, keys_of):
    """Add what a table, or each of several, holds; `keys_of` gives the keys of one."""
    if isinstance(values, (list, tuple)):
        for place, each in enumerate(values):
            _collect(found, f"{name}[{place}]", each, keys_of)
        return
    for key, spec in keys_of(values).items():
        if key not in values or key == "knot_spacing":
            continue
        if spec.each and spec.each.kind is dict:
            _collect(found, f"{name}.{key}", values[key], lambda part: KINDS[part["kind"]].KEYS)
        elif spec.kind is float and not spec.words and not spec.each:
            found[f"{name}.{key}"] = values[key], spec
