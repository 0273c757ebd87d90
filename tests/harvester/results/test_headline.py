"""What a report's first line says of the excitation."""

import numpy as np

from harvester.results.headline import conditions
from harvester.scene.model import Scene


def test_a_record_is_named_by_its_file_and_column(tmp_path):
    path = tmp_path / "road.csv"
    rows = np.column_stack([np.arange(4000) / 1000.0, np.random.default_rng(1).normal(size=4000)])
    header = "t [s];az [m/s^2]\n"
    path.write_text(header + "\n".join(f"{t:.3f};{a:.6f}".replace(".", ",") for t, a in rows))
    changes = {"kind": "record", "file": str(path), "column": "az"}
    scene = Scene.read("cantilever").replace(
        {"excitation": changes, "run.duration": 3.0, "run.settle": 0.5}
    )
    assert conditions(scene) == "record road.csv, column az"


def test_noise_is_named_with_its_values():
    assert conditions(Scene.read("linear")).startswith("ornstein-uhlenbeck excitation, noise")
